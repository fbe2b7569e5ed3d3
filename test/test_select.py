"""The page of vtrack select, over its WebSocket: display, requests, and refused access."""

import asyncio
from contextlib import contextmanager
import os
from urllib.parse import urlsplit

import aiohttp
from bag_material import write_slow_bag
import cv2
from forked_process import ForkedProcess
from node_harness import NodeProcess, PATIENCE
import numpy as np
from page_viewer import answer, serving, viewer
import pytest

from vtrack_ros.bags import BagReader
from vtrack_ros.dds import with_profile
from vtrack_ros.geometry import Box


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return the path of the bag that is played."""
    return write_slow_bag(tmp_path_factory.mktemp('bags') / 'slow')


@pytest.fixture(scope='module')
def truth(bag):
    """Return its true boxes by stamp."""
    with BagReader(bag) as reader:
        return reader.truth()


@contextmanager
def playing(bag, rate=1):
    """Play a bag in a loop."""
    player = ForkedProcess(
        'vtrack_ros.cli.command_line', 'main',
        ['play', str(bag), '--loop', '--rate', str(rate), '--topic', 'image'],
        with_profile(os.environ))
    try:
        yield
    finally:
        player.send_signal(2)
        player.wait(PATIENCE)


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    """Return the folder for recordings."""
    return tmp_path_factory.mktemp('recordings')


@pytest.fixture(scope='module')
def address(bag, recordings):
    """Play a bag to a node, and serve its page."""
    with NodeProcess(), serving('--recordings', str(recordings)) as address, playing(bag, 0.25):
        yield address


def state(name):
    """Return a predicate that tells whether a picture's state has a name."""
    return lambda picture: picture['state'].get('name') == name


def overlap(picture, truth):
    """Return the overlap of a picture's box with the truth of its stamp."""
    return Box(*picture['box']).iou(truth[int(picture['stamp'])]) if 'box' in picture else 0.0


async def fresh(seen):
    """Reset the target; return a picture that the node has received, long before the bag's end."""
    # Parameters are sent once the node is found.
    await seen.receive('parameters')
    await seen.ask(do='reset')
    return await seen.until(lambda picture: state('waiting')(picture)
                            and float(picture['state'].get('ms_per_frame', 0)) > 0
                            and int(picture['stamp']) < 15 * 10**9)


def test_box(address, truth):
    """A box on a picture is tracked, and shown on the pictures that it belongs to."""
    async def run():
        async with viewer(address) as seen:
            picture = await fresh(seen)
            jpeg = cv2.imdecode(np.frombuffer(picture['jpeg'], np.uint8), cv2.IMREAD_COLOR)
            assert jpeg.shape == (picture['height'], picture['width'], 3)
            box = truth[int(picture['stamp'])]
            await seen.ask(do='box', stamp=picture['stamp'], x=box.x, y=box.y, width=box.width,
                           height=box.height)
            picture = await seen.until(
                lambda one: len(one['trail']) > 5 and state('tracking')(one))
            assert overlap(picture, truth) > 0.4
            assert float(picture['state']['confidence']) > 0.3
            assert float(picture['state']['ms_per_frame']) > 0
            xx, xy, yy = picture['covariance']
            assert xx > 0 and xx * yy > xy**2
    asyncio.run(run())


def test_click(address, truth):
    """A click on the target starts on it."""
    async def run():
        async with viewer(address) as seen:
            picture = await fresh(seen)
            x, y = truth[int(picture['stamp'])].center
            await seen.ask(do='click', stamp=picture['stamp'], x=x, y=y)
            picture = await seen.until(lambda one: len(one['trail']) > 2)
            box, true = Box(*picture['box']), truth[int(picture['stamp'])]
            assert box.center_distance(true) < true.width / 2
    asyncio.run(run())


def test_refusal_is_shown(address):
    """The node's refusal of a selection is sent to the page."""
    async def run():
        async with viewer(address) as seen:
            picture = await fresh(seen)
            await seen.ask(do='click', stamp=picture['stamp'], x=-5, y=3)
            assert (await seen.told('~/init_point refused'))['wrong']
    asyncio.run(run())


def test_pictures_wait_for_the_viewer(address):
    """No picture is sent before the page has acknowledged the last one."""
    async def run():
        async with viewer(address) as seen:
            await fresh(seen)
            await seen.receive('picture')
            for _ in range(5):
                await seen.ask(do='reset')
                message = await seen.socket.receive_json()
                while message['kind'] != 'told':
                    assert message['kind'] != 'picture'
                    message = await seen.socket.receive_json()
            await seen.ask(do='shown')
            await seen.receive('picture')
    asyncio.run(run())


def test_parameters(address):
    """Inputs are made from the descriptors; a valid value is set, a wrong one is refused."""
    async def run():
        async with viewer(address) as seen:
            rows = {row['name']: row for row in (await seen.receive('parameters'))['rows']}
            assert {'gmpf', 'dcf'} < set(rows['tracker']['choices'])
            particles = rows['gmpf.particles']
            assert (particles['kind'], particles['low'], particles['high']) == ('int', 2, 5000)
            assert rows['init_score']['high'] == 1.0 and rows['init_class']['kind'] == 'text'
            assert rows['init_from_detections']['value'] is False
            assert 'image_transport' not in rows and 'init_box' not in rows
            await seen.ask(do='set', name='tracker', kind='text', value='dcf')
            await seen.until(lambda one: one['state']['tracker'] == 'dcf')
            await seen.ask(do='set', name='gmpf.particles', kind='int', value=1)
            assert (await seen.told('from 2 to 5000'))['wrong']
            # After a refusal the page is sent the values in force.
            rows = {row['name']: row for row in (await seen.receive('parameters'))['rows']}
            assert rows['tracker']['value'] == 'dcf' and rows['gmpf.particles']['value'] == 150
            await seen.ask(do='set', name='tracker', kind='text', value='gmpf')
            await seen.told('tracker is gmpf')
    asyncio.run(run())


