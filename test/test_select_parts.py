"""Parts of the page: access, parameter inputs, and its link to the node."""

import asyncio
from contextlib import asynccontextmanager, contextmanager
import gc
import socket
import sys
import threading
import time

import aiohttp
from node_harness import PATIENCE
from page_viewer import viewer
import pytest
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CompressedImage, Image
from vision_msgs.msg import (
    BoundingBox2D, Detection2D, Detection2DArray, ObjectHypothesisWithPose)

from vtrack_ros.bags import BagReader
from vtrack_ros.cli.command_line import main
from vtrack_ros.dds import leave
from vtrack_ros.selecting.access import is_loopback
from vtrack_ros.selecting.observer import Observer
from vtrack_ros.selecting.parameter_inputs import parameter_inputs, parameter_value
from vtrack_ros.selecting.recording import Recording
from vtrack_ros.selecting.server import serve
from vtrack_ros.selecting.tracker_link import TrackerLink


@pytest.mark.parametrize('host, own', [
    ('localhost', True), ('127.0.0.1', True), ('127.1.2.3', True), ('::1', True), ('', False),
    ('10.0.0.1', False), ('localhost.example', False), ('127.0.0.1.example', False)])
def test_loopback(host, own):
    """Only names and addresses of the loopback interface are recognised as such."""
    assert is_loopback(host) is own


@pytest.mark.parametrize('host', ['nosuch', 'a..b'])
def test_a_host_that_is_none(host, monkeypatch, capsys):
    """It's named in one line, with code 1."""
    def unknown(name, *_, **__):
        name.encode('idna')
        raise socket.gaierror(socket.EAI_NONAME, 'Name or service not known')
    monkeypatch.setattr(socket, 'getaddrinfo', unknown)
    assert main(['select', '--host', host, '--port', '0']) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f'vtrack select: {host}: ') and 'Errno' not in line


def test_a_port_that_is_taken(capsys):
    """It's named in one line, with code 1."""
    with socket.create_server(('127.0.0.1', 0)) as other:
        port = other.getsockname()[1]
        assert main(['select', '--port', str(port)]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert str(port) in line and 'already in use' in line and 'Errno' not in line


def test_inputs_from_descriptors():
    """An infinite bound is left out; so are read-only parameters and those that aren't scalars."""
    described = [
        ParameterDescriptor(name='half', floating_point_range=[
            FloatingPointRange(from_value=0.0, to_value=sys.float_info.max)]),
        ParameterDescriptor(name='whole', integer_range=[
            IntegerRange(from_value=-2**63, to_value=7)]),
        ParameterDescriptor(name='fixed', read_only=True), ParameterDescriptor(name='list'),
        ParameterDescriptor(name='one', additional_constraints='valid: one of a, b')]
    values = [Parameter('', value=value).get_parameter_value()
              for value in (1.5, 3, True, [1.0], 'b')]
    assert parameter_inputs(described, values) == [
        {'name': 'half', 'kind': 'float', 'value': 1.5, 'text': '', 'low': 0.0},
        {'name': 'whole', 'kind': 'int', 'value': 3, 'text': '', 'high': 7},
        {'name': 'one', 'kind': 'text', 'value': 'b', 'text': '', 'choices': ['a', 'b']}]
    assert parameter_value('float', 2).double_value == 2.0
    for kind, value in (('int', True), ('int', '3'), ('int', 2**63), ('bool', 1), ('list', [])):
        with pytest.raises(ValueError, match='no value of kind'):
            parameter_value(kind, value)


@asynccontextmanager
async def served(capsys, folder, host='127.0.0.1', token=''):
    """Serve the page in this process, for a node that there isn't; yield what is printed."""
    serving = asyncio.create_task(serve('/nobody', host, 0, token, folder))
    while not (output := capsys.readouterr().out):
        assert not serving.done()
        await asyncio.sleep(0.01)
    try:
        yield output
    finally:
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)


@contextmanager
def observed():
    """Yield a node called tracker, its observer, their executor, and the pictures shown."""
    context = Context()
    rclpy.init(context=context)
    tracker, watcher = (Node(name, context=context) for name in ('tracker', 'watcher'))
    executor, shown = SingleThreadedExecutor(context=context), []
    for node in (tracker, watcher):
        executor.add_node(node)
    observer = Observer(
        watcher, '/tracker', lambda: shown.append(observer.picture()), print, print)
    observer.watched = True
    try:
        yield tracker, observer, executor, shown
    finally:
        nodes = executor.get_nodes()
        executor.shutdown()
        observer.destroy()
        for node in nodes:
            leave(node)
        rclpy.try_shutdown(context=context)


