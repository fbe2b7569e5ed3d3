"""Pixels, rays and metres: exact numbers, distortion undone, covariance carried through."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, RegionOfInterest

from vtrack_ros.geometry import Box
from vtrack_ros.geometry.camera import Camera, locate, locate_velocity
from vtrack_ros.messages.camera_info import camera_from_info

PINHOLE = Camera(fx=500.0, fy=400.0, cx=319.5, cy=239.5, width=640, height=480)


def measured(cx, cy, width, height, covariance=None):
    """Return a box and its covariance."""
    matrix = np.diag([4.0, 9.0, 1.0, 1.0]) if covariance is None else covariance
    return Box.from_center(cx, cy, width, height), matrix


def info(**changes):
    """Return a calibrated camera's message with some fields changed."""
    message = CameraInfo(width=640, height=480, distortion_model='plumb_bob', d=[0.0] * 5)
    message.k = [500.0, 0.0, 319.5, 0.0, 400.0, 239.5, 0.0, 0.0, 1.0]
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_pinhole_ray_in_exact_numbers():
    """
    Rays are exact, and account for the half pixel between the two conventions.

    The middle of an image of 640 x 480 is (320, 240) as boxes count, and (319.5, 239.5) as
    camera_info does; 100 px to the right of it at fx = 500 px is x = 0.2, 80 px up at
    fy = 400 px is y = -0.2.
    """
    assert PINHOLE.ray_and_slope(320.0, 240.0)[0] == pytest.approx((0.0, 0.0), abs=1e-15)
    assert PINHOLE.ray_and_slope(420.0, 160.0)[0] == pytest.approx((0.2, -0.2), abs=1e-15)
    position = locate(*measured(420.0, 160.0, 50.0, 40.0), PINHOLE)
    assert position.units == 'ray'
    assert position.point == pytest.approx([0.2, -0.2, 1.0], abs=1e-15)


def test_pinhole_metres_in_exact_numbers():
    """A target 0.5 m wide that covers 50 px at fx = 500 px is 5 m away."""
    position = locate(*measured(420.0, 160.0, 50.0, 40.0), PINHOLE, width=0.5)
    assert position.units == 'metres'
    assert position.point == pytest.approx([1.0, -1.0, 5.0], abs=1e-12)
    # 0.8 m high, 40 px at fy = 400 px: 8 m.
    position = locate(*measured(420.0, 160.0, 50.0, 40.0), PINHOLE, height=0.8)
    assert position.point == pytest.approx([1.6, -1.6, 8.0], abs=1e-12)
    # The width counts where both are known.
    position = locate(*measured(420.0, 160.0, 50.0, 40.0), PINHOLE, width=0.5, height=0.8)
    assert position.point[2] == pytest.approx(5.0)


def test_pixels_without_calibration():
    """The centre of the box, z = 0, and the covariance of the centre."""
    covariance = np.arange(16.0).reshape(4, 4)
    covariance = covariance @ covariance.T + np.eye(4)
    position = locate(*measured(12.5, 30.25, 8.0, 6.0, covariance), None)
    assert position.units == 'pixels'
    assert list(position.point) == [12.5, 30.25, 0.0]
    assert np.array_equal(position.covariance[:2, :2], covariance[:2, :2])
    assert not position.covariance[2].any() and not position.covariance[:, 2].any()


def test_units_that_cannot_be_had():
    """Units that can't be had give None, not other units."""
    box = measured(320.0, 240.0, 50.0, 40.0)
    assert locate(*box, None, 'ray') is None
    assert locate(*box, None, 'metres', width=1.0) is None
    assert locate(*box, PINHOLE, 'metres') is None
    assert locate(*box, PINHOLE, 'pixels', width=1.0).units == 'pixels'
    assert locate(*box, PINHOLE, 'ray', width=1.0).units == 'ray'
    with pytest.raises(ValueError, match="'meters'; valid are auto, pixels, ray, metres"):
        locate(*box, PINHOLE, 'meters', width=1.0)


def test_covariance_of_the_ray():
    """Variances divide by the focal lengths squared."""
    position = locate(*measured(420.0, 160.0, 50.0, 40.0), PINHOLE)
    assert np.diag(position.covariance) == pytest.approx([4 / 500**2, 9 / 400**2, 0], abs=1e-12)


def test_covariance_in_metres_against_a_sample():
    """To first order it's the sample covariance of boxes that are drawn and located."""
    covariance = np.array([[.04, .01, 0, 0], [.01, .09, 0, 0], [0, 0, .0625, 0], [0, 0, 0, .01]])
    mean = np.array([420.0, 160.0, 50.0, 40.0])
    position = locate(*measured(*mean, covariance), PINHOLE, width=0.5)
    boxes = np.random.default_rng(0).multivariate_normal(mean, covariance, 20000)
    points = np.array([locate(*measured(*box), PINHOLE, width=0.5).point for box in boxes[:4000]])
    sample = np.cov(points.T)
    scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    # The standard error of a covariance from 4000 draws is below 2.3 % of that scale.
    assert np.abs((position.covariance - sample) / scale).max() < 0.08
    assert np.linalg.eigvalsh(position.covariance).min() > -1e-12


