"""Sequences under stress: truth and time steps follow the changes, and the seed decides."""

from dataclasses import replace
from itertools import islice

import cv2
from evaluation_material import SIZE, truth_of, write_sequence
import numpy as np
import pytest

from vtrack_ros.bags import SequenceError
from vtrack_ros.evaluation.sequences import read_folder
from vtrack_ros.evaluation.stress import stress, stressed_sequence
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS, stress_kinds

FRAMES = 40
OF_FRAMES = [name for name, kind in STRESS_KINDS.items() if kind.plan is not None]


@pytest.fixture(scope='module')
def square(tmp_path_factory):
    """Return a sequence of a red square, 40 frames long."""
    return read_folder(write_sequence(tmp_path_factory.mktemp('stress') / 'Square', FRAMES))[0]


def red(frame):
    """Return the box of the pixels that are much more red than green."""
    rows, columns = np.nonzero(frame[..., 2] > frame[..., 1].astype(int) + 90)
    return [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]


@pytest.mark.parametrize('kind', ['shake', 'jumps'])
@pytest.mark.parametrize('severity', [0.5, 1.0])
def test_truth_moves_along(square, kind, severity):
    """The square is at its truth to the pixel, inside the picture, and moves as the kind says."""
    made = stress(square, kind, severity)
    for frame, box in zip(made.frames, made.truth):
        assert red(frame) == box.tolist()
        assert (box >= 0).all() and (box[:2] + box[2:] <= [160, 120]).all()
    offsets = (made.truth - square.truth)[:, :2]
    assert not offsets[0].any() and offsets.any()
    if kind == 'shake':
        assert np.linalg.norm(offsets, axis=1).max() <= severity * SIZE + 1
    else:
        jumps = np.linalg.norm(np.diff(offsets, axis=0), axis=1)
        assert jumps[jumps > 0] == pytest.approx(severity * SIZE, abs=2)
        assert 1 <= (jumps > 0).sum() <= 2


def test_the_picture_rolls_about_the_target(square):
    """A square turns to and fro in place; the true box is the bound of the turned one."""
    made = stress(square, 'roll', 45)
    assert made.truth[0].tolist() == list(truth_of(0))
    widths = []
    for frame, box, before in zip(made.frames, made.truth, square.truth):
        assert box == pytest.approx(before)
        x, y, width, height = red(frame)
        assert (x + width / 2, y + height / 2) == pytest.approx(box[:2] + box[2:] / 2, abs=1.5)
        widths.append(width)
    assert widths[0] == SIZE and max(widths) == pytest.approx(SIZE * np.sqrt(2), abs=3)
    assert min(widths[-4:]) < SIZE * 1.3
    flat = replace(square, truth=square.truth * [1, 1, 1, 0.5])
    rolled = stress(flat, 'roll', 90).truth
    assert rolled[rolled[:, 2].argmin(), 2:] == pytest.approx([SIZE / 2, SIZE], abs=0.2)
    assert rolled[:, :2] + rolled[:, 2:] / 2 == pytest.approx(
        flat.truth[:, :2] + flat.truth[:, 2:] / 2)


def test_resolution(square):
    """The picture and the truth shrink alike."""
    made = stress(square, 'resolution', 2)
    frame = next(made.frames)
    assert frame.shape == (60, 80, 3)
    assert made.truth.tolist() == (square.truth / 2).tolist()
    assert red(frame) == made.truth[0].tolist()


@pytest.mark.parametrize('kind', OF_FRAMES)
def test_same_seed_same_frames(square, kind):
    """The same seed gives the same frames; another one doesn't, where there is randomness."""
    severity = STRESS_KINDS[kind].severities[1]
    first, again, other = (stress(square, kind, severity, seed) for seed in (3, 3, 4))
    frames = list(first.frames)
    assert len(frames) == len(first.truth) == len(first.visible) == len(first.steps)
    assert all(frame.dtype == np.uint8 for frame in frames)
    np.testing.assert_array_equal(frames, list(again.frames))
    np.testing.assert_array_equal(first.truth, again.truth)
    others = list(other.frames)
    same = len(others) == len(frames) and np.array_equal(frames, others)
    assert same == (kind in ('rate', 'compression', 'resolution'))
    if kind not in ('rate', 'gaps', 'resolution'):
        assert not np.array_equal(frames, list(square.frames()))


@pytest.mark.parametrize('kind', OF_FRAMES)
def test_grey_frames(square, kind):
    """A grey video stays grey."""
    class Grey(type(square)):
        """The sequence in grey."""

        def frames(self):
            """Take one channel."""
            return (frame[..., 2] for frame in super().frames())
    made = stress(Grey(square.name, square.truth, square.images), kind, 2)
    assert {frame.ndim for frame in made.frames} == {2}


def test_time_that_passed(square):
    """The time steps of the remaining frames include those of the missing ones."""
    third = stress(square, 'rate', 3)
    assert third.truth.tolist() == [list(truth_of(index)) for index in range(0, FRAMES, 3)]
    assert third.steps[1:].tolist() == [3.0] * (len(third.steps) - 1)
    gaps = stress(square, 'gaps', 10)
    steps = gaps.steps[1:]
    assert steps.sum() == gaps.truth[-1, 0] / 2 - truth_of(0)[0] / 2
    assert 11 in steps and set(steps) <= {1.0, 11.0}
    assert [red(frame) for frame in gaps.frames] == gaps.truth.tolist()

    class Uneven(type(square)):
        """A recording that lost a frame before the fifth."""

        steps = np.where(np.arange(FRAMES) == 4, 2.0, 1.0)
    uneven = Uneven(square.name, square.truth, square.images)
    assert stress(uneven, 'rate', 3).steps.tolist()[:4] == [1, 3, 4, 3]


