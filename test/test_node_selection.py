"""Selecting the target: by a box, a region, a click or a detector; reset and pause."""

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped
from node_harness import Client, NodeProcess, overlap, Scene, STEP
import pytest
from sensor_msgs.msg import RegionOfInterest
from std_srvs.srv import SetBool, Trigger
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose

from vtrack_ros.bags import BagReader
from vtrack_ros.messages.images import stamp_nanoseconds

START = 10 * 10**9


def detection(box, stamp=0, class_id='', score=0.0, theta=0.0, target_id=''):
    """Return a box as a Detection2D."""
    message = Detection2D(id=target_id)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.bbox.center.position.x, message.bbox.center.position.y = box.center
    message.bbox.center.theta = theta
    message.bbox.size_x, message.bbox.size_y = box.width, box.height
    if class_id:
        result = ObjectHypothesisWithPose()
        result.hypothesis.class_id, result.hypothesis.score = class_id, score
        message.results = [result]
    return message


@pytest.fixture(scope='module')
def process():
    """Return a node's process, without a target."""
    with NodeProcess() as process:
        yield process


@pytest.fixture(scope='module')
def client(process):
    """Return a client of a node that hasn't received any image yet."""
    with Client() as client:
        client.ready()
        client.init = client.publisher('~/init', Detection2D)
        client.roi = client.publisher('~/init_roi', RegionOfInterest)
        client.point = client.publisher('~/init_point', PointStamped)
        client.index = 0
        yield client


@pytest.fixture(autouse=True)
def _without_target(client):
    assert client.ask('~/reset', Trigger).success


SCENE = Scene()


def play(client, count=1, visible=True):
    """Send the next frames; return the answers with the true boxes."""
    rows = []
    for _ in range(count):
        index, client.index = client.index, client.index + 1
        answer = client.send(SCENE.frame(index, visible), START + STEP * index)
        rows.append((answer, SCENE.box(index)))
    return rows


def stamp(client, back=0):
    """Return the stamp of the newest frame, or of the one `back` frames before it."""
    return START + STEP * (client.index - 1 - back)


def taken(client, process, since):
    """Wait until the node has started on a selection, which it logs."""
    process.wait_for_log('started', since)


def select(client, process, publisher, message, words='started'):
    """Publish a selection, send frames until the log has `words`; return the answers."""
    since = len(process.log)
    publisher.publish(message)
    rows = []
    while words not in process.log[since:]:
        rows += play(client)
        assert len(rows) < 100, process.log[since:]
    return rows + play(client, 3)


def test_nothing_without_a_target(client):
    """Without a target every image is answered, with no box and no pose."""
    poses = len(client.heard['pose'])
    assert all(not answer.detections for answer, _ in play(client, 3))
    client.until(lambda: client.heard['~/state'][-1].message == 'waiting', 'not waiting')
    assert len(client.heard['pose']) == poses


def test_init_without_a_stamp_starts_on_the_next_frame(client, process):
    """A detection without a stamp starts on the next frame, with its own class and id."""
    play(client)
    rows = select(client, process, client.init,
                  detection(SCENE.box(client.index), class_id='ball', score=1.0,
                            target_id='seven'))
    assert overlap(*rows[-1]) > 0.4
    box, = rows[-1][0].detections
    assert box.results[0].hypothesis.class_id == 'ball'
    assert 0 <= box.results[0].hypothesis.score <= 1
    assert box.id == 'seven'


def test_late_init_starts_on_the_pixels_it_was_drawn_on(client, process):
    """A stamped selection starts on its frame in the buffer, and catches up with the target."""
    play(client, 12)
    drawn = client.index - 1 - 10
    assert SCENE.box(drawn).iou(SCENE.box(client.index)) < 0.2
    rows = select(client, process, client.init,
                  detection(SCENE.box(drawn), START + STEP * drawn))
    assert overlap(*rows[-1]) > 0.4


