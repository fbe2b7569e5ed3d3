"""Rendered scenes: exact truth, the events of each scene, and the same film for a seed."""

from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest

from vtrack_ros.scenes import render, scene_info, scene_names
from vtrack_ros.scenes.catalogue import story_times
from vtrack_ros.scenes.stage import film, FilmCamera, Light, View

PAPERS = {'face_fast': (128, 96), 'football': (400, 240), 'similar_occlusion': (384, 288),
          'pose_change': (256, 192), 'car_approach': (384, 288), 'helicopter': (320, 240)}
OTHERS = {'scale_change', 'light_change', 'light_step', 'full_occlusion', 'leave_and_return',
          'low_light_noise', 'distractor_cross'}


def shots(name, times):
    """Return time -> frame of a scene at a quarter of its size."""
    return dict(zip(times, film(quarter(name), iter(times), np.random.default_rng(0))))


@cache
def quarter(name):
    """Return a scene at a quarter of its size; cached, as its textures take long to make."""
    info = scene_info(name)
    view = View(info.width // 4, info.height // 4, info.width, info.height)
    return info.make(view, np.random.default_rng(0))


@cache
def small_face():
    """Return the frames of a film that is longer than its story, at half its size."""
    return tuple(render('face_fast', (64, 48), 60))


def test_catalogue():
    """All scenes are there; those of the papers have the papers' sizes and lengths."""
    assert set(scene_names()) == set(PAPERS) | OTHERS
    for name, size in PAPERS.items():
        assert (scene_info(name).width, scene_info(name).height) == size
    assert scene_info('face_fast').frames == 50
    assert scene_info('car_approach').frames == 200
    assert scene_info('helicopter').frames == 780
    assert scene_info('football').frames >= 130


@pytest.mark.parametrize('name', sorted(set(PAPERS) | OTHERS))
def test_truth_bounds_what_the_target_changes(name):
    """The true box bounds the pixels that change with the target's brightness, to 1.6 px."""
    info, size = scene_info(name), (220, 130)
    scene = info.make(View(*size, info.width, info.height), np.random.default_rng(5))
    # Nothing in front, no blur, no noise, even light.
    bare = replace(scene, actors=scene.actors[:scene.target + 1], light=Light(),
                   camera=replace(scene.camera, exposure=1e-6, noise=0, softness=0))
    target = bare.actors[bare.target]
    films = []
    for gain in (0.0, 1.0):
        def lit(time, gain=gain):
            sprite = target.sprite(time)
            return replace(sprite, pixels=sprite.pixels * np.float32([gain, gain, gain, 1]))
        actors = (*bare.actors[:-1], replace(target, sprite=lit))
        films.append(film(replace(bare, actors=actors), iter([0, 41]), np.random.default_rng(0)))
    for dark, shot in zip(*films):
        change = (shot.frame.astype(int) - dark.frame).max(axis=2)
        rows, columns = (np.flatnonzero(change.max(axis=axis) > 8) for axis in (1, 0))
        seen = shot.truth.clipped(*size)
        measured = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)
        expected = (seen.x, seen.y, seen.x + seen.width, seen.y + seen.height)
        assert measured == pytest.approx(expected, abs=1.6)


def test_truth_is_the_middle_of_the_exposure():
    """The truth of a blurred target is the same as of a sharp one."""
    info = scene_info('face_fast')
    scene = info.make(View(256, 192, 128, 96), np.random.default_rng(2))
    sharp = next(film(replace(scene, camera=FilmCamera(exposure=1e-6)), iter([12.0]),
                      np.random.default_rng(0)))
    blurred = next(film(replace(scene, camera=FilmCamera(exposure=0.9)), iter([12.0]),
                        np.random.default_rng(0)))
    assert sharp.truth == blurred.truth
    assert not np.array_equal(sharp.frame, blurred.frame)


def test_size_scales_the_truth():
    """Twice the size, twice the box; another aspect ratio shows more on two sides."""
    small, large, wide = (
        next(render('similar_occlusion', size)) for size in ((80, 60), (160, 120), (130, 60)))
    assert large.truth.as_array() == pytest.approx(2 * small.truth.as_array(), abs=1.0)
    shifted = small.truth.as_array() + (25, 0, 0, 0)
    assert wide.truth.as_array() == pytest.approx(shifted, abs=0.5)
    assert wide.frame.shape == (60, 130, 3)


@pytest.mark.parametrize('name', ['low_light_noise', 'car_approach'])
def test_seed(name):
    """The same seed gives the same film; another seed gives other pixels at similar places."""
    one, same, other = (
        list(render(name, (96, 72), frames=3, seed=seed)) for seed in (3, 3, 4))
    assert all(np.array_equal(a.frame, b.frame) for a, b in zip(one, same))
    assert [frame.truth for frame in one] == [frame.truth for frame in same]
    assert not any(np.array_equal(a.frame, b.frame) for a, b in zip(one, other))
    size = max(one[0].truth.width, one[0].truth.height)
    assert one[0].truth.center_distance(other[0].truth) < size


def test_number_of_frames():
    """Fewer frames are the beginning; after the end the story runs backwards."""
    short, long = list(render('face_fast', (64, 48), 4)), small_face()
    assert all(np.array_equal(a.frame, b.frame) for a, b in zip(short, long))
    assert [frame.index for frame in long] == list(range(60))
    assert long[49 + 7].truth == long[49 - 7].truth
    assert list(story_times(4, 9)) == [0, 1, 2, 3, 2, 1, 0, 1, 2]
    assert list(story_times(4, 1)) == [0]


def test_largest_size():
    """Full HD works, in colour and contiguous."""
    shot = next(render('scale_change', (1920, 1080)))
    assert shot.frame.shape == (1080, 1920, 3)
    assert shot.frame.dtype == np.uint8 and shot.frame.flags.c_contiguous
    assert shot.truth.clipped(1920, 1080) is not None


