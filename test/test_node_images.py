"""Image input: encodings, changes of encoding, size and stamps, QoS, compression and remaps."""

from geometry_msgs.msg import PoseStamped
from node_harness import Client, image_message, NodeProcess, overlap, Scene, STEP
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image
from std_srvs.srv import Trigger

SCENE = Scene()
START = 10**13


@pytest.fixture(scope='module')
def process():
    """Return a node's process that starts on the scene's first box."""
    box = SCENE.box(0)
    with NodeProcess(init_box=f'[{box.x}, {box.y}, {box.width}, {box.height}]') as process:
        yield process


@pytest.fixture(scope='module')
def client(process):
    """Return a client that has sent nothing yet."""
    with Client() as client:
        client.ready()
        client.start = START
        yield client


@pytest.fixture(autouse=True)
def _fresh(client):
    """Begin a new stream: its stamps are before the last one's."""
    client.begin_stream()
    client.index = 0


def send(client, frame, encoding=None):
    """Send the next frame in an encoding."""
    stamp = client.start + STEP * client.index
    client.index += 1
    return client.send_message(image_message(frame, stamp, encoding))


def luma(frame):
    """Return the grey values of a BGR frame."""
    return (frame @ np.array([0.114, 0.587, 0.299])).round().astype(np.uint8)


def yuv(frame, luma_first):
    """Return the frame as packed YUV 4:2:2."""
    blue, red = frame[..., 0].astype(float), frame[..., 2].astype(float)
    y = frame @ np.array([0.114, 0.587, 0.299])
    u, v = 128 + 0.564 * (blue - y), 128 + 0.713 * (red - y)
    chroma = np.where(np.arange(frame.shape[1]) % 2, v, u)
    planes = (y * 219 / 255 + 16, chroma)
    return np.stack(planes if luma_first else planes[::-1], axis=2).clip(0, 255).astype(np.uint8)


def bayer(frame):
    """Return the frame as a camera with an RGGB filter sees it."""
    result = np.empty(frame.shape[:2], np.uint8)
    for row, column, channel in ((0, 0, 2), (0, 1, 1), (1, 0, 1), (1, 1, 0)):
        result[row::2, column::2] = frame[row::2, column::2, channel]
    return result


ENCODINGS = {
    'bgr8': lambda f: (f, 0), 'rgb8': lambda f: (f[..., ::-1], 0),
    'bgra8': lambda f: (np.dstack([f, np.full(f.shape[:2], 7, np.uint8)]), 0),
    'rgba8': lambda f: (np.dstack([f[..., ::-1], np.full(f.shape[:2], 7, np.uint8)]), 0),
    'mono8': lambda f: (luma(f), 0),
    'mono16': lambda f: ((luma(f).astype('<u2') * 257).view(np.uint8), 0),
    'mono16 big': lambda f: ((luma(f).astype('>u2') * 257).view(np.uint8), 1),
    'yuv422': lambda f: (yuv(f, False), 0), 'yuv422_yuy2': lambda f: (yuv(f, True), 0),
    'bayer_rggb8': lambda f: (bayer(f), 0),
}


@pytest.mark.parametrize('padding', [0, 13])
@pytest.mark.parametrize('name', ENCODINGS)
def test_encodings(client, process, name, padding):
    """Whatever the encoding, the row's padding and the byte order, the target is tracked."""
    for index in range(6):
        pixels, bigendian = ENCODINGS[name](SCENE.frame(index))
        stamp = client.start + STEP * index
        message = image_message(np.ascontiguousarray(pixels), stamp, name.split()[0])
        message.height, message.width = SCENE.height, SCENE.width
        rows = np.ascontiguousarray(pixels).reshape(SCENE.height, -1)
        if padding:
            rows = np.hstack([rows, np.full((SCENE.height, padding), 200, np.uint8)])
        message.step, message.data = rows.shape[1], rows.tobytes()
        message.is_bigendian = bigendian
        answer = client.send_message(message)
        assert overlap(answer, SCENE.box(index)) > 0.5, (index, process.log)


def test_encoding_changes_in_mid_stream(client, process):
    """A change of the colour order keeps the target; a change to grey ends the tracking."""
    assert overlap(send(client, SCENE.frame(0)), SCENE.box(0)) > 0.5
    answer = send(client, np.ascontiguousarray(SCENE.frame(1)[..., ::-1]), 'rgb8')
    assert overlap(answer, SCENE.box(1)) > 0.5
    answer = send(client, SCENE.frame(2))
    assert overlap(answer, SCENE.box(2)) > 0.5
    since = len(process.log)
    assert not send(client, luma(SCENE.frame(3))).detections
    process.wait_for_log('the images changed from colour to grey', since)
    assert client.change(init_box=SCENE.box(4).as_array().tolist())[0].successful
    assert overlap(send(client, luma(SCENE.frame(4))), SCENE.box(4)) > 0.9
    assert overlap(send(client, luma(SCENE.frame(5))), SCENE.box(5)) > 0.5


