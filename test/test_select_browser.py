"""The page in a real browser, as a person uses it."""

import asyncio
from contextlib import contextmanager
from itertools import count
from threading import Event, Thread

from browser import CHROMIUM, open_page
import cv2
from node_harness import Client, image_message, NodeProcess, Scene, STEP
import numpy as np
from page_viewer import serving
import pytest

from vtrack_ros.geometry import Box


@contextmanager
def camera(scene):
    """Send ten images per second of a target at rest; yield the client, and what hides it."""
    hidden, done = Event(), Event()

    def send():
        rng = np.random.default_rng(0)
        for index in count():
            if done.wait(0.1):
                return
            noise = rng.integers(0, 5, (scene.height, scene.width, 3), np.uint8)
            frame = scene.frame(0, visible=not hidden.is_set())
            client.images.publish(image_message(frame + noise, 10**10 + STEP * index))
    with Client() as client:
        thread = Thread(target=send)
        thread.start()
        try:
            yield client, hidden
        finally:
            done.set()
            thread.join()


async def on_page(page, *points):
    """Return the places on the page, in its current layout, of points of the 160 x 120 picture."""
    area = await page.value('canvas.getBoundingClientRect().toJSON()')
    scale = min(area['width'] / 160, area['height'] / 120)
    left = area['left'] + (area['width'] - scale * 160) / 2
    top = area['top'] + (area['height'] - scale * 120) / 2
    return [(left + scale * x, top + scale * y) for x, y in points]


@pytest.mark.skipif(CHROMIUM is None, reason='needs Chromium')
def test_in_a_browser(tmp_path):
    """Drag, track, change the tracker, reset, click, lose; drag with a finger on a phone."""
    box = Scene().box(0)

    async def run(address, client, hidden):
        async with open_page(address, tmp_path) as page:
            await page.until('document.readyState == "complete" && header != null')
            await page.until("$('state').textContent == 'waiting' "
                             "&& $('parameters').children.length > 0")
            # the node receives images, and so buffers the one that is drawn on
            await page.until("$('ms').textContent != '-'")
            # the canvas has the picture's aspect ratio from the first picture on
            await page.until('canvas.width * 3 == canvas.height * 4')
            await page.painted()
            await page.mouse(*await on_page(
                page, (box.x, box.y), box.center, (box.x + box.width, box.y + box.height)))
            await page.until("header.box && $('state').textContent == 'tracking'")
            assert Box(*await page.value('header.box')).iou(box) > 0.7
            await page.value("(() => { const one = document.querySelector('[name=tracker]'); "
                             "one.value = 'abmspf'; one.onchange(); })()")
            await page.until("$('tracker').textContent == 'abmspf'")
            assert await page.value(
                "[...$('parameters').children].filter(one => !one.hidden)"
                '.map(one => one.dataset.owner).join()') == ',abmspf'
            await page.value("(() => { const one = [...document.querySelectorAll('[type=range]')]"
                             ".find(one => one.ariaLabel == 'abmspf.particles'); "
                             'one.value = 0.2; one.oninput(); one.onchange(); })()')
            await page.until("$('told').textContent == 'abmspf.particles is 81'")
            assert client.change(abmspf__particles=70)[0].successful
            await page.until("document.querySelector('[name=\"abmspf.particles\"]').value == 70")
            await page.value('(() => { const one = document.querySelector('
                             "'[name=history_seconds]'); one.value = ''; one.onchange(); })()")
            await page.until("$('told').className == 'wrong' "
                             "&& document.querySelector('[name=history_seconds]').value == 3")
            await page.value("$('reset').click()")
            await page.until("$('state').textContent == 'waiting'")
            await page.painted()
            await page.mouse(*await on_page(page, box.center))
            await page.until("header.box && $('state').textContent == 'tracking'")
            assert Box(*await page.value('header.box')).iou(box) > 0.4
            area = Box(*await page.value('header.box')).area
            await page.key('+')
            await page.until("$('told').textContent.startsWith('restarted on')")
            await page.until(f'header.box && header.box[2] * header.box[3] > 1.2 * {area}')
            await page.value("$('smaller').click()")
            await page.until(f'header.box && header.box[2] * header.box[3] < 1.2 * {area}')
            await page.until('header.trail.length > 5')
            await page.value("$('particles').click()")
            await page.until('header.particles')
            await page.until("['confidences', 'speeds'].every("
                             "name => $(name).getAttribute('d').split('L').length > 3)")
            await page.screenshot(tmp_path / 'page.png')
            assert cv2.imread(str(tmp_path / 'page.png')).shape[2] == 3
            hidden.set()
            await page.until("!header.box && $('state').textContent == 'searching'")
            hidden.clear()
            await page.until("header.box && $('state').textContent == 'tracking'")
            assert Box(*await page.value('header.box')).iou(box) > 0.4
            await page.phone()
            assert await page.value('document.documentElement.scrollWidth <= innerWidth')
            await page.value("$('reset').click()")
            await page.until("$('state').textContent == 'waiting'")
            # a second finger, as of the hand that holds the phone, isn't part of the box
            await page.finger(*await on_page(
                page, (box.x, box.y), box.center, (box.x + box.width, box.y + box.height)),
                resting=(await on_page(page, (5, 115)))[0])
            await page.until("header.box && $('state').textContent == 'tracking'")
            assert Box(*await page.value('header.box')).iou(box) > 0.7
    with NodeProcess(), serving() as address, camera(Scene()) as sent:
        asyncio.run(run(address, *sent))
