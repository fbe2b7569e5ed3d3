"""The initial template: it tells a target from its former place, and from similar things."""

from __future__ import annotations

from dataclasses import replace

from drawn_video import DrawnVideo, SIZE, TARGET
import numpy as np
import pytest

from vtrack_ros.appearance.regression import CorrelationFilter
from vtrack_ros.localisation.presence import InitialTemplate
from vtrack_ros.localisation.search_window import WindowLayout
from vtrack_ros.localisation.target_model import TargetModel

MIDDLE = (SIZE[0] / 2, SIZE[1] / 2)


def window_at(frame, center=MIDDLE):
    """Return the search window about a place."""
    return WindowLayout.around(*TARGET).window(frame, center, TARGET)


def learned(frame):
    """Return the initial template of the target in the middle."""
    window = window_at(frame)
    return InitialTemplate.of(TargetModel.create(window), window)


def similarity(template, frame, center=MIDDLE):
    """Return the similarity of a place to the template."""
    return template.similarity(window_at(frame, center))


def test_a_confined_filter_sees_the_target_alone():
    """Whatever the surroundings are, its response in the middle is the same."""
    rng = np.random.default_rng(0)
    empty = CorrelationFilter.create(20, 24, 1.5)
    features = rng.normal(size=(4, 20, 24)).astype(np.float32)
    whole = empty.updated(empty.transform(features), 1.0)
    part = whole.confined(8.0, 6.0)
    other = rng.normal(size=features.shape).astype(np.float32)
    # one cell more than half the target, whose border may lie in a cell
    other[:, 10 - 4:10 + 5, 12 - 5:12 + 6] = features[:, 10 - 4:10 + 5, 12 - 5:12 + 6]
    here, there = (filter_.response(empty.transform(one))[10, 12]
                   for filter_, one in ((part, features), (part, other)))
    assert there == pytest.approx(here, abs=1e-4)
    assert abs(whole.response(empty.transform(other))[10, 12]
               - whole.response(empty.transform(features))[10, 12]) > 0.1


def test_a_filter_confined_to_the_whole_window_is_the_filter():
    """The response stays the same: nothing is cut off."""
    empty = CorrelationFilter.create(20, 24, 1.5)
    features = np.random.default_rng(1).normal(size=(4, 20, 24)).astype(np.float32)
    spectrum = empty.transform(features)
    whole = empty.updated(spectrum, 1.0)
    np.testing.assert_allclose(
        whole.confined(48.0, 40.0).response(spectrum), whole.response(spectrum), atol=1e-4)


def test_a_blank_target_is_similar_to_nothing():
    """A template of a blank target has similarities below 0.1, but above -10."""
    blank = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    template = learned(blank)
    for frame in (blank, DrawnVideo().frame(MIDDLE)):
        assert -10 < similarity(template, frame) < 0.1


@pytest.mark.parametrize('colour', [True, False], ids=['colour', 'grey'])
def test_the_first_frame_itself(colour):
    """Its similarity is 0.75, and above 0.5 a pixel beside it, in colour and in grey."""
    frame = DrawnVideo(colour).frame(MIDDLE)
    template = learned(frame)
    assert similarity(template, frame) == pytest.approx(0.75, abs=0.01)
    assert similarity(template, frame, (MIDDLE[0] + 1, MIDDLE[1])) > 0.5


@pytest.mark.parametrize('seed', range(5))
def test_the_place_where_it_stood_is_not_the_target(seed):
    """The surroundings respond, but the similarity is below a fifth of that with the target."""
    video = DrawnVideo(seed=seed)
    window, empty = window_at(video.frame(MIDDLE)), window_at(video.frame(None))
    model = TargetModel.create(window)
    similar = InitialTemplate.of(model, window).similarity(empty)
    assert similar < 0.2 * 0.75
    assert similar < model.correlation.response(empty.spectrum).max()


@pytest.mark.parametrize('seed', range(5))
def test_other_colours_make_it_less_similar(seed):
    """With red and blue exchanged, the same pattern has less than 0.8 of the similarity."""
    video = DrawnVideo(seed=seed)
    template = learned(video.frame(MIDDLE))
    frame, other = video.frame(MIDDLE), video.frame(None)
    box = tuple(slice(int(middle - side / 2), int(middle + side / 2))
                for middle, side in zip(MIDDLE[::-1], TARGET[::-1]))
    other[box] = frame[box][..., ::-1]
    assert similarity(template, other) < 0.8 * similarity(template, frame)


def test_the_share_of_the_colours_counts_by_its_fourth_root():
    """The share is relative to the first frame's, with a lower bound of 0.3."""
    frame = DrawnVideo().frame(MIDDLE)
    template = learned(frame)
    for share, counted in ((1.0, 1.0), (0.5, 0.5), (0.1, 0.3)):
        other = replace(template, colour=template.colour / share)
        assert similarity(other, frame) == pytest.approx(
            counted**0.25 * similarity(template, frame))