def spin_until(executor, condition, act=lambda: None):
    """Spin until a condition holds, with an action before each round."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        act()
        executor.spin_once(timeout_sec=0.1)


def test_an_answer_that_comes_before_its_image_is_shown_with_it():
    """Until its image comes, the previous image is shown, with its own box."""
    def stamped(message, second):
        message.header.stamp.sec = second
        return message

    def seen(publisher, message):
        """Publish a message; return stamp [s] and box of the picture after it has come."""
        changes.clear()
        publisher.publish(message)
        spin_until(executor, lambda: changes)
        _, shown = changes[-1]
        return int(shown['stamp']) // 10**9, shown.get('box')

    def answer(second):
        result = ObjectHypothesisWithPose()
        box = BoundingBox2D(size_x=2.0 * second, size_y=2.0 * second)
        return stamped(Detection2DArray(detections=[Detection2D(results=[result], bbox=box)]),
                       second)
    with observed() as (tracker, _, executor, changes):
        images = tracker.create_publisher(Image, '/image', 10)
        answers = tracker.create_publisher(Detection2DArray, '/detections', 10)
        tracker.create_subscription(Image, '/image', lambda _: None, 10)
        spin_until(executor, lambda: images.get_subscription_count() == 2
                   and answers.get_subscription_count())
        assert seen(images, stamped(Image(), 1)) == (1, None)
        assert seen(answers, answer(1)) == (1, [-1.0, -1.0, 2.0, 2.0])
        assert seen(answers, answer(2)) == (1, [-1.0, -1.0, 2.0, 2.0])
        assert seen(images, stamped(Image(), 2)) == (2, [-2.0, -2.0, 4.0, 4.0])


def test_a_node_that_comes_back_with_another_topic_is_followed():
    """As one whose remap was wrong; its images may be below its own name, too."""
    with observed() as (tracker, _, executor, shown):
        for topic, kind in (('/image', Image), ('/image_raw', Image),
                            ('/tracker/compressed', CompressedImage)):
            images = tracker.create_publisher(kind, topic, 10)
            subscription = tracker.create_subscription(kind, topic, lambda _: None, 10)
            shown.clear()
            spin_until(executor, lambda: any(isinstance(message, kind) for message, _ in shown),
                       lambda: images.publish(kind()))
            tracker.destroy_subscription(subscription)


def test_the_last_viewer_of_a_node_that_has_ended_leaves(tmp_path):
    """The camera goes on, but nothing is received or recorded any more."""
    with observed() as (tracker, observer, executor, _):
        camera = Node('camera', context=tracker.context)
        executor.add_node(camera)
        images = camera.create_publisher(Image, '/image', 10)
        tracker.create_subscription(Image, '/image', lambda _: None, 10)
        spin_until(executor, lambda: images.get_subscription_count() == 2)
        executor.remove_node(tracker)
        leave(tracker)
        spin_until(executor, lambda: 'tracker' not in camera.get_node_names())
        observer.record(tmp_path)
        observer.watched = False
        spin_until(executor, lambda: not images.get_subscription_count())
        [bag] = tmp_path.iterdir()
        assert bag.name.startswith('recording_')


def test_a_recording_has_what_comes_while_it_is_busy(tmp_path):
    """A moment's delay, as for the first image, loses nothing; nor do boxes without a result."""
    answer = Detection2DArray(detections=[Detection2D(bbox=BoundingBox2D(size_x=2.0, size_y=2.0))])
    with observed() as (tracker, observer, executor, shown):
        images = tracker.create_publisher(Image, '/image', 30)
        answers = tracker.create_publisher(Detection2DArray, '/detections', 30)
        tracker.create_subscription(Image, '/image', lambda _: None, 10)
        spin_until(executor, lambda: images.get_subscription_count() == 2
                   and answers.get_subscription_count())
        observer.record(tmp_path)
        for second in range(1, 21):
            image = Image(height=1, width=1, encoding='mono8', step=1, data=bytes(1))
            image.header.stamp.sec = answer.header.stamp.sec = second
            images.publish(image)
            answers.publish(answer)
        spin_until(executor, lambda: shown and shown[-1] and 'box' in shown[-1][1]
                   and shown[-1][1]['stamp'] == f'{20 * 10**9}')
        assert 'covariance' not in shown[-1][1]
        assert observer.finish_recording().startswith('20 images are in ')
    with BagReader(next(tmp_path.iterdir())) as bag:
        assert {topic.name: topic.count for topic in bag.topics.values()} == {
            '/image': 20, '/detections': 20}


