"""The page of a node that isn't there, of one that answers late, and of odd image sizes."""

import asyncio
import re
import shutil

import cv2
from geometry_msgs.msg import PointStamped
from node_harness import Client, NodeProcess, Scene, STEP
import numpy as np
from page_viewer import answer, serving, viewer
from std_srvs.srv import SetBool, Trigger
from vision_msgs.msg import Detection2D


def test_token():
    """With --host the page needs the token in its URL; it says that it waits for the node."""
    async def run(whole):
        assert re.fullmatch(r'http://127.0.0.1:\d+/[\w-]{20,}/', whole)
        root = whole.rsplit('/', 2)[0]
        for path in ('', '/', '/ws', '/page.js', '/wrong/', '/wrong/ws', '/%ff/'):
            assert await answer(root + path) == 403, path
        assert await answer(whole) == await answer(f'{whole}page.css') == 200
        assert await answer(f'{whole}other') == 404
        async with viewer(whole) as seen:
            assert (await seen.told('waiting for the node /nobody'))['wrong']
    with serving('--host', '127.0.0.1', 'nobody') as whole:
        asyncio.run(run(whole))


def test_the_state_of_a_node_without_images():
    """The page shows it where no camera runs."""
    async def run(address):
        async with viewer(address) as seen:
            while (await seen.receive('state'))['state'].get('name') != 'waiting':
                pass
    with NodeProcess(), serving() as address:
        asyncio.run(run(address))


def test_parameters_of_a_node_that_answers_late():
    """The page says that a node doesn't answer, and has its parameters as soon as it does."""
    async def run(address, client):
        async with viewer(address) as seen:
            assert (await seen.told('did not answer'))['wrong']
            told = asyncio.create_task(seen.receive('parameters'))
            await asyncio.to_thread(client.until, told.done, 'nobody asked again')
            assert 'use_sim_time' in [row['name'] for row in (await told)['rows']]
    # a node with a tracking node's services and topics, which doesn't answer until it's spun
    with Client(publish=None) as client:
        for name, kind in (
                ('reset', Trigger), ('reinit', Trigger), ('larger', Trigger),
                ('smaller', Trigger), ('enable', SetBool)):
            client.node.create_service(kind, f'~/{name}', lambda request, response: response)
        for name, kind in (('init', Detection2D), ('init_point', PointStamped)):
            client.node.create_subscription(kind, f'~/{name}', lambda message: None, 1)
        with serving(client.node.get_name()) as address:
            asyncio.run(run(address, client))


async def sending(client, scene, wanted):
    """Send frames of a scene until a task is done; return its result."""
    task, index = asyncio.create_task(wanted), 0
    while not task.done():
        await asyncio.to_thread(client.send, scene.frame(index % 100), client.start + STEP * index)
        index += 1
    client.start += STEP * index
    return await task


def test_particles_are_for_those_who_want_them():
    """A viewer that didn't ask gets none; the node makes none once the one that did has left."""
    def made():
        return client.node.count_subscribers('/tracker/particles')

    async def run(address, scene):
        async with viewer(address) as other:
            async with viewer(address) as one:
                await one.ask(do='particles', on=True)
                await sending(client, scene, one.until(lambda shown: shown.get('particles')))
                shown = await sending(client, scene, other.until(lambda shown: 'box' in shown))
                assert 'particles' not in shown
                assert made() == 1
            await asyncio.to_thread(client.until, lambda: not made(), 'still made')
    scene = Scene()
    start = [int(value) for value in scene.box(0).as_array()]
    with NodeProcess(init_box=start), Client() as client, serving() as address:
        client.ready()
        asyncio.run(run(address, scene))


def test_a_node_that_ends_has_no_state():
    """The images go on, but the page no longer says that the target is tracked."""
    async def run(address, node, scene):
        async with viewer(address) as seen:
            await sending(client, scene, seen.until(lambda shown: 'box' in shown))
            assert await asyncio.to_thread(node.stop) == 0
            ended = asyncio.create_task(seen.until(lambda shown: not shown['state']))
            while not ended.done():
                await asyncio.to_thread(
                    client.send, scene.frame(0), client.start, answered=False)
                client.start += STEP
                await asyncio.sleep(0.03)
            await ended
    scene = Scene()
    start = [int(value) for value in scene.box(0).as_array()]
    with NodeProcess(init_box=start) as node, Client() as client, serving() as address:
        client.ready()
        asyncio.run(run(address, node, scene))


def test_recording_into_a_folder_that_goes_away(tmp_path):
    """As when a drive is unplugged: the viewer is told, and the page goes on."""
    folder = tmp_path / 'drive'

    async def run(address, scene):
        async with viewer(address) as seen:
            await seen.ask(do='record', on=True)
            await sending(client, scene, seen.until(lambda shown: shown['recording']))
            shutil.rmtree(folder)
            await sending(client, scene, seen.told(str(folder)))
            await sending(client, scene, seen.until(lambda shown: not shown['recording']))
            await seen.ask(do='record', on=True)
            await sending(client, scene, seen.until(lambda shown: shown['recording']))
    with (NodeProcess(), Client() as client,
          serving('--recordings', str(folder)) as address):
        client.ready()
        asyncio.run(run(address, Scene()))


def test_line_of_pixels():
    """An image whose scaled picture would be less than a pixel high is shown one pixel high."""
    async def run(address, client):
        line = np.full((2, 6000, 3), 128, np.uint8)
        async with viewer(address) as seen:
            shown = asyncio.create_task(seen.receive('picture'))
            stamp = STEP
            while not shown.done():
                await asyncio.to_thread(client.send, line, stamp)
                stamp += STEP
            picture = await shown
            assert (picture['width'], picture['height']) == (6000, 2)
            jpeg = cv2.imdecode(np.frombuffer(picture['jpeg'], np.uint8), cv2.IMREAD_COLOR)
            assert jpeg.shape == (1, 1280, 3)
    with NodeProcess(), Client() as client, serving() as address:
        asyncio.run(run(address, client.ready()))