def test_too_late_init_is_refused(client, process):
    """A selection on a frame that is no longer buffered is refused; the target is kept."""
    play(client)
    select(client, process, client.init, detection(SCENE.box(client.index)))
    play(client, 70)
    said = select(client, process, client.init, detection(SCENE.box(0), START), 'too old')
    assert said[-1][0].detections


@pytest.mark.parametrize('box, told', [
    ((-80.0, 10.0, 20.0, 20.0), 'no pixel inside'),
    ((10.0, 10.0, 0.0, 20.0), 'positive'),
    ((10.0, 10.0, -5.0, 20.0), 'positive'),
    ((float('nan'), 10.0, 20.0, 20.0), 'finite'),
    ((10.0, 10.0, float('inf'), 20.0), 'finite'),
])
def test_wrong_init_is_refused(client, process, box, told):
    """An invalid box is refused with the reason, and nothing is tracked."""
    x, y, width, height = box
    message = Detection2D()
    message.bbox.center.position.x, message.bbox.center.position.y = x + width / 2, y + height / 2
    message.bbox.size_x, message.bbox.size_y = width, height
    rows = select(client, process, client.init, message, told)
    assert not rows[-1][0].detections


def test_init_ahead_of_its_image_waits(client, process):
    """A selection that comes before its image starts when the image is there."""
    play(client)
    ahead = client.index + 2
    since = len(process.log)
    client.init.publish(detection(SCENE.box(ahead), START + STEP * ahead))
    rows = play(client, 6)
    taken(client, process, since)
    assert not rows[0][0].detections and not rows[1][0].detections
    assert overlap(*rows[2]) > 0.9
    assert overlap(*rows[5]) > 0.4


def test_init_of_the_far_future_is_refused(client, process):
    """A selection stamped 1000 s ahead, as by another clock, is refused."""
    play(client)
    select(client, process, client.init,
           detection(SCENE.box(client.index), START + 10**12), 'in the future')


def test_roi(client, process):
    """A region starts on the next frame."""
    play(client)
    box = SCENE.box(client.index)
    rows = select(client, process, client.roi, RegionOfInterest(
        x_offset=int(box.x), y_offset=int(box.y), width=int(box.width), height=int(box.height)))
    assert overlap(*rows[-1]) > 0.4


def test_roi_is_clamped(client, process):
    """A region that reaches beyond the image is clipped to it."""
    play(client)
    rows = select(client, process, client.roi, RegionOfInterest(
        x_offset=SCENE.width - 20, y_offset=SCENE.height - 15, width=4000, height=3000))
    first = next(answer for answer, _ in rows if answer.detections).detections[0].bbox
    assert (first.size_x, first.size_y) == (20.0, 15.0)
    assert (first.center.position.x, first.center.position.y) == (
        SCENE.width - 10, SCENE.height - 7.5)


@pytest.mark.parametrize('region, told', [
    ({'x_offset': 5000, 'y_offset': 0, 'width': 10, 'height': 10}, 'no pixel inside'),
    ({'x_offset': 5, 'y_offset': 5, 'width': 0, 'height': 0}, 'positive'),
])
def test_wrong_roi_is_refused(client, process, region, told):
    """A region outside the image, or of no size, is refused."""
    rows = select(client, process, client.roi, RegionOfInterest(**region), told)
    assert not rows[-1][0].detections


def point(x, y, stamp=0):
    """Return a click."""
    message = PointStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.point.x, message.point.y, message.point.z = float(x), float(y), 5.0
    return message


def test_click(client, process):
    """A stamped point starts on the frame of that stamp, in which the target's extent is found."""
    play(client, 8)
    drawn = client.index - 6
    rows = select(client, process, client.point,
                  point(*SCENE.box(drawn).center, START + STEP * drawn))
    assert overlap(*rows[-1]) > 0.4


def test_click_size(client, process):
    """With click_size a click selects a square of that side about the point."""
    assert all(result.successful for result in client.change(click_size=18.0))
    play(client)
    x, y = SCENE.box(client.index).center
    rows = select(client, process, client.point, point(x, y))
    first = next(answer for answer, _ in rows if answer.detections).detections[0].bbox
    assert (first.size_x, first.size_y) == (18.0, 18.0)
    assert (first.center.position.x, first.center.position.y) == (x, y)
    client.change(click_size=0.0)