@pytest.mark.parametrize('model, coefficients', [
    ('plumb_bob', (-0.3, 0.1, 0.001, -0.0005, -0.02)),
    ('plumb_bob', (-0.25, 0.05, 0.0, 0.0)),
    ('rational_polynomial', (0.5, -0.1, 0.001, 0.0005, 0.01, 0.8, -0.05, 0.02)),
    ('equidistant', (-0.02, 0.01, -0.003, 0.0005)),
    ('plumb_bob', ()), ('rational_polynomial', ()), ('equidistant', ()),
])
def test_distortion_is_undone(model, coefficients):
    """The ray of a projected ray's pixel is that ray."""
    camera = Camera(500.0, 400.0, 319.5, 239.5, 640, 480, model, coefficients)
    for x in np.linspace(-0.5, 0.5, 5):
        for y in np.linspace(-0.4, 0.4, 5):
            ray, _ = camera.ray_and_slope(*camera.project(x, y))
            assert ray == pytest.approx((x, y), abs=1e-10)


@pytest.mark.parametrize('model', ['plumb_bob', 'rational_polynomial', 'equidistant'])
def test_distortion_is_opencvs(model):
    """The distortion models are OpenCV's, and so those of every calibration tool of ROS."""
    import cv2
    coefficients = {'plumb_bob': (-0.3, 0.1, 0.001, -0.0005, -0.02),
                    'rational_polynomial': (0.5, -0.1, 0.001, 0.0005, 0.01, 0.8, -0.05, 0.02),
                    'equidistant': (-0.02, 0.01, -0.003, 0.0005)}[model]
    camera = Camera(500.0, 400.0, 319.5, 239.5, 640, 480, model, coefficients)
    matrix = np.array([[500.0, 0, 319.5], [0, 400.0, 239.5], [0, 0, 1]])
    rays = np.array([[x, y, 1.0] for x in (-0.4, 0.1, 0.5) for y in (-0.3, 0.0, 0.35)])
    project = cv2.fisheye.projectPoints if model == 'equidistant' else cv2.projectPoints
    points = rays[:, None] if model == 'equidistant' else rays
    expected, _ = project(points, np.zeros(3), np.zeros(3), matrix, np.array(coefficients))
    ours = np.array([camera.project(x, y) for x, y, _ in rays])
    assert ours - 0.5 == pytest.approx(expected.reshape(-1, 2), abs=1e-9)


def test_depth_through_a_distorting_lens():
    """A target at the border, projected through the lens, is located where it was."""
    camera = Camera(500.0, 500.0, 319.5, 239.5, 640, 480, 'plumb_bob', (-0.3, 0.1, 0.0, 0.0))
    left, right = camera.project(1.0 / 4, 0.5 / 4), camera.project(1.6 / 4, 0.5 / 4)
    width = right[0] - left[0]
    box = measured((left[0] + right[0]) / 2, (left[1] + right[1]) / 2, width, 10.0)
    position = locate(*box, camera, width=0.6)
    assert position.point[2] == pytest.approx(4.0, rel=1e-3)
    # The middle of the box isn't quite the picture of the target's middle.
    assert position.point[:2] == pytest.approx([1.3, 0.5], abs=0.01)


def test_from_message_with_binning_and_region():
    """The image may be a binned part of the sensor."""
    message = info(binning_x=2, binning_y=2, roi=RegionOfInterest(
        x_offset=100, y_offset=80, width=400, height=300))
    camera = camera_from_info(message)
    assert (camera.width, camera.height) == (200, 150)
    # Sensor (320, 240) as boxes count is the optical axis: ((320 - 100) / 2, (240 - 80) / 2).
    assert camera.ray_and_slope(110.0, 80.0)[0] == pytest.approx((0.0, 0.0), abs=1e-15)
    assert camera.project(0.2, -0.2) == pytest.approx((160.0, 40.0))


@pytest.mark.parametrize('changes, words', [
    ({'k': [0.0] * 9}, 'not calibrated'),
    ({'k': [math.nan] * 9}, 'not calibrated'),
    ({'k': [-1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]}, 'not calibrated'),
    ({'distortion_model': 'thin_prism', 'd': [0.1] * 5}, 'thin_prism'),
    ({'d': [0.1, 0.1]}, '2 distortion coefficients'),
    ({'d': [math.inf] * 5}, 'finite'),
])
def test_wrong_calibration(changes, words):
    """An invalid calibration is refused with the reason."""
    with pytest.raises(ValueError, match=words):
        camera_from_info(info(**changes))


