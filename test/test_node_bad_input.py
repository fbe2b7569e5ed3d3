"""
Bad input: the node reports the reason, keeps running, and tracks the next good frame.

`python test/test_node_bad_input.py` writes the reasons into docs/results/bad_input.md.
"""

from contextlib import contextmanager
from pathlib import Path
import re

from geometry_msgs.msg import PointStamped
from node_harness import Client, image_message, NodeProcess, Scene, STEP
import pytest
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from vision_msgs.msg import Detection2D

from vtrack_ros.messages.camera_info import camera_from_info
from vtrack_ros.messages.images import to_frame

SCENE = Scene()
NAN, INF = float('nan'), float('inf')


def image(**changes):
    """Return a good image with some fields changed."""
    message = image_message(SCENE.frame(0), 0)
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def init(x=80.0, y=60.0, width=24.0, height=24.0, theta=0.0, seconds=0):
    """Return a selection."""
    message = Detection2D()
    message.header.stamp.sec = seconds
    message.bbox.center.position.x, message.bbox.center.position.y = x, y
    message.bbox.center.theta = theta
    message.bbox.size_x, message.bbox.size_y = width, height
    return message


def point(x, y, seconds=0):
    """Return a click."""
    message = PointStamped()
    message.header.stamp.sec = seconds
    message.point.x, message.point.y = x, y
    return message


def camera_info(fx=100.0, fy=100.0, model='plumb_bob', d=(), width=160, height=120):
    """Return a calibration."""
    message = CameraInfo(width=width, height=height, distortion_model=model, d=list(d))
    message.k = [fx, 0.0, 80.0, 0.0, fy, 60.0, 0.0, 0.0, 1.0]
    return message


#: Malformed images: (name, message, part of the reason).
IMAGES = [
    ('no data', image(data=b''), 'image data has 0 bytes'),
    ('data one byte short', image(data=bytes(57599)), '57599 bytes'),
    ('data one byte long', image(data=bytes(57601)), '57601 bytes'),
    ('zero width', image(width=0, step=0, data=b''), '0 x 120'),
    ('zero height', image(height=0, data=b''), '160 x 0'),
    ('step too small', image(step=479, data=bytes(479 * 120)), 'step is 479 bytes'),
    ('step zero', image(step=0, data=b''), 'step is 0 bytes'),
    ('step that does not fit the data', image(step=500), '500 times height 120'),
    ('huge size, little data', image(width=100000, height=100000, step=300000), '57600 bytes'),
    ('greatest size', image(width=2**32 - 1, height=2**32 - 1), 'step is 480 bytes'),
    ('no encoding', image(encoding=''), "unknown image encoding ''"),
    ('unknown encoding', image(encoding='xyz12'), "'xyz12'"),
    ('depth image', image(encoding='32FC1', step=640, data=bytes(640 * 120)), "'32FC1'"),
    ('encoding in capitals', image(encoding='BGR8'), "'BGR8'"),
    ('planar encoding', image(encoding='p010'), "'p010'"),
    ('planes missing', image(encoding='nv12'), '28800 of colour'),
    ('odd width of yuv422', image(encoding='yuv422', width=159, step=318, data=bytes(318 * 120)),
     'multiple of 2'),
    ('bayer of one pixel', image(encoding='bayer_rggb8', width=1, height=1, step=1, data=b'1'),
     'at least 3 x 3'),
]

#: Wrong selections: (name, topic, message, part of the reason).
SELECTIONS = [
    ('box without size', '~/init', init(width=0.0), 'must be positive'),
    ('box of negative size', '~/init', init(height=-4.0), 'must be positive'),
    ('box of no number', '~/init', init(x=NAN), 'center x must be finite'),
    ('infinite box', '~/init', init(width=INF), 'size_x must be finite'),
    ('box turned by no number', '~/init', init(theta=NAN), 'theta must be finite'),
    ('box beside the image', '~/init', init(x=-500.0), 'no pixel inside'),
    ('box with its centre beside the image', '~/init', init(x=-5.0, width=40.0), 'centre'),
    ('box of less than a pixel', '~/init', init(width=0.2), 'at least 2 px'),
    ('box of long ago', '~/init', init(seconds=1), 'too old'),
    ('box of the future', '~/init', init(seconds=90000), 'in the future'),
    ('region without size', '~/init_roi', RegionOfInterest(x_offset=3), 'must be positive'),
    ('region beside the image', '~/init_roi',
     RegionOfInterest(x_offset=4000, y_offset=4000, width=9, height=9), 'no pixel inside'),
    ('region of one column inside', '~/init_roi',
     RegionOfInterest(x_offset=159, y_offset=50, width=9, height=9), 'at least 2 px'),
    ('point of no number', '~/init_point', point(NAN, 60.0), 'must be finite'),
    ('point beside the image', '~/init_point', point(-3.0, 60.0), '160 x 120'),
    ('point of long ago', '~/init_point', point(80.0, 60.0, seconds=1), 'too old'),
]