def test_pause(address):
    """While the node is paused pictures are shown, without a box."""
    async def run():
        async with viewer(address) as seen:
            await fresh(seen)
            await seen.ask(do='enable', on=False)
            await seen.until(state('paused'))
            before = (await seen.receive('picture'))['stamp']
            await seen.ask(do='shown')
            await seen.until(lambda one: one['stamp'] != before and 'box' not in one)
            await seen.ask(do='enable', on=True)
            await seen.until(state('waiting'))
    asyncio.run(run())


@pytest.mark.parametrize('text, words', [
    ('nonsense', 'refused'), ('[]', 'refused'), ('{}', 'do'), ('{"do": "fly"}', "'fly'"),
    pytest.param('[' * 4000, 'refused', id='nested'),
    ('{"do": "box", "stamp": "1", "x": 1, "y": 1, "width": 0, "height": 5}', 'positive'),
    ('{"do": "box", "stamp": "-1", "x": 1, "y": 1, "width": 5, "height": 5}', 'stamp'),
    ('{"do": "click", "stamp": "1", "x": "here", "y": 1}', 'here'),
    ('{"do": "set", "name": "seed", "kind": "int", "value": 1.5}', 'from 0 to 2147483647, not'),
    ('{"do": "set", "name": "history_seconds", "kind": "float", "value": ""}', 'from 0 to 30 s'),
    ('{"do": "set", "name": "seed", "kind": "list", "value": []}', "no value of kind 'list'")])
def test_bad_request(address, text, words):
    """A bad request is refused with the reason, and the connection stays open."""
    async def run():
        async with viewer(address) as seen:
            await seen.socket.send_str(text)
            assert (await seen.told(words))['wrong']
            await seen.receive('picture')
    asyncio.run(run())


def test_oversized_message(address):
    """A message that is larger than any request closes the connection, with code 1009."""
    async def run():
        async with viewer(address) as seen:
            await seen.socket.send_str('x' * 100_000)
            message = await seen.socket.receive(PATIENCE)
            while message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
                message = await seen.socket.receive(PATIENCE)
            assert (message.type, message.data) == (aiohttp.WSMsgType.CLOSE, 1009)
    asyncio.run(run())


def test_other_origin(address):
    """A WebSocket with another Origin or Host header is refused, with status 403."""
    async def run():
        for headers in ({'Origin': 'http://elsewhere.example'}, {'Origin': 'null'},
                        {'Origin': address.replace('http:', 'https:').rstrip('/') + '1'},
                        {'Host': 'elsewhere.example'}):
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                async with viewer(address, headers=headers):
                    pass
            assert refused.value.status == 403
        assert await answer(address, Host='elsewhere.example') == 403
        async with viewer(address, headers={'Origin': address.rstrip('/')}) as seen:
            await seen.receive('parameters')
    asyncio.run(run())


@pytest.mark.parametrize('request_line, headers, status', [
    ('OPTIONS *', ['Host: localhost'], 404), ('GET /', ['Host: [::1'], 403),
    ('GET /', ['Host: localhost', 'Origin: http://[x'], 403)])
def test_malformed_http(address, request_line, headers, status):
    """A request whose path, Host or Origin is malformed is refused, without a traceback."""
    async def run():
        url = urlsplit(address)
        reader, writer = await asyncio.open_connection(url.hostname, url.port)
        lines = [f'{request_line} HTTP/1.1', *headers, 'Connection: close', '', '']
        writer.write('\r\n'.join(lines).encode())
        assert (await reader.readline()).startswith(f'HTTP/1.1 {status} '.encode())
        writer.close()
    asyncio.run(run())


def test_particles(address, truth):
    """Particles are only sent on request, and their mean is near the box's centre."""
    async def run():
        async with viewer(address) as seen:
            picture = await fresh(seen)
            assert 'particles' not in picture
            await seen.ask(do='particles', on=True)
            box = truth[int(picture['stamp'])]
            await seen.ask(do='box', stamp=picture['stamp'], x=box.x, y=box.y, width=box.width,
                           height=box.height)
            picture = await seen.until(lambda one: one.get('particles') and 'box' in one)
            assert len(picture['particles']) == 150
            assert Box(*picture['box']).center == pytest.approx(
                np.mean(picture['particles'], 0), abs=box.width)
            await seen.ask(do='particles', on=False)
            await seen.until(lambda one: 'particles' not in one)
            await seen.ask(do='reset')
    asyncio.run(run())


def test_record(address, truth, bag, recordings):
    """A recording is a bag with the images' own stamps and pixels, and the detections."""
    async def run():
        async with viewer(address) as seen:
            picture = await fresh(seen)
            assert picture['recording'] is False
            await seen.ask(do='record', on=True)
            await seen.until(lambda one: one['recording'])
            box = truth[int(picture['stamp'])]
            await seen.ask(do='box', stamp=picture['stamp'], x=box.x, y=box.y, width=box.width,
                           height=box.height)
            await seen.until(lambda one: len(one['trail']) > 2)
            await seen.ask(do='record', on=False)
            await seen.told('images are in ')
            await seen.ask(do='reset')
    asyncio.run(run())
    [path] = recordings.iterdir()
    with BagReader(bag) as played, BagReader(path) as recorded:
        frames = {image.stamp: image.frame for image in played.frames()}
        seen = list(recorded.frames())
        assert '/detections' in recorded.topics
    assert len(seen) > 1
    for image in seen:
        np.testing.assert_array_equal(image.frame, frames[image.stamp])
