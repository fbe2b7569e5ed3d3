"""Properties of every tracker for any image, box, parameters and intervals."""

from drawn_video import DrawnVideo, SIZE, START, TARGET
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from siamese_files import network_files

from vtrack_ros.geometry import Box
from vtrack_ros.trackers import create_tracker, tracker_class, tracker_names, TrackState

#: Upper bound of the number of particles: more take long, and test nothing else.
PARTICLES = 40
#: Fewer examples than by default, for each one runs a tracker on several frames.
FEW = settings(max_examples=settings.default.max_examples // 20)


@st.composite
def arrays(draw, shape):
    """Draw a frame: noise, an edge, a texture or nothing at all, in any order in memory."""
    rng = np.random.default_rng(draw(st.integers(0, 1 << 32)))
    kind = draw(st.sampled_from(['noise', 'black', 'white', 'edge', 'texture', 'dot']))
    height, width = shape[:2]
    if kind == 'noise':
        frame = rng.integers(0, 256, shape)
    elif kind == 'edge':
        frame = np.zeros(shape)
        frame[:, rng.integers(width + 1):] = 255
    elif kind == 'texture':
        coarse = rng.integers(0, 256, (height // 5 + 1, width // 5 + 1, *shape[2:]))
        frame = np.repeat(np.repeat(coarse, 5, 0), 5, 1)[:height, :width]
    else:
        frame = np.full(shape, 255 if kind == 'white' else 0)
        if kind == 'dot':
            frame[rng.integers(height), rng.integers(width)] = 255
    frame = frame.astype(np.uint8)
    layout = draw(st.sampled_from(['C', 'F', 'reversed', 'padded', 'read-only']))
    if layout == 'F':
        frame = np.asfortranarray(frame)
    elif layout == 'reversed':
        frame = np.ascontiguousarray(frame[::-1, ::-1])[::-1, ::-1]
    elif layout == 'padded':
        beyond = np.pad(frame, [(1, 2), (3, 4), (0, 1)][:frame.ndim])
        frame = beyond[(np.s_[1:-2], np.s_[3:-4], np.s_[:-1])[:frame.ndim]]
    elif layout == 'read-only':
        frame.flags.writeable = False
    return frame


@st.composite
def boxes(draw, shape):
    """Draw a box with a part inside the image, however much lies beyond it."""
    def side(length):
        size = draw(st.one_of(st.floats(0.1, 2.0 * length), st.floats(1e-3, 1e4)))
        # A thousandth of a pixel, or half of a smaller box, is inside at least.
        share = min(1e-3, size / 2)
        return draw(st.floats(share - size, length - share)), size
    (x, width), (y, height) = side(shape[1]), side(shape[0])
    return Box(x, y, width, height)


@st.composite
def parameters(draw, name):
    """Draw some parameters of a tracker, anywhere in their ranges."""
    values = {}
    for row in tracker_class(name).PARAMETERS.values():
        if row.choices:
            values[row.name] = draw(st.sampled_from(row.choices))
        elif row.kind is bool:
            values[row.name] = draw(st.booleans())
        elif row.kind is float:
            values[row.name] = draw(st.floats(row.low, row.high) | st.just(row.default))
        elif row.kind is int:
            most = min(row.high, PARTICLES) if 'particles' in row.name else row.high
            values[row.name] = draw(st.integers(row.low, max(row.low, most)))
    if 'localiser' in values:
        values.update(network_files())
    return values


def check(estimate, shape, anywhere):
    """Check an estimate; unless it may be `anywhere`, its centre must be inside the image."""
    assert np.isfinite(estimate.box.as_array()).all()
    x, y = estimate.box.center
    if not anywhere:
        assert -1e-6 <= x <= shape[1] + 1e-6 and -1e-6 <= y <= shape[0] + 1e-6
    assert 0 <= estimate.confidence <= 1
    assert isinstance(estimate.state, TrackState)
    assert np.isfinite(estimate.angle)
    covariance = estimate.covariance
    assert covariance.shape == (4, 4) and np.isfinite(covariance).all()
    scale = np.abs(covariance).max()
    np.testing.assert_allclose(covariance, covariance.T, rtol=0, atol=1e-9 * scale)
    assert np.linalg.eigvalsh((covariance + covariance.T) / 2).min() >= -1e-9 * scale
    if estimate.particles is not None:
        assert np.isfinite(estimate.particles).all()


@pytest.mark.parametrize('name', [
    name for name in tracker_names() if not name.startswith('opencv_')])
@FEW
@given(data=st.data())
def test_every_estimate_is_sound(name, data):
    """For any input it's finite, inside the image, with a valid covariance and confidence."""
    # The given box may have its centre outside the image, and so may replicas' boxes.
    replica = name not in tracker_names(replicas=False)
    size = st.integers(1, 64)
    shape = (data.draw(size), data.draw(size), *data.draw(st.sampled_from([(3,), ()])))
    values = data.draw(parameters(name))
    tracker = create_tracker(name, seed=data.draw(st.integers(0, 1 << 31)), **values)
    box = data.draw(boxes(shape))
    check(tracker.start(data.draw(arrays(shape)), box), shape, True)
    for _ in range(data.draw(st.integers(1, 4))):
        if data.draw(st.integers(0, 4)) == 0:
            tracker.configure(**data.draw(parameters(name)))
        dt = data.draw(st.floats(1e-3, 30.0) | st.sampled_from([1.0, 1e-9, 1e9]))
        check(tracker.update(data.draw(arrays(shape)), dt), shape, replica)


@pytest.mark.parametrize('name', tracker_names(replicas=False))
@FEW
@given(shape=st.lists(st.integers(0, 5), max_size=4), kind=st.sampled_from(
    ['?', 'i1', 'u1', 'u2', 'f4', 'f8', 'c16', 'O', 'U1', 'M8[s]']))
def test_what_is_no_frame_is_refused(name, shape, kind):
    """Another type is a TypeError, another shape a ValueError."""
    frame = np.zeros(shape, kind)
    tracker = create_tracker(name, seed=0)
    error = TypeError if frame.dtype != np.uint8 else ValueError
    if error is ValueError and 0 not in shape and (
            len(shape) == 2 or len(shape) == 3 and shape[2] == 3):
        return
    with pytest.raises(error, match='frame must'):
        tracker.start(frame, Box(0, 0, 2, 2))


@pytest.mark.parametrize('name', ['dcf', 'gmpf', 'pqkpf', 'abmspf', 'pf'])
@pytest.mark.parametrize('inwards', [0.0, 0.5])
def test_a_target_at_any_border_stays_where_it_is(name, inwards):
    """One whose centre is on the border, or half a pixel from it, isn't moved by any of them."""
    frame = DrawnVideo(seed=1).frame(START, noise=0.0)
    left, top = round(START[0]), round(START[1])
    for part in ((0, 0, left, SIZE[1]), (left, 0, SIZE[0], SIZE[1]),
                 (0, 0, SIZE[0], top), (0, top, SIZE[0], SIZE[1])):
        center = [min(max(place, low + inwards), high - inwards) - low
                  for place, low, high in zip(START, part[:2], part[2:])]
        image = frame[part[1]:part[3], part[0]:part[2]]
        tracker = create_tracker(name, seed=0)
        tracker.start(image, Box.from_center(*center, *TARGET))
        for _ in range(4):
            estimate = tracker.update(image)
        assert estimate.box.center == pytest.approx(center, abs=0.45)