@pytest.mark.parametrize('x, y, told', [
    (-3, 50, 'outside the image of 160 x 120'), (50, 120.5, 'outside the image'),
    (float('nan'), 50, 'must be finite')])
def test_wrong_click_is_refused(client, process, x, y, told):
    """A point beside the image is refused with the reason."""
    rows = select(client, process, client.point, point(x, y), f'~/init_point refused: the point '
                  f'({x:g}, {y:g}) {told if "finite" in told else "is " + told}')
    assert not rows[-1][0].detections


def test_click_in_a_bag(client, process, repository):
    """A rendered face is tracked from one click on it."""
    with BagReader(repository / 'bags' / 'face_fast') as bag:
        truth = bag.truth()
        frames = [stamped for _, stamped in zip(range(25), bag.frames())]
    # stamped like this test's other images: the bag's own stamps are far away from them
    answers = []
    for one in frames:
        answer = client.send(one.frame, START + STEP * client.index)
        answers.append((answer, truth[one.stamp]))
        client.index += 1
        if len(answers) == 1:
            center = truth[one.stamp].center
            client.point.publish(point(*center, stamp(client)))
    for answer, box in answers[-5:]:
        center = answer.detections[0].bbox.center.position
        assert abs(center.x - box.center[0]) < box.width / 2
        assert abs(center.y - box.center[1]) < box.height / 2
    process.wait_for_log('~/init_point: started')


def test_rotated_init_stands_for_its_bound(client, process):
    """A rotated box starts on its upright bound: a quarter turn swaps width and height."""
    play(client)
    box = SCENE.box(client.index)
    from vtrack_ros.geometry import Box
    wide = Box.from_center(*box.center, 30, 10)
    rows = select(client, process, client.init, detection(wide, theta=1.5707963267948966))
    first = next(answer for answer, _ in rows if answer.detections).detections[0].bbox
    assert (first.size_x, first.size_y) == pytest.approx((10, 30), abs=1e-9)


def test_reset_and_reinit(client, process):
    """~/reset gives up the target; ~/reinit starts again on the last measured box."""
    assert not client.ask('~/reinit', Trigger).success
    play(client)
    select(client, process, client.init, detection(SCENE.box(client.index)))
    assert client.ask('~/reinit', Trigger).success
    assert overlap(*play(client, 2)[-1]) > 0.4
    heard = len(client.heard['~/state'])
    assert client.ask('~/reset', Trigger).success
    client.until(lambda: 'waiting' in said(client, heard), 'not waiting')
    assert not play(client)[0][0].detections


def test_larger_and_smaller(client, process):
    """The services take another extent about the target; without a target they say so."""
    answer = client.ask('~/larger', Trigger)
    assert not answer.success and 'no target' in answer.message
    play(client)
    box = SCENE.box(client.index)
    select(client, process, client.init, detection(box))
    areas = []
    for name in ('~/larger', '~/larger', '~/smaller'):
        answer = client.ask(name, Trigger)
        assert answer.success and 'restarted on' in answer.message
        bbox = play(client)[-1][0].detections[0].bbox
        areas.append(bbox.size_x * bbox.size_y)
    assert box.area < areas[0] < areas[1] > areas[2]
    for _ in range(30):
        answer = client.ask('~/larger', Trigger)
    assert not answer.success and 'the box is unchanged: found no extent' in answer.message


def said(client, since=0):
    """Return the names of the states that were received."""
    return [status.message for status in client.heard['~/state'][since:]]


def unanswered(client):
    """Send the next frame to a node that is paused."""
    client.send(SCENE.frame(client.index), START + STEP * client.index, answered=False)
    client.index += 1
    client.executor.spin_once(timeout_sec=STEP / 1e9)


