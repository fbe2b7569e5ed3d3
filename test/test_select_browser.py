"""The page in a real browser, as a person uses it."""

import asyncio

from bag_material import write_slow_bag
from browser import CHROMIUM, open_page
import cv2
from node_harness import NodeProcess, Scene
import pytest
from test_select import playing, serving

from vtrack_ros.geometry import Box


async def on_page(page, *points):
    """Return where points of the picture, 160 x 120, are on the page as it is laid out now."""
    area = await page.value('canvas.getBoundingClientRect().toJSON()')
    scale = min(area['width'] / 160, area['height'] / 120)
    left = area['left'] + (area['width'] - scale * 160) / 2
    top = area['top'] + (area['height'] - scale * 120) / 2
    return [(left + scale * x, top + scale * y) for x, y in points]


@pytest.mark.skipif(CHROMIUM is None, reason='needs Chromium')
def test_in_a_browser(tmp_path):
    """Drag, track, change the tracker, reset, click."""
    bag, box = write_slow_bag(tmp_path / 'still', pace=0), Scene().box(0)

    async def run(address):
        async with open_page(address, tmp_path) as page:
            await page.until('document.readyState == "complete" && header != null')
            await page.until("$('state').textContent == 'waiting' "
                             "&& $('parameters').children.length > 0")
            # its shape is the picture's from the first one on
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
            await page.value("$('reset').click()")
            await page.until("$('state').textContent == 'waiting'")
            await page.painted()
            await page.mouse(*await on_page(page, box.center))
            await page.until("header.box && $('state').textContent == 'tracking'")
            assert Box(*await page.value('header.box')).iou(box) > 0.4
            await page.until('header.trail.length > 5')
            await page.value("$('particles').click()")
            await page.until('header.particles')
            await page.until("['confidences', 'speeds'].every("
                             "name => $(name).getAttribute('d').split('L').length > 3)")
            await page.screenshot(tmp_path / 'page.png')
            assert cv2.imread(str(tmp_path / 'page.png')).shape[2] == 3
    # Slowly: it must not begin again, with no target, in mid-test.
    with NodeProcess(), serving() as address, playing(bag, 0.1):
        asyncio.run(run(address))