@pytest.mark.parametrize('arguments, words', [
    ({'name': 'nothing'}, 'face_fast, football'), ({'size': (1921, 1080)}, '1920x1080'),
    ({'size': (640, 20)}, '64x48'), ({'frames': 0}, 'at least 1'), ({'seed': -1}, 'negative')])
def test_wrong_arguments(arguments, words):
    """A ValueError says what is valid, before anything is rendered."""
    with pytest.raises(ValueError, match=words):
        render(**{'name': 'face_fast', **arguments})


@pytest.mark.parametrize('name', sorted(set(PAPERS) | OTHERS))
def test_begins_in_full_view(name):
    """A tracker can be started on the first frame: nothing covers the target."""
    first = shots(name, [0])[0]
    assert first.visibility > 0.99
    box = first.truth
    assert box.clipped(*reversed(first.frame.shape[:2])) == box


def test_face_fast_is_fast():
    """The face peaks at 8 to 13 pixels a frame to the right and back, and rests between."""
    speed = 2 * np.diff([frame.truth.center[0] for frame in small_face()[:50]])
    assert 8 < speed.max() < 13 and 8 < -speed.min() < 13
    assert np.abs(speed[:6]).max() < 2 and np.abs(speed[18:21]).max() < 2


@pytest.mark.parametrize('name, low, high', [
    ('full_occlusion', 15, 30), ('leave_and_return', 30, 45)])
def test_away_and_back(name, low, high):
    """The target is away once, for `low` to `high` consecutive frames."""
    story = range(0, scene_info(name).frames, 4)
    seen = shots(name, [float(time) for time in story])
    gone = [time for time in story if seen[time].truth is None]
    assert gone == list(range(gone[0], gone[-1] + 1, 4))
    assert low <= 4 * len(gone) <= high
    assert gone[0] > 40 and gone[-1] < story[-1] - 40
    assert sum(frame.visibility == 0 for frame in seen.values()) > 2
    for frame in seen.values():
        assert (frame.truth is None) == (frame.visibility < 0.1)


@pytest.mark.parametrize('name, before, during, least, most', [
    ('football', (10, 30, 48), (64, 68, 70, 72), 0.05, 0.6),
    ('similar_occlusion', (20, 60, 98), (108, 110, 112), 0.1, 0.6),
    ('distractor_cross', (10, 30, 104), (46, 47), 0.1, 0.6),
    ('car_approach', (10, 60, 80), (130, 140, 150), 0.8, 0.97)])
def test_partial_occlusions(name, before, during, least, most):
    """The target is partly covered where the summary says so, and not elsewhere."""
    seen = shots(name, [*before, *during])
    assert all(seen[time].visibility > 0.97 for time in before)
    assert all(least < seen[time].visibility < most for time in during)


def test_sizes_change():
    """The car grows about fivefold; the walker nearly threefold, and shrinks again."""
    car = shots('car_approach', [0, 199])
    assert car[199].truth.height > 4.5 * car[0].truth.height
    walker = shots('scale_change', [0, 88, 159])
    assert walker[88].truth.height > 2.5 * walker[0].truth.height
    assert walker[159].truth.height < 0.5 * walker[88].truth.height


def test_pose_change():
    """In frames 53 to 62 the face gets wider than before: it's seen from the side."""
    ratio = {time: frame.truth.width / frame.truth.height
             for time, frame in shots('pose_change', [44, 49, 53, 62, 70, 78]).items()}
    assert max(ratio[44], ratio[49], ratio[53]) < min(ratio[62], ratio[70], ratio[78])


def test_light_changes():
    """`light_change` gets dark, then reddish; the pitch gets shady; `low_light_noise` is dark."""
    mean = {time: frame.frame.mean(axis=(0, 1))
            for time, frame in shots('light_change', [10, 45, 75]).items()}
    assert mean[45].sum() < 0.5 * mean[10].sum()
    assert mean[75][2] / mean[75][0] > 1.5 * mean[10][2] / mean[10][0]
    pitch = shots('football', [40, 120])
    assert pitch[120].frame.mean() < 0.7 * pitch[40].frame.mean()
    assert shots('low_light_noise', [5])[5].frame.mean() < 70


def test_helicopter():
    """It's partly covered about frame 281, never fully; its height changes by a factor of 2.5."""
    seen = shots('helicopter', [0, 100, 200, 262, 276, 280, 281, 282, 283, 292, 300, 400, 470, 600,
                                720, 779])
    assert all(seen[time].visibility < 0.7 for time in (280, 281, 282, 283))
    assert min(frame.visibility for frame in seen.values()) > 0.1
    assert all(seen[time].visibility > 0.95 for time in (0, 262, 276, 300, 470, 720, 779))
    heights = [frame.truth.height for frame in seen.values()]
    assert max(heights) > 2.5 * min(heights)


def test_frames_are_made_one_by_one():
    """Only the requested frames of a long film are rendered."""
    assert len(list(islice(render('face_fast', frames=10_000_000), 3))) == 3


def test_light_steps_down_by_half():
    """All of the picture is half as bright after frame 58 as before frame 55."""
    seen = shots('light_step', (54, 59))
    before, after = (float(seen[time].frame.mean()) for time in (54, 59))
    assert after / before == pytest.approx(0.5, abs=0.03)


def test_a_hidden_target_has_an_outline_but_no_truth():
    """Behind the kiosk the scene still knows where the walker is."""
    seen = shots('full_occlusion', (40, 74))
    assert seen[40].truth == seen[40].outline
    assert seen[74].truth is None and seen[74].outline.width > 1
