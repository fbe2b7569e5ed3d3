"""Image messages to frames and back, against plain computations pixel by pixel."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from vtrack_ros.messages.images import (
    compressed_to_frame, ENCODINGS, fill_image, stamp_nanoseconds, to_frame)

WIDTH, HEIGHT = 8, 6
CHANNELS = {'mono8': 1, '8UC1': 1, 'mono16': 1, '16UC1': 1, 'bgr8': 3, '8UC3': 3, 'rgb8': 3,
            'bgra8': 4, '8UC4': 4, 'rgba8': 4, 'bgr16': 3, 'rgb16': 3}
#: For each encoding, the channels that are blue, green and red.
ORDER = {'bgr8': (0, 1, 2), '8UC3': (0, 1, 2), 'rgb8': (2, 1, 0), 'bgra8': (0, 1, 2),
         '8UC4': (0, 1, 2), 'rgba8': (2, 1, 0), 'bgr16': (0, 1, 2), 'rgb16': (2, 1, 0)}
#: The colours of the top left four pixels, as the encoding's name spells them.
BAYER = {'bayer_rggb8': 'rggb', 'bayer_bggr8': 'bggr', 'bayer_gbrg8': 'gbrg',
         'bayer_grbg8': 'grbg'}


def message(values, encoding, padding=0, bigendian=False):
    """Return an image message of rows of values, each row followed by bytes of padding."""
    ordered = values.astype(values.dtype.newbyteorder('>' if bigendian else '<'))
    data = b''.join(row.tobytes() + b'\xa5' * padding for row in ordered)
    return SimpleNamespace(
        height=len(values), width=WIDTH, encoding=encoding, step=values[0].nbytes + padding,
        is_bigendian=int(bigendian), data=data)


def random_values(per_row, bits=8, seed=1):
    """Return random rows."""
    kind = np.uint16 if bits == 16 else np.uint8
    return np.random.default_rng(seed).integers(0, 2 ** bits, (HEIGHT, per_row)).astype(kind)


@pytest.mark.parametrize('padding', [0, 1, 7])
@pytest.mark.parametrize('bigendian', [False, True])
@pytest.mark.parametrize('encoding', CHANNELS)
def test_pixel_by_pixel(encoding, bigendian, padding):
    """Every pixel has the value of its bytes, whatever the padding between the rows."""
    bits = 16 if '16' in encoding else 8
    values = random_values(WIDTH * CHANNELS[encoding], bits)
    frame = to_frame(message(values, encoding, padding, bigendian))
    assert frame.dtype == np.uint8 and frame.flags.c_contiguous
    for y in range(HEIGHT):
        for x in range(WIDTH):
            start = x * CHANNELS[encoding]
            pixel = [int(value) for value in values[y, start:start + CHANNELS[encoding]]]
            if bits == 16:
                pixel = [round(value * 255 / 65535) for value in pixel]
            if encoding in ORDER:
                assert frame[y, x].tolist() == [pixel[index] for index in ORDER[encoding]]
            else:
                assert frame[y, x] == pixel[0]


@pytest.mark.parametrize('padding', [0, 3])
@pytest.mark.parametrize('encoding, places', [
    ('yuv422', (1, 3, 0, 2)), ('uyvy', (1, 3, 0, 2)),
    ('yuv422_yuy2', (0, 2, 1, 3)), ('yuyv', (0, 2, 1, 3))])
def test_yuv_is_bt601(encoding, places, padding):
    """Two pixels share their colour; the conversion is BT.601 with studio range."""
    rng = np.random.default_rng(2)
    values = random_values(2 * WIDTH)
    first, second, u_at, v_at = places
    values[:, first::4] = rng.integers(60, 180, (HEIGHT, WIDTH // 2))
    values[:, second::4] = rng.integers(60, 180, (HEIGHT, WIDTH // 2))
    frame = to_frame(message(values, encoding, padding)).astype(float)
    for y in range(HEIGHT):
        for x in range(WIDTH):
            group = values[y, 4 * (x // 2):4 * (x // 2) + 4].astype(float)
            light = 1.164 * (group[second if x % 2 else first] - 16)
            u, v = group[u_at] - 128, group[v_at] - 128
            expected = [light + 2.018 * u, light - 0.391 * u - 0.813 * v, light + 1.596 * v]
            assert frame[y, x] == pytest.approx(np.clip(expected, 0, 255), abs=2)


def plane(rows, step):
    """Return the bytes of rows, each padded to the step."""
    return b''.join(row.tobytes().ljust(step, b'\xa5') for row in np.ascontiguousarray(rows))


def planar(encoding, light, u, v, step):
    """Return a planar message, for which u and v, of the luma's size, are subsampled if needed."""
    if encoding in ('nv12', 'nv21', 'i420', 'yuv420'):
        u, v = u[::2, ::2], v[::2, ::2]
    elif encoding in ('nv16', 'nv61'):
        u, v = u[:, ::2], v[:, ::2]
    if encoding in ('i420', 'yuv420'):
        colour = plane(u, step // 2) + plane(v, step // 2)
    else:
        pairs = (v, u) if encoding in ('nv21', 'nv61') else (u, v)
        pairs = np.dstack(pairs).reshape(len(u), -1)
        colour = plane(pairs, 2 * step if encoding == 'nv24' else step)
    return SimpleNamespace(height=len(light), width=light.shape[1], encoding=encoding, step=step,
                           is_bigendian=0, data=plane(light, step) + colour)


PLANAR = ('nv12', 'nv21', 'i420', 'yuv420', 'nv16', 'nv61', 'nv24')


@pytest.mark.parametrize('padding', [0, 4])
@pytest.mark.parametrize('encoding', PLANAR)
def test_planar_yuv_is_bt601(encoding, padding):
    """Blocks of four pixels that share a colour are BT.601, in every order of the planes."""
    rng = np.random.default_rng(4)
    light = rng.integers(60, 180, (HEIGHT, WIDTH)).astype(np.uint8)
    u, v = (np.kron(rng.integers(100, 156, (HEIGHT // 2, WIDTH // 2)), np.ones((2, 2)))
            .astype(np.uint8) for _ in range(2))
    frame = to_frame(planar(encoding, light, u, v, WIDTH + padding))
    y, u, v = 1.164 * (light - 16.0), u - 128.0, v - 128.0
    expected = np.dstack([y + 2.018 * u, y - 0.391 * u - 0.813 * v, y + 1.596 * v])
    assert frame.flags.c_contiguous and frame.shape == (HEIGHT, WIDTH, 3)
    assert frame == pytest.approx(np.clip(expected, 0, 255), abs=2)


@pytest.mark.parametrize('changes, words', [
    ({'height': 5}, ['height is 5', 'multiple of 2']),
    ({'width': 7}, ['width is 7', 'multiple of 2']),
    ({'step': 7}, ['step is 7', '8']),
    ({'step': 9, 'data': bytes(81)}, ['step is 9', 'multiple of 2']),
    ({'data': bytes(48)}, ['48 bytes', '24 of colour']),
    ({'encoding': 'nv15'}, ['nv12', 'i420', 'nv24']),
])
def test_malformed_planes(changes, words):
    """Planes that don't fit the size are refused with the reason."""
    sent = planar('i420', *np.zeros((3, HEIGHT, WIDTH), np.uint8), WIDTH)
    vars(sent).update(changes)
    with pytest.raises(ValueError) as caught:
        to_frame(sent)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize('encoding', BAYER)
def test_bayer_is_bilinear(encoding, padding):
    """Inside, each missing colour is the mean of the nearest pixels that have it."""
    values = random_values(WIDTH)
    pattern = np.tile(np.array(list(BAYER[encoding])).reshape(2, 2), (HEIGHT // 2, WIDTH // 2))
    frame = to_frame(message(values, encoding, padding))
    for y in range(1, HEIGHT - 1):
        for x in range(1, WIDTH - 1):
            for channel, colour in enumerate('bgr'):
                near = [int(values[y + dy, x + dx]) for dy in (-1, 0, 1) for dx in (-1, 0, 1)
                        if pattern[y + dy, x + dx] == colour]
                if pattern[y, x] == colour:
                    near = [int(values[y, x])]
                elif colour == 'g':
                    near = [int(values[y + dy, x + dx])
                            for dy, dx in ((-1, 0), (1, 0), (0, -1), (0, 1))]
                assert frame[y, x, channel] == pytest.approx(np.mean(near), abs=1)


def test_bayer_of_sixteen_bits():
    """It's read as the Bayer image of the high bytes."""
    values = random_values(WIDTH)
    wide = values.astype(np.uint16) * 257
    for name in BAYER:
        narrow = to_frame(message(values, name))
        assert np.array_equal(to_frame(message(wide, name[:-1] + '16', 2, True)), narrow)


@pytest.mark.parametrize('encoding', ['bgr8', 'mono8'])
def test_shares_memory(encoding):
    """Where no conversion is needed, the frame shares the message's memory."""
    sent = message(random_values(WIDTH * CHANNELS[encoding]), encoding)
    assert np.shares_memory(to_frame(sent), np.frombuffer(sent.data, np.uint8))


@pytest.mark.parametrize('changes, words', [
    ({'encoding': 'rgb9'}, ['rgb9', 'bgr8']),
    ({'encoding': ''}, ["''", 'bgr8']),
    ({'width': 0}, ['0 x 6']),
    ({'height': 0}, ['8 x 0']),
    ({'step': 23}, ['23', '24']),
    ({'step': 0}, ['0', '24']),
    ({'step': 30}, ['144', '180']),
    ({'data': b''}, ['0 bytes', '144']),
    ({'data': bytes(143)}, ['143', '144']),
    ({'data': bytes(145)}, ['145', '144']),
    ({'height': 2 ** 32 - 1}, ['144']),
    ({'width': 2 ** 32 - 1}, ['step']),
])
def test_malformed(changes, words):
    """The message says what is wrong and what would be right."""
    sent = message(random_values(WIDTH * 3), 'bgr8')
    vars(sent).update(changes)
    with pytest.raises(ValueError) as caught:
        to_frame(sent)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize('encoding, width, height', [('uyvy', 3, 2), ('bayer_rggb8', 2, 2)])
def test_sizes_that_an_encoding_cannot_have(encoding, width, height):
    """Pairs of pixels need an even width, and a Bayer pattern neighbours."""
    step = width * (2 if encoding == 'uyvy' else 1)
    with pytest.raises(ValueError, match=encoding):
        to_frame(SimpleNamespace(width=width, height=height, encoding=encoding, step=step,
                                 is_bigendian=0, data=bytes(step * height)))


def test_every_encoding_is_tested():
    """Every encoding that can be read is in one of the tables above."""
    wide = {name[:-1] + '16' for name in BAYER}
    assert set(ENCODINGS) == {*CHANNELS, *BAYER, *wide, *PLANAR, 'yuv422', 'uyvy',
                              'yuv422_yuy2', 'yuyv'}


@pytest.mark.parametrize('shape', [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)])
def test_png_is_lossless(shape):
    """Grey stays grey, colour is BGR."""
    frame = np.random.default_rng(3).integers(0, 256, shape).astype(np.uint8)
    data = cv2.imencode('.png', frame)[1].tobytes()
    assert np.array_equal(compressed_to_frame(SimpleNamespace(format='png', data=data)), frame)


def test_png_of_sixteen_bits_and_with_alpha():
    """Sixteen bits become eight by full scale; alpha is dropped."""
    wide = np.random.default_rng(4).integers(0, 65536, (HEIGHT, WIDTH)).astype(np.uint16)
    data = cv2.imencode('.png', wide)[1]
    assert np.array_equal(compressed_to_frame(SimpleNamespace(format='png', data=data)),
                          np.round(wide / 257).astype(np.uint8))
    colour = np.random.default_rng(5).integers(0, 256, (HEIGHT, WIDTH, 4)).astype(np.uint8)
    data = cv2.imencode('.png', colour)[1]
    assert np.array_equal(compressed_to_frame(SimpleNamespace(format='png', data=data)),
                          colour[..., :3])


def test_jpeg():
    """A smooth picture survives almost unchanged."""
    ramp = np.repeat(np.linspace(20, 220, 64)[None], 48, axis=0)
    frame = np.stack([ramp, ramp, ramp], axis=-1).astype(np.uint8)
    data = cv2.imencode('.jpg', frame)[1]
    seen = compressed_to_frame(SimpleNamespace(format='bgr8; jpeg compressed bgr8', data=data))
    assert seen.shape == frame.shape
    assert np.abs(seen.astype(int) - frame).max() <= 3


@pytest.mark.parametrize('data, kind', [
    (b'', 'jpeg'), (b'no picture', 'png'), (bytes(1000), 'jpeg'),
    (cv2.imencode('.png', np.zeros((9, 9), np.uint8))[1].tobytes()[:40], 'png'),
    (b'0123456789ab', '16UC1; compressedDepth')])
def test_broken_compressed_images(data, kind):
    """What can't be decoded is refused with its format."""
    with pytest.raises(ValueError, match=kind.partition(';')[0]):
        compressed_to_frame(SimpleNamespace(format=kind, data=data))


@pytest.mark.parametrize('padding', [0, 500])
def test_a_jpeg_that_is_cut_off_is_refused(padding):
    """As a camera sends it whose connection is too slow; some versions of OpenCV fill the rest."""
    noise = np.random.default_rng(6).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    data = cv2.imencode('.jpg', noise)[1].tobytes()
    for length in (len(data) - 2, len(data) // 2):
        with pytest.raises(ValueError, match='neither a whole jpeg'):
            compressed_to_frame(SimpleNamespace(
                format='jpeg', data=data[:length] + bytes(padding)))
    # a driver may pad a whole one
    assert compressed_to_frame(SimpleNamespace(
        format='jpeg', data=data + bytes(padding))).shape == noise.shape


def test_a_small_message_cannot_claim_a_huge_image():
    """It's refused, so that no memory is allocated for pixels that its bytes can't hold."""
    for kind, places in (('.png', ((16, 4), (20, 4))), ('.jpg', None)):
        data = bytearray(cv2.imencode(kind, np.zeros((16, 16, 3), np.uint8))[1].tobytes())
        if places is None:
            at = data.index(b'\xff\xc0') + 5
            places = ((at, 2), (at + 2, 2))
        for at, length in places:
            data[at:at + length] = (0xfff0 if length == 2 else 0x10000).to_bytes(length, 'big')
        with pytest.raises(ValueError, match='pixels, which is more than it holds'):
            compressed_to_frame(SimpleNamespace(format=kind, data=bytes(data)))


def test_a_chunk_cannot_be_longer_than_its_image():
    """It's refused, so that no memory is allocated for a PNG's chunk that isn't there."""
    data = bytearray(cv2.imencode('.png', np.zeros((16, 16, 3), np.uint8))[1].tobytes())
    data[33:37] = b'\x7f\xff\xff\xff'
    with pytest.raises(ValueError, match='nor a whole png'):
        compressed_to_frame(SimpleNamespace(format='png', data=bytes(data)))


def test_a_blank_image_is_read():
    """It's read however well it is compressed, at one bit a pixel, too."""
    blank = np.zeros((4000, 4000), np.uint8)
    for kind, options in (('.png', [cv2.IMWRITE_PNG_BILEVEL, 1]), ('.png', []),
                          ('.jpg', [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])):
        data = cv2.imencode(kind, blank, options)[1].tobytes()
        frame = compressed_to_frame(SimpleNamespace(format=kind, data=data))
        assert frame.shape == blank.shape


@pytest.mark.parametrize('shape', [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)])
def test_there_and_back(shape):
    """A frame that is written is read back unchanged."""
    frame = np.random.default_rng(6).integers(0, 256, shape).astype(np.uint8)
    sent = SimpleNamespace()
    fill_image(sent, frame)
    assert np.array_equal(to_frame(sent), frame)


def test_fills_a_slice():
    """A frame that isn't contiguous is written correctly."""
    frame = np.random.default_rng(7).integers(0, 256, (HEIGHT, 2 * WIDTH, 3)).astype(np.uint8)
    sent = SimpleNamespace()
    fill_image(sent, frame[:, ::2])
    assert np.array_equal(to_frame(sent), frame[:, ::2])


def test_real_message():
    """A message of rclpy takes the data, and keeps them through serialisation."""
    sensor_msgs = pytest.importorskip('sensor_msgs.msg', reason='needs sensor_msgs')
    serialization = pytest.importorskip('rclpy.serialization', reason='needs rclpy')
    frame = np.random.default_rng(8).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    sent = sensor_msgs.Image()
    fill_image(sent, frame)
    raw = serialization.serialize_message(sent)
    assert np.array_equal(
        to_frame(serialization.deserialize_message(raw, sensor_msgs.Image)), frame)


def test_stamp():
    """Seconds and nanoseconds make nanoseconds, exactly."""
    stamp = SimpleNamespace(sec=1_700_000_000, nanosec=123_456_789)
    assert stamp_nanoseconds(stamp) == 1_700_000_000_123_456_789