#: Wrong calibrations, sent on camera_info: (name, message, part of the reason).
CALIBRATIONS = [
    ('not calibrated', camera_info(fx=0.0), 'not calibrated'),
    ('focal length of no number', camera_info(fx=NAN), 'not calibrated'),
    ('unknown distortion model', camera_info(model='thin_prism', d=(0.1,) * 4), 'thin_prism'),
    ('too few coefficients', camera_info(d=(0.1, 0.2)), '2 distortion coefficients'),
    ('coefficient of no number', camera_info(d=(NAN, 0.0, 0.0, 0.0, 0.0)), 'finite'),
]

#: Wrong parameters: (name, value, part of the reason).
PARAMETERS = [
    ('tracker', 'csrt', 'must be one of gmpf'),
    ('tracker', 7, 'must be one of gmpf'),
    ('seed', -1, 'an integer from 0 to 2147483647, not -1'),
    ('seed', 1.5, 'an integer from 0 to 2147483647, not 1.5'),
    ('init_box', [1.0, 2.0], '2 values'),
    ('init_box', [0.0, 0.0, -5.0, 5.0], 'must be positive'),
    ('init_box', [0.0, NAN, 5.0, 5.0], 'must be finite'),
    ('init_box', 'the ball', 'valid is [x, y, width, height]'),
    ('gmpf.particles', 0, 'an integer from 2 to 5000, not 0'),
    ('gmpf.particles', 10**12, 'an integer from 2 to 5000'),
    ('gmpf.particles', 'many', "an integer from 2 to 5000, not 'many'"),
    ('gmpf.particels', 100, 'gmpf.particles'),
    ('history_seconds', -1.0, 'a number from 0 to 30 s, not -1.0'),
    ('history_megabytes', 1e9, 'a number from 0 to 1024 MB'),
    ('init_score', 1.01, 'a number from 0 to 1, not 1.01'),
    ('init_score', NAN, 'a number from 0 to 1, not nan'),
    ('init_score', 1, 'with a decimal point: 1.0, not 1'),
    ('init_from_detections', 1, 'true or false, not 1'),
    ('pose_units', 'feet', 'one of auto, pixels, ray, metres'),
    ('target_width', -0.1, 'a number from 0 to 1000 m, not -0.1'),
    ('reliability', 'best_effort', 'read-only'),
    ('image_transport', 'theora', 'read-only'),
    ('nonsense', True, 'valid are tracker, seed'),
]


@pytest.fixture(scope='module')
def talk():
    """Return a client of a node that tracks the target."""
    with talking() as client:
        yield client


@contextmanager
def talking():
    """Start a node, select its target, and yield its client."""
    with NodeProcess() as process, Client() as client:
        client.ready()
        client.process = process
        client.publishers = {
            '~/init': client.publisher('~/init', Detection2D),
            '~/init_roi': client.publisher('~/init_roi', RegionOfInterest),
            '~/init_point': client.publisher('~/init_point', PointStamped),
            'camera_info': client.publisher('camera_info', CameraInfo)}
        client.index = 100
        good_frame(client)
        restart(client)
        yield client


def good_frame(client):
    """Send a good frame; return its answer."""
    client.index += 1
    return client.send(SCENE.frame(client.index), STEP * client.index)


def restart(client):
    """Select the target again, by init_box; the next frame must have a detection."""
    box = SCENE.box(client.index + 1)
    assert client.change(init_box=box.as_array().tolist())[0].successful
    assert good_frame(client).detections


def send_other(client, topic, message, words):
    """Send a bad message, then good frames until the log has the words; return the new log."""
    since = len(client.process.log)
    client.publishers[topic].publish(message)
    for _ in range(100):
        assert good_frame(client) is not None
        if words in client.process.log[since:]:
            break
    return client.process.log[since:]


@pytest.mark.parametrize('name, message, words', IMAGES, ids=[row[0] for row in IMAGES])
def test_reason_of_a_malformed_image(name, message, words):
    """The error's text says what is wrong, or what is valid."""
    assert words in reason(to_frame, message)


@pytest.mark.parametrize('name, message, words', CALIBRATIONS,
                         ids=[row[0] for row in CALIBRATIONS])
def test_reason_of_a_wrong_calibration(name, message, words):
    """The error's text says what is wrong, or what is valid."""
    assert words in reason(camera_from_info, message)