@pytest.mark.parametrize('coefficients', [(), (-0.3, 0.1, 0.001, -0.0005, -0.02)])
@pytest.mark.parametrize('size', [{}, {'width': 0.5}, {'height': 0.4}])
def test_covariance_is_the_derivative_of_the_place(coefficients, size):
    """It's J C J^T, J by central differences of the place itself."""
    camera = Camera(500.0, 400.0, 319.5, 239.5, 640, 480, 'plumb_bob', coefficients,
                    (10.0, 20.0), (2.0, 2.0))
    mean = np.array([180.0, 90.0, 40.0, 30.0])
    root = np.random.default_rng(2).normal(size=(4, 4))
    covariance = root @ root.T
    columns = []
    for index in range(4):
        step = np.eye(4)[index] * 1e-4
        places = [locate(*measured(*(mean + sign * step)), camera, **size).point
                  for sign in (1, -1)]
        columns.append((places[0] - places[1]) / 2e-4)
    slope = np.stack(columns, axis=1)
    position = locate(*measured(*mean, covariance), camera, **size)
    expected = slope @ covariance @ slope.T
    assert position.covariance == pytest.approx(expected, rel=1e-5, abs=1e-9)


def test_a_box_that_no_ray_sees():
    """Beyond the range of the lens model the position is None, rather than a wrong one."""
    camera = Camera(500.0, 500.0, 319.5, 239.5, 640, 480, 'plumb_bob', (-0.3, 0.0, 0.0, 0.0))
    # r (1 - 0.3 r^2) is at most 0.703, at r = 1.054: nothing is farther than 351 px out.
    assert all(map(math.isnan, camera.ray_and_slope(320.0 + 360.0, 240.0)[0]))
    assert not any(map(math.isnan, camera.ray_and_slope(320.0 + 340.0, 240.0)[0]))
    assert locate(*measured(320.0 + 360.0, 240.0, 10.0, 10.0), camera, width=0.5) is None


@pytest.mark.filterwarnings('error::RuntimeWarning')
@pytest.mark.parametrize('units', ['ray', 'metres'])
@pytest.mark.parametrize('focal', [3e183, 1e-200])
def test_there_is_no_place_without_a_covariance(units, focal):
    """An absurd focal length gives neither numbers that aren't finite nor warnings."""
    camera = Camera(focal, 5.8, 100.0, -7.0, 7, 1)
    position = locate(Box(1000, 700, 20, 30), np.eye(4), camera, units, 0.2)
    assert position is None or (np.isfinite(position.point).all()
                                and np.isfinite(position.covariance).all())


def located(camera, **arguments):
    """Return a function that locates boxes of zero covariance."""
    return lambda box: locate(box, np.zeros((4, 4)), camera, **arguments)


def test_velocity_in_pixels():
    """It's the centre's velocity with its covariance, and z = 0."""
    covariance = np.diag(np.arange(1.0, 9.0))
    velocity, spread = locate_velocity(
        located(None), Box(1, 2, 30, 40), np.array([5.0, -6.0, 7.0, 8.0]), covariance)
    assert velocity == pytest.approx([5, -6, 0])
    assert spread == pytest.approx(np.diag([5.0, 6.0, 0.0]))


def test_velocity_in_metres_in_exact_numbers():
    """At 5 m a px is 1 cm; a width that grows by a fifth a second comes nearer by 1 m/s."""
    box, rate = Box.from_center(320.0, 240.0, 50.0, 40.0), np.array([30.0, 0.0, 10.0, 8.0])
    velocity, _ = locate_velocity(located(PINHOLE, width=0.5), box, rate, np.eye(8))
    assert velocity == pytest.approx([0.3, 0.0, -1.0])
    velocity, _ = locate_velocity(located(PINHOLE), box, rate, np.eye(8))
    assert velocity == pytest.approx([0.06, 0.0, 0.0])


@pytest.mark.parametrize('width', [0.0, 0.5])
def test_velocity_covariance_against_a_sample(width):
    """It's that of a sample, through a distorting lens, with correlated errors of both."""
    rng = np.random.default_rng(2)
    camera = Camera(500.0, 400.0, 319.5, 239.5, 640, 480, 'plumb_bob',
                    (-0.2, 0.05, 0.001, -0.002, 0.0))
    mean = np.array([450.0, 150.0, 60.0, 50.0, 200.0, -100.0, 30.0, 20.0])
    factor = rng.normal(size=(8, 8)) * np.array([[0.3], [0.3], [0.3], [0.3], [2], [2], [2], [2]])
    covariance = factor @ factor.T
    place = located(camera, width=width)
    velocity, spread = locate_velocity(
        place, Box.from_center(*mean[:4]), mean[4:], covariance)
    step = 1e-3
    drawn = []
    for state in rng.multivariate_normal(mean, covariance, 1500):
        ends = [place(Box.from_center(*(state[:4] + sign * step * state[4:]))).point
                for sign in (1, -1)]
        drawn.append((ends[0] - ends[1]) / (2 * step))
    assert np.mean(drawn, axis=0) == pytest.approx(velocity, rel=0.02, abs=0.01)
    assert np.cov(np.transpose(drawn)) == pytest.approx(
        spread, rel=0.15, abs=0.1 * spread.diagonal().max())


def test_velocity_of_what_is_nowhere():
    """Without a place there is no velocity."""
    assert locate_velocity(located(None, units='ray'), Box(1, 2, 3, 4), np.zeros(4),
                           np.eye(8)) is None