def test_hidden_is_marked(square):
    """Nothing of the square is seen where it's marked as hidden; the box is known there too."""
    made = stressed_sequence(square, 'hidden', 10)
    assert (~made.visible).sum() == 10
    assert made.boxes.tolist() == square.truth.tolist()
    assert (np.isnan(made.truth).any(axis=1) == ~made.visible).all()
    reds = [(frame[..., 2] > 180).sum() for frame in made.frames()]
    assert not np.array(reds)[~made.visible].any()
    assert min(np.array(reds)[made.visible]) == pytest.approx(SIZE ** 2 / 4, rel=0.2)


def test_twin_passes_and_the_target_stays(square):
    """A second square passes beside the target for a while, and never covers it."""
    made = stress(square, 'twin', 1.5)
    whole = 0
    for frame, box in zip(made.frames, made.truth.astype(int)):
        x, y, width, height = box
        assert (frame[y + 4:y + height - 4, x + 4:x + width - 4, 2] >= 180).all()
        whole = max(whole, (frame[..., 2] > 170).sum())
    assert 1.3 * SIZE ** 2 < whole < 2 * SIZE ** 2
    assert made.visible.all()


def test_worse_is_worse(square):
    """Each degradation takes more from the picture at the next severity."""
    plain = [frame.astype(np.float32) for frame in islice(square.frames(), 10, FRAMES, 3)]
    for kind in ('light', 'blur', 'noise', 'compression'):
        errors = []
        for severity in STRESS_KINDS[kind].severities:
            frames = islice(stress(square, kind, severity).frames, 10, FRAMES, 3)
            errors.append(np.mean([np.abs(frame - was).mean()
                                   for frame, was in zip(frames, plain)]))
        assert errors == sorted(errors) and errors[0] > 0


def test_fingerprints_differ(square):
    """Kind, severity, seed, name and content each make another sequence to the cache."""
    made = [stressed_sequence(square, 'shake', 0.3), stressed_sequence(square, 'shake', 0.6),
            stressed_sequence(square, 'jumps', 0.6), stressed_sequence(square, 'shake', 0.3, 1),
            stressed_sequence(replace(square, name='Other'), 'shake', 0.3),
            stressed_sequence(replace(square, truth=square.truth + 1), 'shake', 0.3), square]
    assert len({one.fingerprint() for one in made}) == len(made)
    assert len({one.video for one in made[:5]}) == 5
    assert made[0].fingerprint() == stressed_sequence(square, 'shake', 0.3).fingerprint()


def test_plain_is_the_original(square):
    """The kind `plain` changes nothing."""
    made = stress(square, 'plain', 0)
    np.testing.assert_array_equal(list(made.frames), list(square.frames()))
    assert made.visible.all() and made.truth.tolist() == square.truth.tolist()


@pytest.mark.parametrize('kind', ['plain', 'resolution', 'shake'])
def test_frames_of_several_sizes(tmp_path, kind):
    """They are refused, as trackers refuse the original: the truth is for the first one's size."""
    folder = write_sequence(tmp_path / 'Sizes', 6)
    path = folder / 'img' / '00004.png'
    cv2.imwrite(str(path), cv2.imread(str(path))[:100])
    made = stress(read_folder(folder)[0], kind, 2)
    with pytest.raises(SequenceError, match='Sizes: frame 3 is 160 x 100 .*first is 160 x 120'):
        list(made.frames)


@pytest.mark.parametrize(('kind', 'severity', 'message'), [
    ('rain', 1, "unknown kind of stress 'rain'; valid are plain, rate, gaps"),
    ('all', 1, "unknown kind of stress 'all'; valid are plain, rate, gaps"),
    ('particles', 20, 'particles is a parameter of the trackers'),
    ('shake', 0, 'the severity of shake must be positive, not 0'),
    ('gaps', 25, 'the severity of gaps must be below 25 frames, not 25'),
])
def test_wrong_stress(square, kind, severity, message):
    """The error says what is wrong, and what is valid."""
    with pytest.raises(ValueError, match=message):
        stress(square, kind, severity)


def test_kinds_of_a_list():
    """Each kind is taken once; `all` is every kind, also among others; a wrong one is named."""
    assert stress_kinds('rate, gaps,rate') == ('rate', 'gaps')
    assert stress_kinds('all') == stress_kinds('all,rate') == tuple(STRESS_KINDS)
    with pytest.raises(ValueError, match="unknown kind of stress 'rain'; valid are all, rate"):
        stress_kinds('all,rain')
    with pytest.raises(ValueError, match='no kind of stress is given; valid are all, rate'):
        stress_kinds(' ,')


def test_manual_names_every_kind(repository):
    """Every kind of stress has its row in the manual, with its severities."""
    manual = (repository / 'docs' / 'evaluate.md').read_text()
    rows = {line.split('|')[1].strip(' `'): line.split('|')[3]
            for line in manual.splitlines() if line.startswith('| `') and line.count('|') == 4}
    for name, kind in STRESS_KINDS.items():
        for severity in kind.severities:
            assert f'{severity:g}' in rows[name]
