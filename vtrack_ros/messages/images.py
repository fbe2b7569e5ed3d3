"""
Conversion between image messages and arrays.

Messages may be any objects with the attributes of sensor_msgs/msg/Image or CompressedImage, from
rclpy or from a bag: nothing here needs ROS.
"""

from array import array
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame
from vtrack_ros.messages.compressed_size import checked_size


@dataclass(frozen=True)
class _Encoding:
    """The memory layout of an encoding's pixels, and their conversion into a frame."""

    channels: int
    #: OpenCV's code for converting (H, W, channels) into BGR; None if it's BGR or grey already.
    convert: int | None = None
    bits: int = 8
    width_multiple: int = 1
    minimum_size: int = 1
    #: Bytes of chroma per two pixels, in planes after the luma plane; 0 if it isn't planar.
    colour: int = 0


def _bayer(code: int, bits: int = 8) -> _Encoding:
    return _Encoding(1, code, bits, minimum_size=3)


_UYVY = _Encoding(2, cv2.COLOR_YUV2BGR_UYVY, width_multiple=2)
_YUYV = _Encoding(2, cv2.COLOR_YUV2BGR_YUY2, width_multiple=2)


def _planar(code: int, colour: int) -> _Encoding:
    return _Encoding(1, code, width_multiple=2, colour=colour)


_I420 = _planar(cv2.COLOR_YUV2BGR_I420, 1)

# OpenCV names a Bayer pattern by the second and third pixel of the second row, ROS by the first
# two pixels of the first two rows: RGGB of ROS is BG of OpenCV.
#: The encodings that `to_frame` reads.
ENCODINGS = {
    'mono8': _Encoding(1),
    '8UC1': _Encoding(1),
    'mono16': _Encoding(1, bits=16),
    '16UC1': _Encoding(1, bits=16),
    'bgr8': _Encoding(3),
    '8UC3': _Encoding(3),
    'rgb8': _Encoding(3, cv2.COLOR_RGB2BGR),
    'bgra8': _Encoding(4, cv2.COLOR_BGRA2BGR),
    '8UC4': _Encoding(4, cv2.COLOR_BGRA2BGR),
    'rgba8': _Encoding(4, cv2.COLOR_RGBA2BGR),
    'bgr16': _Encoding(3, bits=16),
    'rgb16': _Encoding(3, cv2.COLOR_RGB2BGR, bits=16),
    'yuv422': _UYVY,
    'uyvy': _UYVY,
    'yuv422_yuy2': _YUYV,
    'yuyv': _YUYV,
    'nv12': _planar(cv2.COLOR_YUV2BGR_NV12, 1),
    'nv21': _planar(cv2.COLOR_YUV2BGR_NV21, 1),
    'i420': _I420,
    'yuv420': _I420,
    'nv16': _planar(cv2.COLOR_YUV2BGR_YUY2, 2),
    'nv61': _planar(cv2.COLOR_YUV2BGR_YVYU, 2),
    'nv24': _planar(cv2.COLOR_YUV2BGR_YUY2, 4),
    'bayer_rggb8': _bayer(cv2.COLOR_BayerBG2BGR),
    'bayer_bggr8': _bayer(cv2.COLOR_BayerRG2BGR),
    'bayer_gbrg8': _bayer(cv2.COLOR_BayerGR2BGR),
    'bayer_grbg8': _bayer(cv2.COLOR_BayerGB2BGR),
    'bayer_rggb16': _bayer(cv2.COLOR_BayerBG2BGR, 16),
    'bayer_bggr16': _bayer(cv2.COLOR_BayerRG2BGR, 16),
    'bayer_gbrg16': _bayer(cv2.COLOR_BayerGR2BGR, 16),
    'bayer_grbg16': _bayer(cv2.COLOR_BayerGB2BGR, 16),
}


def to_frame(message: Any) -> Frame:
    """
    Return the pixels of an image message.

    Sixteen bits are scaled to eight by the full range (65535 becomes 255), whatever the image
    holds, so that the brightness of a scene doesn't jump from frame to frame.

    The frame, (H, W, 3) in BGR order or (H, W), is contiguous; where nothing has to be converted
    it shares the message's memory, and is read-only if that is. ValueError if the encoding is
    unknown, the size is zero, or step and data don't fit the size.
    """
    width, height, step = int(message.width), int(message.height), int(message.step)
    encoding = _encoding(message.encoding, width, height)
    row = width * encoding.channels * encoding.bits // 8
    if step < row:
        raise ValueError(
            f'image step is {step} bytes, but {width} pixels of {message.encoding} need at '
            f'least {row}')
    data = _bytes(message.data)
    colour = step * height * encoding.colour // 2
    if data.size != step * height + colour:
        planes = f', and {colour} of colour after it' if colour else ''
        raise ValueError(
            f'image data has {data.size} bytes, but step {step} times height {height} is '
            f'{step * height}{planes}')
    if colour:
        return _from_planes(data, width, height, step, encoding)
    shape: tuple[int, ...] = (height, width)
    if encoding.channels > 1:
        shape += (encoding.channels,)
    if encoding.bits == 16:
        return _sixteen_bits(data, shape, step, bool(message.is_bigendian), encoding)
    pixels = data.reshape(height, step)[:, :row].reshape(shape)
    if encoding.convert is None:
        return np.ascontiguousarray(pixels)
    return _converted(pixels, encoding.convert)