def test_size_changes_in_mid_stream(client, process):
    """A frame of another size ends the tracking; the node says so, and takes a new target."""
    assert send(client, SCENE.frame(0)).detections
    since = len(process.log)
    small = np.ascontiguousarray(SCENE.frame(1)[:100, :100])
    assert not send(client, small).detections
    process.wait_for_log('image size changed from 160 x 120 to 100 x 100', since)
    assert not send(client, SCENE.frame(2)).detections
    assert client.change(init_box=SCENE.box(3).as_array().tolist())[0].successful
    assert overlap(send(client, SCENE.frame(3)), SCENE.box(3)) > 0.9


def test_stamps_that_go_backwards_begin_again(client, process):
    """A bag that loops starts on init_box again, and gives the same boxes as in the first pass."""
    first = [send(client, SCENE.frame(i)) for i in range(20)]
    since = len(process.log)
    client.index = 0
    second = [send(client, SCENE.frame(i)) for i in range(20)]
    process.wait_for_log('stamps went backwards', since)
    for one, other in zip(first, second):
        assert one.detections[0].bbox == other.detections[0].bbox


def test_stamps_that_go_backwards_forget_a_selected_target(client, process):
    """Without init_box a loop ends the tracking until the next selection; the log says so."""
    assert all(send(client, SCENE.frame(i)).detections for i in range(5))
    assert client.change(init_box=[])[0].successful
    assert send(client, SCENE.frame(5)).detections
    client.index, since = 0, len(process.log)
    assert not send(client, SCENE.frame(0)).detections
    process.wait_for_log('the target is forgotten, select it again', since)
    assert client.change(init_box=SCENE.box(0).as_array().tolist())[0].successful
    assert send(client, SCENE.frame(1)).detections


def test_stamps_that_stand_still(client):
    """Images that all have the same stamp are tracked."""
    for index in range(10):
        answer = client.send(SCENE.frame(index), client.start)
        assert overlap(answer, SCENE.box(index)) > 0.4


def test_clocks_from_zero_to_the_far_future(client):
    """Detections have their image's stamp, whatever it is, to the nanosecond."""
    future, heard = (2**31 - 2) * 10**9 + 999_999_999, client.heard['detections']
    message, before = image_message(SCENE.frame(0), future), len(heard)

    def answered():
        client.images.publish(message)
        client.executor.spin_once(timeout_sec=0.1)
        return len(heard) > before
    # A frame stamped in the far future is dropped as late; the third in a row is accepted.
    client.until(answered, 'no answer in another time')
    for stamp in future, 1_700_000_000_123_456_789, 1:
        # When the clock is set back, init_box isn't selected again by itself.
        client.send(SCENE.frame(0), stamp)
        assert client.change(init_box=SCENE.box(0).as_array().tolist())[0].successful
        answer = client.send(SCENE.frame(0), stamp)
        told = answer.detections[0].header.stamp
        assert told.sec * 10**9 + told.nanosec == stamp
    client.start = START


def test_best_effort_publisher(process, client):
    """Images of a best-effort publisher are received with the default settings."""
    since = len(process.log)
    with Client(reliability='BEST_EFFORT') as other:
        other.ready()
        process.wait_for_log('best_effort', since)
        answers = [other.send(SCENE.frame(i), 10**9 + STEP * i) for i in range(10)]
        assert all(overlap(answer, SCENE.box(i)) > 0.4 for i, answer in enumerate(answers))


def test_compressed():
    """With image_transport compressed, JPEG and PNG on image/compressed are tracked."""
    import cv2
    box = SCENE.box(0)
    with NodeProcess(image_transport='compressed',
                     init_box=f'[{box.x}, {box.y}, {box.width}, {box.height}]') as process:
        with Client(publish=CompressedImage, topic='image/compressed') as client:
            client.ready()
            for index in range(8):
                kind = ('jpeg', 'png')[index % 2]
                message = CompressedImage(format=kind)
                message.header.stamp.nanosec = STEP * index
                done, data = cv2.imencode(f'.{kind}', SCENE.frame(index))
                assert done
                message.data = data.tobytes()
                answer = client.send_message(message)
                assert overlap(answer, SCENE.box(index)) > 0.5, process.log
            client.images.publish(CompressedImage(format='jpeg', data=b'no jpeg'))
            process.wait_for_log("can't be decoded")
            message.header.stamp.nanosec += STEP
            assert client.send_message(message).detections


def test_remaps_and_namespaces():
    """All names are relative: a namespace and a remap move them."""
    box = SCENE.box(0)
    init = f'[{box.x}, {box.y}, {box.width}, {box.height}]'
    arguments = ['-r', '__ns:=/arm', '-r', '__node:=eye', '-r', 'image:=/camera/image_raw',
                 '-r', 'pose:=target_pose']
    with NodeProcess(*arguments, init_box=init), Client('/arm/eye', publish=None) as client:
        poses = client.hear('target_pose', PoseStamped)
        del client.heard['pose']
        client.images = client.publisher('/camera/image_raw', Image)
        client.ready()
        assert client.play(SCENE, range(3))[-1].detections
        client.until(lambda: len(poses) == 3, 'no pose')
        assert client.ask('~/reset', Trigger).success
