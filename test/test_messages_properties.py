"""Arbitrary messages: what is read of them is valid, or they're refused with a ValueError."""

import json
from types import SimpleNamespace

import cv2
from hypothesis import example, given, strategies as st
import numpy as np

from vtrack_ros.geometry import Box
from vtrack_ros.geometry.camera import locate
from vtrack_ros.messages.camera_info import camera_from_info
from vtrack_ros.messages.images import compressed_to_frame, ENCODINGS, to_frame
from vtrack_ros.session.saved_target import MARK, SavedTarget

SIZES = st.integers(0, 9) | st.integers(0, 2**32 - 1)
#: Offsets from the right lengths, mostly 0.
OFF = st.sampled_from([0, 0, 0, 0, 1, -1, 7])


@st.composite
def images(draw):
    """Draw an image message, more often a valid one than not."""
    encoding = draw(st.sampled_from([*ENCODINGS]) | st.text('bgr8_ ', max_size=8))
    known = ENCODINGS.get(encoding)
    width, height = draw(SIZES), draw(SIZES)
    row = width * known.channels * known.bits // 8 if known else width
    step = max(0, row + draw(OFF)) if draw(st.booleans()) else row
    length = step * height + (step * height * known.colour // 2 if known else 0) + draw(OFF)
    data = draw(st.binary(min_size=1, max_size=16))
    length = min(max(0, length), 5000)
    data = (data * (length // len(data) + 1))[:length]
    return SimpleNamespace(width=width, height=height, step=step % 2**32, encoding=encoding,
                           is_bigendian=draw(st.integers(0, 255)), data=data)


def sound(frame, width=None, height=None):
    """Check a frame."""
    assert frame.dtype == np.uint8 and frame.flags.c_contiguous
    assert frame.ndim == 2 or frame.shape[2:] == (3,)
    assert width is None or frame.shape[:2] == (height, width)


@given(images())
def test_an_image_is_a_frame_or_refused(message):
    """A frame has the message's width and height, whatever step, encoding and data are."""
    try:
        frame = to_frame(message)
    except ValueError as error:
        assert str(error).startswith(('image ', 'unknown image encoding'))
    else:
        sound(frame, message.width, message.height)


PICTURE = np.arange(7 * 9 * 3, dtype=np.uint8).reshape(7, 9, 3)
FILES = [cv2.imencode(kind, picture)[1].tobytes() for kind, picture in (
    ('.jpg', PICTURE), ('.png', PICTURE), ('.png', PICTURE.astype(np.uint16)),
    ('.png', PICTURE[:, :, 0]), ('.bmp', PICTURE), ('.tiff', PICTURE.astype(np.float32)))]


@st.composite
def damaged(draw, contents):
    """Draw data with some bytes changed, and cut off somewhere."""
    data = bytearray(draw(st.sampled_from(contents)))
    for _ in range(draw(st.integers(0, 3))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    return bytes(data[:draw(st.integers(0, len(data)) | st.just(len(data)))])


# The size in a header must not be believed: none of these takes the memory of a large image.
@given(damaged(FILES) | st.binary(max_size=60), st.sampled_from(['jpeg', 'png', '', 'x']))
def test_a_compressed_image_is_a_frame_or_refused(data, kind):
    """Whole, damaged and cut-off files, and random bytes, are each read as a frame or refused."""
    try:
        frame = compressed_to_frame(SimpleNamespace(format=kind, data=data))
    except ValueError as error:
        assert str(error).startswith('compressed image')
    else:
        sound(frame)


NUMBERS = st.floats() | st.floats(-10, 10) | st.sampled_from([0.0, 1.0, 100.0])


@given(st.builds(
    SimpleNamespace, width=SIZES, height=SIZES,
    distortion_model=st.sampled_from(['', 'plumb_bob', 'rational_polynomial', 'equidistant']),
    d=st.lists(NUMBERS, max_size=9), k=st.lists(NUMBERS, min_size=9, max_size=9),
    r=st.lists(NUMBERS, min_size=9, max_size=9), p=st.lists(NUMBERS, min_size=12, max_size=12),
    binning_x=SIZES, binning_y=SIZES, roi=st.builds(
        SimpleNamespace, x_offset=SIZES, y_offset=SIZES, width=SIZES, height=SIZES,
        do_rectify=st.booleans())), st.floats(-100, 1000), st.floats(-100, 1000))
def test_a_calibration_is_a_camera_or_refused(info, x, y):
    """An accepted one gives a finite position with a finite covariance, or None."""
    try:
        camera = camera_from_info(info)
    except ValueError as error:
        assert str(error).startswith('camera_info')
        return
    for units, width in (('ray', 0.0), ('metres', 0.2)):
        place = locate(Box(x, y, 20, 30), np.eye(4), camera, units, width)
        assert place is None or np.isfinite(place.point).all()
        assert place is None or np.isfinite(place.covariance).all()


TARGET = SavedTarget('/tracker', 'gmpf', ('target', '1'), 1, 2, 3, 'camera', (7, 9, 3),
                     Box(1, 1, 3, 3), (0, 0, 9, 7), FILES[0], Box(1, 1, 2, 2), FILES[0]).text()
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text('x', max_size=2),
    lambda deeper: st.lists(deeper, max_size=4) | st.dictionaries(
        st.sampled_from(['x', 'y', 'width', 'height']), deeper), max_leaves=6)


@given(damaged([TARGET.encode()]), st.sampled_from(sorted(json.loads(TARGET))), VALUES)
@example(TARGET.encode(), 'format', None)
def test_a_saved_target_is_one_or_refused(data, name, value):
    """With damaged bytes, or with values of wrong types, it's read as a target or refused."""
    rows = json.loads(TARGET)
    rows[name] = value
    for text in (data.decode('latin-1'), f'{MARK}, {json.dumps(rows)[1:]}'):
        try:
            target = SavedTarget.parsed(text)
            if np.prod(target.shape) > 10**6:
                continue
            for image in (target.measurement().frame,
                          target.exemplar().placed(target.box, target.shape, target.angle)):
                sound(image, target.shape[1], target.shape[0])
        except ValueError:
            pass