def decoded(message: Any) -> Frame:
    """Return the frame of an Image or a CompressedImage; ValueError if it can't be read."""
    return compressed_to_frame(message) if hasattr(message, 'format') else to_frame(message)


def compressed_to_frame(message: Any) -> Frame:
    """
    Return the pixels of a compressed image message, JPEG or PNG.

    Of shape (H, W, 3) in BGR order or (H, W); ValueError if the data can't be decoded.
    """
    if 'compressedDepth' in message.format:
        raise ValueError(
            f'compressed image format {message.format!r} is a depth image; valid are jpeg and png')
    data = _bytes(message.data)
    flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    pixels, fault = None, 'its data is neither a whole jpeg nor a whole png'
    try:
        checked_size(data.tobytes())
        pixels = cv2.imdecode(data, flags)
    except cv2.error:
        pass
    except ValueError as error:
        fault = str(error)
    if pixels is None:
        raise ValueError(f'compressed image of {data.size} bytes, format {message.format!r}, '
                         f"can't be decoded: {fault}")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f'compressed image holds {pixels.dtype} values; valid are 8 or 16 bits per channel')
    wide = pixels.dtype == np.uint16
    frame = _narrowed(pixels.astype(np.uint16)) if wide else np.asarray(pixels, np.uint8)
    if frame.ndim == 3 and frame.shape[2] == 4:
        return _converted(frame, cv2.COLOR_BGRA2BGR)
    return np.ascontiguousarray(frame)


def fill_image(message: Any, frame: Frame) -> None:
    """Write a frame, mono8 or bgr8, into an image message: all but the header."""
    message.height, message.width = frame.shape[:2]
    message.encoding = 'mono8' if frame.ndim == 2 else 'bgr8'
    message.is_bigendian = 0
    message.step = frame.shape[1] * (1 if frame.ndim == 2 else 3)
    # rclpy takes an array.array as it is, but copies a list, ndarray or memoryview by elements.
    data = array('B')
    data.frombytes(np.ascontiguousarray(frame).data)
    message.data = data


def stamp_nanoseconds(stamp: Any) -> int:
    """Return a builtin_interfaces/msg/Time, or anything with its attributes, in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _encoding(name: str, width: int, height: int) -> _Encoding:
    if name not in ENCODINGS:
        raise ValueError(f'unknown image encoding {name!r}; valid are ' + ', '.join(ENCODINGS))
    if width <= 0 or height <= 0:
        raise ValueError(f'image size is {width} x {height}; both must be at least 1')
    encoding = ENCODINGS[name]
    if min(width, height) < encoding.minimum_size:
        raise ValueError(
            f'image size is {width} x {height}, but {name} needs at least '
            f'{encoding.minimum_size} x {encoding.minimum_size}')
    if width % encoding.width_multiple:
        raise ValueError(
            f'image width is {width}, but {name} needs a multiple of {encoding.width_multiple}')
    if encoding.colour == 1 and height % 2:
        raise ValueError(f'image height is {height}, but {name} needs a multiple of 2')
    return encoding


def _bytes(data: Any) -> NDArray[np.uint8]:
    """Return a message's data as bytes, without a copy."""
    return np.frombuffer(data, np.uint8) if len(data) else np.zeros(0, np.uint8)


def _from_planes(data: NDArray[np.uint8], width: int, height: int, step: int,
                 encoding: _Encoding) -> Frame:
    assert encoding.convert is not None
    luma = data[:step * height].reshape(height, step)[:, :width]
    colour = data[step * height:]
    if encoding is _I420:
        if step % 2:
            raise ValueError(f'image step is {step} bytes, but i420 needs a multiple of 2')
        # The U plane, then the V plane, with rows half as long.
        colour = colour.reshape(height, -1)[:, :width // 2].reshape(-1, width)
    elif encoding.colour == 4:
        # OpenCV has no conversion with chroma for every pixel: that of every second one is used.
        colour = colour.reshape(height, -1)[:, :2 * width].reshape(height, -1, 4)[:, :, :2]
        colour = colour.reshape(height, width)
    else:
        colour = colour.reshape(-1, step)[:, :width]
    if encoding.colour == 1:
        return _converted(np.vstack((luma, colour)), encoding.convert)
    return _converted(np.dstack((luma, colour)), encoding.convert)


def _sixteen_bits(data: NDArray[np.uint8], shape: tuple[int, ...], step: int, bigendian: bool,
                  encoding: _Encoding) -> Frame:
    strides = (step, 2 * encoding.channels, 2)[:len(shape)]
    kind = np.dtype('>u2' if bigendian else '<u2')
    pixels = np.ndarray(shape, kind, data, strides=strides)
    narrow = _narrowed(np.ascontiguousarray(pixels, np.uint16))
    return narrow if encoding.convert is None else _converted(narrow, encoding.convert)


def _narrowed(pixels: NDArray[np.uint16]) -> Frame:
    return np.asarray(cv2.convertScaleAbs(pixels, alpha=255 / 65535), np.uint8)


def _converted(pixels: NDArray[np.uint8], code: int) -> Frame:
    return np.asarray(cv2.cvtColor(pixels, code), np.uint8)