def test_a_recording_without_images_ends_with_the_last_viewer(tmp_path):
    """As of a node that takes no images yet."""
    with observed() as (_, observer, *_):
        observer.look()
        observer.record(tmp_path)
        observer.watched = False
        observer.look()
        [bag] = tmp_path.iterdir()
        assert bag.name.startswith('recording_')


def test_it_closes_between_callbacks(monkeypatch):
    """A query of the graph that has begun is finished before its context is shut down."""
    begun, raised, look = threading.Event(), [], Observer.look

    def slow(one):
        begun.set()
        time.sleep(0.3)
        look(one)
    monkeypatch.setattr(Observer, 'look', slow)
    monkeypatch.setattr(threading, 'excepthook', raised.append)

    async def main():
        link = TrackerLink('/nobody', lambda: None, print, print)
        await asyncio.to_thread(begun.wait, PATIENCE)
        link.close()
    asyncio.run(main())
    assert begun.is_set() and not raised


def test_a_recording_that_takes_long(monkeypatch, tmp_path):
    """A disk that answers late is named; the answer that comes then is no error."""
    release, faults = threading.Event(), []

    def slow(_, folder):
        release.wait(PATIENCE)
        return 'recording'
    monkeypatch.setattr(Observer, 'record', slow)
    monkeypatch.setattr('vtrack_ros.selecting.tracker_link.SERVICE_TIMEOUT', 0.1)

    async def main():
        asyncio.get_running_loop().set_exception_handler(lambda _, fault: faults.append(fault))
        link = TrackerLink('/nobody', lambda: None, print, print)
        try:
            with pytest.raises(TimeoutError, match=f'the disk of {tmp_path} is slow'):
                await link.record(tmp_path)
        finally:
            release.set()
            link.close()
        await asyncio.sleep(0)
    asyncio.run(main())
    assert not faults


def test_recordings_of_the_same_second(tmp_path):
    """Each has a name of its own."""
    for count in range(1, 6):
        Recording(tmp_path).finish()
        assert len(list(tmp_path.iterdir())) == count


def test_a_viewer_whose_request_is_not_answered_leaves(monkeypatch, capsys, caplog, tmp_path):
    """Neither a warning of the node for it nor the end of the server meanwhile is an error."""
    asked, faults, links = threading.Event(), [], []

    class Link(TrackerLink):

        def __init__(self, target, changed, said, configured):
            super().__init__(target, changed, said, configured)
            links.append(said)

        async def ask(self, *_, **__):
            asked.set()
            await asyncio.sleep(PATIENCE)
    monkeypatch.setattr('vtrack_ros.selecting.server.TrackerLink', Link)

    async def main():
        asyncio.get_running_loop().set_exception_handler(lambda _, fault: faults.append(fault))
        async with served(capsys, tmp_path) as output:
            async with viewer(output.split()[0]) as seen:
                await seen.ask(do='reset')
                await asyncio.to_thread(asked.wait, PATIENCE)
                seen.socket.get_extra_info('socket').shutdown(socket.SHUT_RDWR)
            await asyncio.sleep(0.1)
            links[0]('a warning')
            await asyncio.sleep(0.1)
            gc.collect()
        await asyncio.sleep(0.1)
    asyncio.run(main())
    assert not faults and not caplog.records


@pytest.mark.parametrize('host, elsewhere', [('127.0.0.1', False), ('0.0.0.0', True)])
def test_an_address_that_leads_nowhere_from_another_machine(host, elsewhere, capsys, tmp_path):
    """That of all interfaces is printed with what to put in its place."""
    async def main():
        async with served(capsys, tmp_path, host, 'token') as output:
            return output
    output = asyncio.run(main())
    assert ("with this machine's name in place of 0.0.0.0" in output) is elsewhere


def test_recording_before_there_is_a_picture(capsys, tmp_path):
    """The page is told whether it records, or its button couldn't end it."""
    async def main():
        async with served(capsys, tmp_path) as output, viewer(output.split()[0]) as seen:
            for on in (True, False):
                await seen.ask(do='record', on=on)
                assert (await seen.receive('state'))['recording'] is on
    asyncio.run(main())


def test_what_fails_is_not_hidden(monkeypatch, capsys, caplog, tmp_path):
    """If a part of a viewer fails, its connection is closed and the error is logged."""
    async def broken(self):
        raise RuntimeError('out of order')
    monkeypatch.setattr(TrackerLink, 'reachable', True)
    monkeypatch.setattr(TrackerLink, 'parameters', broken)

    async def main():
        async with served(capsys, tmp_path) as output, viewer(output.split()[0]) as seen:
            assert (await seen.socket.receive(PATIENCE)).type is aiohttp.WSMsgType.CLOSED
    asyncio.run(main())
    assert 'out of order' in caplog.text
