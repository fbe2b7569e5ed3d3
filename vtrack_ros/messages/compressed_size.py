"""The size in the header of a JPEG or PNG, checked before a decoder allocates memory for it."""

import struct

#: Upper bound of an image's size, in pixels: no camera's image is larger.
_LARGEST = 1 << 27
#: Upper bound of the pixels that a byte holds: that of PNG, which compresses more, at 1 bit each.
_PIXELS_PER_BYTE = 1032 * 8
_PNG, _JPEG = b'\x89PNG\r\n\x1a\n', b'\xff\xd8'
#: JPEG markers (ISO 10918-1): the end of an image; those without a segment, and frame headers,
#: which hold the size.
_END = b'\xff\xd9'
_ALONE = frozenset((0x01, *range(0xd0, 0xd8)))
_FRAMES = frozenset(range(0xc0, 0xd0)) - {0xc4, 0xc8, 0xcc}


def checked_size(data: bytes) -> tuple[int, int]:
    """
    Return width and height of a compressed image in pixels, as in its header.

    ValueError if it's neither a whole JPEG nor a whole PNG, or the size is more than its bytes can
    hold: a decoder would allocate that first, gigabytes for a message of two hundred bytes.
    """
    size = _png_size(data) if data.startswith(_PNG) else _jpeg_size(data)
    if size is None:
        raise ValueError('its data is neither a whole jpeg nor a whole png')
    width, height = size
    if width * height > min(_LARGEST, _PIXELS_PER_BYTE * len(data)):
        raise ValueError(f'its header says {width} x {height} pixels, which is more than it holds')
    return size


def _png_size(data: bytes) -> tuple[int, int] | None:
    if len(data) < 24 or data[12:16] != b'IHDR':
        return None
    # Chunk lengths are checked as well: a decoder allocates memory for the length given.
    at, kind = len(_PNG), b''
    while kind != b'IEND':
        if at + 12 > len(data):
            return None
        length, kind = struct.unpack_from('>I4s', data, at)
        at += 12 + length
        if at > len(data):
            return None
    width, height = struct.unpack_from('>II', data, 16)
    return width, height


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    if not data.startswith(_JPEG):
        return None
    at = 2
    while 0 <= (at := data.find(b'\xff', at)) < len(data) - 8:
        marker = data[at + 1]
        if marker in _FRAMES:
            if data.rfind(_END, at) < 0:
                # cut off: some versions of OpenCV fill the rest
                return None
            height, width = struct.unpack_from('>HH', data, at + 5)
            return width, height
        if marker in (0x00, 0xff):
            at += 1
        elif marker in _ALONE:
            at += 2
        else:
            at += 2 + int(struct.unpack_from('>H', data, at + 2)[0])
    return None
