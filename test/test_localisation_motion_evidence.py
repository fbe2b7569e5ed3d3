"""The log-odds of a target's presence by its motion over the ground."""

from drawn_video import texture
import numpy as np
import pytest

from vtrack_ros.appearance.image_motion import SparsePicture
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.motion_evidence import MotionEvidence

SCENE = texture((1200, 1200), [(40, 60, 80), (200, 190, 180), (120, 90, 160)], 20,
                np.random.default_rng(2))
WIDTH = 320
SIDE = 30.0


class Walk:
    """A target moves over the ground, and a camera by `turns`, both diagonally, [px/frame]."""

    def __init__(self, turns=0):
        self.turns, self.turned, self.x = turns, 0, 300.0
        self.evidence = MotionEvidence(self.picture(), self.box())

    def picture(self):
        """Return what the camera sees."""
        start = 20 + self.turned
        return SparsePicture.of(SCENE[start:start + 240, start:start + WIDTH])

    def box(self):
        """Return where the target is in it."""
        return Box.from_center(
            self.x - self.turned, self.x - 180.0 - self.turned, SIDE, SIDE)

    def go(self, speed, frames, dt=1):
        """Move for some frames; return the log-odds of the last one."""
        for _ in range(frames):
            self.x += speed * dt
            self.turned += self.turns * dt
            value = self.evidence.update(self.picture(), self.box(), dt)
        return value


@pytest.mark.parametrize('turns', [0, 3])
@pytest.mark.parametrize('speed', [0.0, 0.3, 2.0])
@pytest.mark.parametrize('dt', [1, 2])
def test_a_target_that_moves_as_ever_is_believed(turns, speed, dt):
    """At a constant speed, also at rest, the log-odds are 0.3 to 0.5, however the camera turns."""
    assert 0.3 < Walk(turns).go(speed, 60, dt) < 0.5


@pytest.mark.parametrize('turns', [0, 3])
def test_a_target_that_comes_to_rest_on_the_ground_is_doubted_for_a_while(turns):
    """A stop lowers the log-odds to -1.4 to -1.8; in time they're positive, as it may stop."""
    walk = Walk(turns)
    walk.go(2.0, 40)
    assert walk.go(0.0, 10) < -1.0
    # a longer rest subtracts no more than that, and in time it's usual
    least = min(walk.go(0.0, 5) for _ in range(6))
    assert -1.8 < least < -1.4
    assert walk.go(0.0, 160) > 0.1


def test_a_target_at_rest_in_the_picture_of_a_camera_that_turns_moves():
    """A target that the camera follows, at rest in the picture, moves as usual over the ground."""
    walk = Walk(turns=2)
    assert 0.3 < walk.go(2.0, 60) < 0.5


def test_haste_is_doubted_less_than_rest():
    """A sudden speed subtracts less than a stop, for targets dart off sometimes."""
    walk = Walk()
    walk.go(0.3, 40)
    assert -0.2 < walk.go(6.0, 8) < 0.1


def test_of_a_target_that_was_just_pointed_out_nothing_is_usual():
    """In the first frames the log-odds are 0."""
    walk = Walk()
    assert walk.go(6.0, 3) == walk.go(0.0, 2) == 0


def test_a_target_found_elsewhere_moves_as_usual():
    """After a restart neither the way to the new place nor the rest before counts."""
    walk = Walk()
    walk.go(2.0, 41)
    assert walk.go(0.0, 10) < -0.8
    walk.x += 150.0
    walk.evidence.restart()
    assert 0.3 < walk.go(2.0, 1) < 0.5
    assert walk.go(2.0, 6) > 0.2


def test_where_the_ground_has_no_texture_nothing_is_said():
    """The ground's motion is unknown there: the log-odds are 0."""
    blank = np.full((240, WIDTH, 3), 120, np.uint8)
    evidence = MotionEvidence(SparsePicture.of(blank), Box.from_center(100, 120, SIDE, SIDE))
    for step in range(40):
        box = Box.from_center(100 + 2 * min(step, 20), 120, SIDE, SIDE)
        assert evidence.update(SparsePicture.of(blank), box, 1.0) == 0
