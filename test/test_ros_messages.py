"""What a tracker knows, as messages: signs, units, and nothing made up."""

import math

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from std_msgs.msg import Header
from vision_msgs.msg import BoundingBox2D

from vtrack_ros.geometry import Box
from vtrack_ros.ros import messages
from vtrack_ros.trackers import Estimate, TrackState


def estimate(state=TrackState.TRACKING, angle=0.0, affine=None):
    """Return an estimate."""
    return Estimate(Box(10, 20, 30, 40), angle, np.eye(4), 0.75, state, affine=affine)


def test_rotation_is_about_the_optical_axis():
    """A positive angle turns x (right) towards y (down): clockwise as one looks at the image."""
    angle = 0.3
    q = messages.rotation(angle)
    assert q.x == q.y == 0.0
    assert q.z**2 + q.w**2 == pytest.approx(1.0)
    # The first column of the rotation matrix of a unit quaternion is where x goes.
    assert 1 - 2 * q.z**2 == pytest.approx(math.cos(angle))
    assert 2 * q.z * q.w == pytest.approx(math.sin(angle))


def test_theta_is_counterclockwise():
    """
    vision_msgs' theta has the other sign.

    A target turned clockwise on the image by 0.3 rad has theta = -0.3, and the size of its own
    sides, not of its bound.
    """
    turn = np.array([[math.cos(0.3), -math.sin(0.3)], [math.sin(0.3), math.cos(0.3)]])
    affine = np.eye(3)
    affine[:2, :2] = turn @ np.diag([30.0, 12.0])
    affine[:2, 2] = 50.0, 60.0
    bounds = BoundingBox2D()
    messages.fill_oriented(bounds, estimate(angle=0.3, affine=affine))
    assert bounds.center.theta == pytest.approx(-0.3)
    assert (bounds.size_x, bounds.size_y) == pytest.approx((30.0, 12.0))
    assert (bounds.center.position.x, bounds.center.position.y) == pytest.approx((50.0, 60.0))
    # Where the right end of the target's own x axis is: to the right and down.
    end = affine @ [0.5, 0.0, 1.0]
    assert end[0] > 50.0 and end[1] > 60.0


def test_plain_box_where_there_is_no_frame():
    """Without an affine frame the bound is what is known."""
    bounds = BoundingBox2D()
    messages.fill_oriented(bounds, estimate(angle=0.3))
    assert bounds.center.theta == 0.0
    assert (bounds.center.position.x, bounds.center.position.y) == (25.0, 40.0)
    assert (bounds.size_x, bounds.size_y) == (30.0, 40.0)


def test_covariance_layout():
    """Row by row over position and rotation; what isn't known of the rotation is uniform."""
    position = np.arange(1.0, 10.0).reshape(3, 3)
    full = np.array(messages.covariance36(position)).reshape(6, 6)
    assert np.array_equal(full[:3, :3], position)
    assert not full[:3, 3:].any() and not full[3:, :3].any()
    angles = np.random.default_rng(0).uniform(-math.pi, math.pi, 100000)
    assert full[3, 3] == pytest.approx(angles.var(), rel=0.02)


@pytest.mark.parametrize('word, state, level', [
    ('tracking', TrackState.TRACKING, DiagnosticStatus.WARN),
    ('lost', TrackState.LOST, DiagnosticStatus.ERROR),
    ('paused', TrackState.TRACKING, DiagnosticStatus.OK),
    ('inactive', TrackState.LOST, DiagnosticStatus.OK)])
def test_stale_state(word, state, level):
    """What was measured a while ago isn't well, unless somebody wanted it so."""
    status = messages.state_status('/tracker', 'gmpf', word, estimate(state), {}, stale=True)
    assert (status.message, status.level) == (word, level)
    assert {row.key: row.value for row in status.values}['box'] == 'stale'


@pytest.mark.parametrize('state, level', [
    (TrackState.TRACKING, DiagnosticStatus.OK), (TrackState.SEARCHING, DiagnosticStatus.WARN),
    (TrackState.LOST, DiagnosticStatus.ERROR)])
def test_state(state, level):
    """The level says how bad it is, and the values whether the box was measured."""
    status = messages.state_status('/tracker', 'gmpf', state.value, estimate(state), {'a': 'b'})
    values = {row.key: row.value for row in status.values}
    assert status.level == level and status.message == state.value
    assert status.name == '/tracker: target' and status.hardware_id == 'gmpf'
    assert values['box'] == ('measured' if state is TrackState.TRACKING else 'predicted')
    assert values['confidence'] == '0.750' and values['a'] == 'b'


def test_particles():
    """Centres in pixels; none where a tracker has none."""
    header = Header(frame_id='eye')
    cloud = messages.particle_poses(header, np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]]))
    assert cloud.header == header
    assert [(pose.position.x, pose.position.y) for pose in cloud.poses] == [(1, 2), (5, 6)]
    assert messages.particle_poses(header, None).poses == []
