"""Estimates as messages: signs, units, and unknown values."""

import math

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from vtrack_ros.bags.messages import typestore
from vtrack_ros.geometry import Box
from vtrack_ros.messages import poses
from vtrack_ros.messages.detections import detections, oriented_box
from vtrack_ros.ros.message_types import MessageTypes
from vtrack_ros.tracker import Estimate, TrackState

TYPES = MessageTypes()


def estimate(state=TrackState.TRACKING, angle=0.0, affine=None):
    """Return an estimate."""
    return Estimate(Box(10, 20, 30, 40), angle, np.eye(4), 0.75, state, affine=affine)


def test_rotation_is_about_the_optical_axis():
    """A positive angle turns x (right) towards y (down): clockwise as one looks at the image."""
    angle = 0.3
    q = poses.rotation(TYPES, angle)
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
    bounds = oriented_box(TYPES, estimate(angle=0.3, affine=affine))
    assert bounds.center.theta == pytest.approx(-0.3)
    assert (bounds.size_x, bounds.size_y) == pytest.approx((30.0, 12.0))
    assert (bounds.center.position.x, bounds.center.position.y) == pytest.approx((50.0, 60.0))
    # Where the right end of the target's own x axis is: to the right and down.
    end = affine @ [0.5, 0.0, 1.0]
    assert end[0] > 50.0 and end[1] > 60.0


def test_plain_box_where_there_is_no_frame():
    """Without an affine frame it's the upright bounding box."""
    bounds = oriented_box(TYPES, estimate(angle=0.3))
    assert bounds.center.theta == 0.0
    assert (bounds.center.position.x, bounds.center.position.y) == (25.0, 40.0)
    assert (bounds.size_x, bounds.size_y) == (30.0, 40.0)


def test_covariance_layout():
    """Row by row over position and rotation; an unknown angle has a uniform one's variance."""
    position = np.arange(1.0, 10.0).reshape(3, 3)
    message = poses.pose_with_covariance(TYPES, (1.0, 2.0, 3.0), 0.0, position)
    full = message.covariance.reshape(6, 6)
    assert np.array_equal(full[:3, :3], position)
    assert not full[:3, 3:].any() and not full[3:, :3].any()
    angles = np.random.default_rng(0).uniform(-math.pi, math.pi, 100000)
    assert full[3, 3] == pytest.approx(angles.var(), rel=0.02)


def test_twist_layout():
    """Row by row over linear and angular velocity, the latter unknown; all 0 for NaN."""
    covariance = np.arange(1.0, 10.0).reshape(3, 3)
    message = poses.twist_with_covariance(TYPES, np.array([1.0, 2.0, 3.0]), covariance)
    linear, angular = message.twist.linear, message.twist.angular
    assert (linear.x, linear.y, linear.z) == (1, 2, 3)
    assert (angular.x, angular.y, angular.z) == (0, 0, 0)
    full = message.covariance.reshape(6, 6)
    assert np.array_equal(full[:3, :3], covariance)
    assert not full[:3, 3:].any() and not full[3:, :3].any()
    assert (full[3:, 3:].diagonal() >= 1e6).all()
    unknown = poses.twist_with_covariance(TYPES, np.zeros(3), np.full((3, 3), np.nan))
    assert not unknown.covariance.any()


def test_particles():
    """Centres in pixels; none where a tracker has none."""
    header = Header(frame_id='eye')
    particles = np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])
    cloud = poses.particle_poses(TYPES, header, particles)
    assert cloud.header == header
    assert [(pose.position.x, pose.position.y) for pose in cloud.poses] == [(1, 2), (5, 6)]
    assert poses.particle_poses(TYPES, header, None).poses == []


def test_ros_and_bags_have_the_same_detections():
    """One builder fills rclpy's classes and those of rosbags: the bytes are the same."""
    def built(types):
        header = poses.header(types, 5 * 10**9 + 7, 'eye')
        return detections(types, header, Box(1.5, 2.0, 30.0, 40.0), 0.25, 0.75, 'ball', '3',
                          np.eye(3))
    kind = 'vision_msgs/msg/Detection2DArray'
    store = typestore()
    written = bytes(store.serialize_cdr(built(store.types), kind))
    assert deserialize_message(written, TYPES[kind]) == built(TYPES)
    assert not detections(TYPES, poses.header(TYPES, 0, ''), None).detections