def test_images(talk):
    """Every malformed image is counted and not answered, and the next good frame is tracked."""
    since, states = len(talk.process.log), talk.heard['~/state']
    for number, (name, message, _) in enumerate(IMAGES, start=1):
        answers = len(talk.heard['detections'])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            STEP * (talk.index + 1), 10**9)
        talk.images.publish(message)
        talk.until(lambda: any(row.key == 'frames_malformed' and row.value == str(number)
                               for row in states[-1].values), f'{name} is not counted')
        assert len(talk.heard['detections']) == answers
        assert good_frame(talk).detections
    # The log is throttled: not every one of them is logged.
    talk.process.wait_for_log('image dropped: image data has 0 bytes', since)


@pytest.mark.parametrize('name, topic, message, words', SELECTIONS,
                         ids=[row[0] for row in SELECTIONS])
def test_selections(talk, name, topic, message, words):
    """A wrong selection is refused with the reason, and the target stays."""
    restart(talk)
    assert words in send_other(talk, topic, message, words)
    assert good_frame(talk).detections


def test_calibrations(talk):
    """A wrong calibration replaces a good one: the pose is in pixels again."""
    restart(talk)
    since = len(talk.process.log)

    def units_become(units):
        talk.until(lambda: talk.state_after(good_frame(talk))['pose_units'] == units,
                   f'the pose is not in {units}')
    size = camera_info(width=640, height=480)
    for message in (*(row[1] for row in CALIBRATIONS), size):
        talk.publishers['camera_info'].publish(camera_info())
        units_become('ray')
        talk.publishers['camera_info'].publish(message)
        units_become('pixels')
    talk.process.wait_for_log('must be positive; the pose is in pixels', since)
    talk.process.wait_for_log('camera_info is not used: it is for 640 x 480', since)


def test_calibrations_that_are_wrong_in_a_new_way_each(talk):
    """The log doesn't fill with them, and the target is tracked on."""
    restart(talk)
    since = len(talk.process.log)
    for number in range(40):
        talk.publishers['camera_info'].publish(camera_info(fx=-1.0 - number))
        assert good_frame(talk).detections
    talk.process.wait_for_log('fx and fy of k are -1 and', since)
    assert 10 < talk.process.log[since:].count('must be positive') <= 20


def test_a_node_is_not_its_own_detector():
    """A remap of ~/init_detections to the node's own boxes is told, and not followed."""
    remaps = ['-r', '__ns:=/own', '-r', '~/init_detections:=/own/detections']
    with NodeProcess(*remaps, init_from_detections='true') as process, (
            Client('/own/tracker')) as client:
        process.wait_for_log('on which this node publishes its own boxes')
        client.ready()
        readers = client.node.get_subscriptions_info_by_topic('/own/detections')
        assert [one.node_name for one in readers] == ['client']


@pytest.mark.parametrize('name, value, words', PARAMETERS)
def test_parameters(talk, name, value, words):
    """A wrong parameter is refused with the reason, and nothing changes."""
    restart(talk)
    result, = talk.change(**{name.replace('.', '__'): value})
    assert not result.successful
    assert words in result.reason
    assert good_frame(talk).detections


def reason(read, message):
    """Return the text of the error that a function raises for a message that it can't read."""
    with pytest.raises(ValueError) as raised:
        read(message)
    return str(raised.value)


def write_page(path):
    """Write a table of all bad input and the reasons that the node gives."""
    rows = [(f'image: {name}', f'image dropped: {reason(to_frame, message)}')
            for name, message, _ in IMAGES]
    with talking() as client:
        for name, topic, message, words in SELECTIONS:
            restart(client)
            rows.append((f'{topic}: {name}', line(
                send_other(client, topic, message, words), words)))
        rows += [(f'camera_info: {name}',
                  f'{reason(camera_from_info, message)}; the pose is in pixels')
                 for name, message, _ in CALIBRATIONS]
        words = 'is for 640 x 480'
        rows.append(('camera_info: for another image size', line(send_other(
            client, 'camera_info', camera_info(width=640, height=480), words), words)))
        for name, value, words in PARAMETERS:
            restart(client)
            result, = client.change(**{name.replace('.', '__'): value})
            rows.append((f'parameter {name}: {value!r}', result.reason))
    table = '\n'.join(f'| {what} | {said} |'.replace('<', '&lt;') for what, said in rows)
    path.write_text(f"""# What the node says to bad input

Written by `python test/test_node_bad_input.py`, which sends each of these {len(rows)} to a running
node and makes sure that it tracks the next good frame. The test of the same name does so too.

| input | answer |
| --- | --- |
{table}
""")


def line(log, words):
    """Return the line of a log that has the words, without time and name."""
    found = next(line for line in log.splitlines() if words in line)
    return re.sub(r'^\[\w+\] \[[\d.]+\] \[\w+\]: ', '', found)


if __name__ == '__main__':
    write_page(Path(__file__).resolve().parents[1] / 'docs' / 'results' / 'bad_input.md')