def test_pause(client, process):
    """While paused the state says so, to late subscribers too, and images aren't answered."""
    play(client)
    select(client, process, client.init, detection(SCENE.box(client.index)))
    before, states = len(client.heard['detections']), len(client.heard['~/state'])
    assert client.ask('~/enable', SetBool, data=False).success
    pause = START + STEP * client.index
    late = []

    def told():
        unanswered(client)
        return 'paused' in said(client, states)
    client.until(told, 'not paused')
    subscription = client.node.create_subscription(
        DiagnosticStatus, '/tracker/state', late.append, 10)

    def told_later():
        unanswered(client)
        return late
    client.until(told_later, 'who came later was told nothing')
    assert late[0].message == 'paused' and late[0].level == b'\x00'
    assert {row.key: row.value for row in late[0].values}['box'] == 'stale'
    client.node.destroy_subscription(subscription)
    for _ in range(5):
        unanswered(client)
    words = said(client, states)
    assert set(words[words.index('paused'):]) == {'paused'}
    assert len(client.heard['detections']) == before
    states = len(client.heard['~/state'])
    assert client.ask('~/enable', SetBool, data=True).success
    client.until(lambda: 'tracking' in said(client, states), 'resumed without a word')
    # no answer from before the pause is repeated; an image on its way may be answered
    assert all(stamp_nanoseconds(answer.header.stamp) >= pause
               for answer in client.heard['detections'][before:])
    assert client.ask('~/reset', Trigger).success
    play(client)


def test_selection_after_a_pause(client, process):
    """A selection on a frame after a pause isn't refused as one in the future."""
    play(client)
    assert client.ask('~/enable', SetBool, data=False).success
    for _ in range(3):
        unanswered(client)
    client.index += 300
    assert client.ask('~/enable', SetBool, data=True).success
    since = len(process.log)
    client.init.publish(detection(SCENE.box(client.index + 2), stamp(client, -3)))
    rows = play(client, 6)
    taken(client, process, since)
    assert overlap(*rows[2]) > 0.9 and overlap(*rows[5]) > 0.4


def test_detector_starts_it(client, process):
    """The best detection of the wanted class is taken, while there's no target."""
    results = client.change(init_from_detections=True, init_class='ball', init_score=0.6)
    assert all(result.successful for result in results)
    detector = client.publisher('~/init_detections', Detection2DArray)
    play(client)
    from vtrack_ros.geometry import Box
    box, elsewhere = SCENE.box(client.index), Box(100, 90, 20, 20)
    message = Detection2DArray(detections=[
        detection(elsewhere, class_id='person', score=0.99),
        detection(elsewhere, class_id='ball', score=0.61),
        detection(elsewhere, class_id='ball', score=float('nan')),
        detection(box, class_id='ball', score=0.9)])
    rows = select(client, process, detector, message)
    assert overlap(*rows[-1]) > 0.4
    assert rows[-1][0].detections[0].results[0].hypothesis.class_id == 'ball'
    # Once there is a target, detections are ignored.
    detector.publish(Detection2DArray(
        detections=[detection(elsewhere, class_id='ball', score=1.0)]))
    assert overlap(*play(client, 5)[-1]) > 0.4
    # A low score, or another class, starts nothing.
    assert client.ask('~/reset', Trigger).success
    detector.publish(Detection2DArray(detections=[
        detection(box, class_id='ball', score=0.3), detection(box, class_id='cat', score=1.0)]))
    assert not any(answer.detections for answer, _ in play(client, 5))
    # What is found during a pause may have moved away, or the target is somewhere else.
    assert client.ask('~/enable', SetBool, data=False).success
    detector.publish(Detection2DArray(detections=[detection(box, class_id='ball', score=0.9)]))
    for _ in range(5):
        unanswered(client)
    assert client.ask('~/enable', SetBool, data=True).success
    assert not any(answer.detections for answer, _ in play(client, 2))
    client.change(init_from_detections=False)
    client.until(lambda: detector.get_subscription_count() == 0, 'still listening')
