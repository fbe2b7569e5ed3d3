"""What the papers' cues measure: the mean of the places that are like the target."""

from __future__ import annotations

import numpy as np
import pytest

from vtrack_ros.trackers.observation import CueObservation

SIDE = 24


def picture(*centers):
    """Return noise with a bright square at each of the centres."""
    rng = np.random.default_rng(0)
    frame = rng.integers(20, 60, size=(120, 160, 3), dtype=np.uint8)
    for x, y in centers:
        part = frame[y - SIDE // 2:y + SIDE // 2, x - SIDE // 2:x + SIDE // 2]
        part[:] = rng.integers(180, 230, size=part.shape, dtype=np.uint8)
    return frame


def started(measuring=True):
    """Return an observation that knows the square at (80, 60), and its box."""
    box = np.array([80.0, 60.0, SIDE, SIDE])
    observation = CueObservation('colour', 'product', 0.1, 'flat', measuring)
    observation.start(picture((80, 60)), box)
    return observation, box


@pytest.mark.parametrize('shift', [(0, 0), (5, 0), (-4, 6), (0, -7)])
def test_the_target_is_measured_where_it_is(shift):
    """Beside the prediction, to less than a tenth of its side, and sure of it."""
    observation, box = started()
    place = box[:2].astype(int) + shift
    found = observation.look(picture(place), box, box)
    assert np.abs(found.center - place).max() < SIDE / 10
    assert np.sqrt(np.linalg.eigvalsh(found.covariance)).max() < 0.2 * SIDE


def test_two_likely_places_are_measured_as_doubt():
    """The mean lies between them, and the covariance reaches to both, along their line alone."""
    observation, box = started()
    small = box * [1, 1, 0.5, 0.5]
    observation.start(picture((80, 60)), small)
    frame = picture()
    for x in (68, 92):
        frame[54:66, x - 6:x + 6] = picture((80, 60))[54:66, 74:86]
    found = observation.look(frame, box, small)
    assert np.abs(found.center - box[:2]).max() < SIDE / 10
    along, across = np.sqrt(np.diag(found.covariance))
    assert along > 0.35 * SIDE > 2 * across


def test_nothing_like_the_target_tells_nothing():
    """All places are alike: the prediction, with an error as wide as the search."""
    observation, box = started()
    found = observation.look(np.full((120, 160, 3), 128, np.uint8), box, box)
    np.testing.assert_allclose(found.center, box[:2], atol=1e-9)
    assert np.sqrt(np.linalg.eigvalsh(found.covariance)).min() > 0.3 * SIDE


def test_nothing_is_measured_for_those_who_do_not_ask():
    """A filter whose proposal looks at no measurement doesn't pay for one."""
    observation, box = started(measuring=False)
    assert observation.look(picture((80, 60)), box, box) is None
