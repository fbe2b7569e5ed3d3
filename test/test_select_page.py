"""The page in a real browser, whose server says what a test wants."""

import asyncio
from contextlib import asynccontextmanager
from importlib.resources import files
import json

from aiohttp import web
from browser import CHROMIUM, open_page, PATIENCE
import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason='needs Chromium')

#: Two parameters, as the server describes them.
PARTICLES = {'name': 'gmpf.particles', 'kind': 'int', 'value': 2, 'text': 'Number of particles.',
             'low': 2, 'high': 5000}
SCORE = {'name': 'init_score', 'kind': 'float', 'value': 0.5, 'text': 'Minimum score.',
         'low': 0.0, 'high': 1.0}


class Server:
    """The other end of the page: the requests that have come, and what is sent to it."""

    def __init__(self):
        self.requests = []
        self.open = True
        self.socket = None

    async def viewing(self, request):
        """Receive what the page asks for."""
        if not self.open:
            raise web.HTTPServiceUnavailable
        self.socket = web.WebSocketResponse()
        await self.socket.prepare(request)
        async for message in self.socket:
            self.requests.append(json.loads(message.data))
        return self.socket

    async def send(self, kind, **content):
        """Send a message."""
        await self.socket.send_json({'kind': kind, **content})

    async def show(self, stamp, width=160, height=120, state='waiting', **content):
        """Send a picture, and wait until it's shown."""
        await self.send('picture', width=width, height=height, stamp=str(stamp), trail=[],
                        state={'name': state, 'tracker': 'gmpf'},
                        **{'recording': False, **content})
        _, jpeg = cv2.imencode('.jpg', np.full((height, width, 3), 90, np.uint8))
        await self.socket.send_bytes(jpeg.tobytes())
        await self.asked('shown')

    async def asked(self, do):
        """Return the next request, which has to be of that kind."""
        async with asyncio.timeout(PATIENCE):
            while not self.requests:
                await asyncio.sleep(0.01)
        request = self.requests.pop(0)
        assert request['do'] == do, request
        return request


@asynccontextmanager
async def page_alone(profile):
    """Open the page; yield it and its server."""
    server, folder = Server(), files('vtrack_ros.selecting').joinpath('web')

    async def file(request):
        return web.FileResponse(folder / (request.match_info['name'] or 'page.html'))
    application = web.Application()
    application.router.add_get('/ws', server.viewing)
    application.router.add_get('/{name:.*}', file)
    runner = web.AppRunner(application, shutdown_timeout=0.1)
    await runner.setup()
    try:
        await web.TCPSite(runner, '127.0.0.1', 0).start()
        address = f'http://127.0.0.1:{runner.addresses[0][1]}/'
        async with open_page(address, profile) as page:
            await page.until('document.readyState == "complete" && socket.readyState == 1')
            await page.painted()
            yield page, server
    finally:
        await runner.cleanup()


def test_boxes_and_clicks(tmp_path):
    """Boxes are drawn in any direction; a click beside the picture, or without server, is none."""
    async def run():
        async with page_alone(tmp_path) as (page, server):
            await server.show(1, 120, 480)
            await page.until('canvas.width * 4 == canvas.height')
            await page.painted()
            area = await page.value('canvas.getBoundingClientRect().toJSON()')
            scale = area['height'] / 480
            left, top = area['left'] + (area['width'] - scale * 120) / 2, area['top']
            # of a picture that is higher than it is wide, lines have their usual width
            assert await page.value('pen.lineWidth') * scale == pytest.approx(2)
            await page.mouse((left - 50, top + 50))
            for start, end in (
                    ((90, 300), (30, 100)), ((30, 300), (90, 100)), ((-40, 100), (90, 300))):
                await page.mouse(*((left + scale * x, top + scale * y) for x, y in (start, end)))
                request = await server.asked('box')
                x = max(min(start[0], end[0]), 0)
                assert [request[name] for name in ('x', 'y', 'width', 'height')] == pytest.approx(
                    [x, 100, 90 - x, 200], abs=1e-3)
            await page.mouse((left + scale * 60, top + scale * 240))
            assert (await server.asked('click'))['x'] == pytest.approx(60)
            # a box that was begun can be given up
            for kind, x in (('mousePressed', 60), ('mouseMoved', 100)):
                await page.ask('Input.dispatchMouseEvent', type=kind, x=left + scale * x,
                               y=top + 50, button='left', buttons=1, clickCount=1)
            assert await page.value('drag.moved')
            await page.press('Escape')
            assert await page.value('drag') is None
            await page.ask('Input.dispatchMouseEvent', type='mouseReleased', x=left + scale * 100,
                           y=top + 50, button='left', clickCount=1)
            # a key that is held down is one step
            await page.key('+')
            await page.ask('Input.dispatchKeyEvent', type='keyDown', key='+', text='+',
                           autoRepeat=True)
            await page.key('-')
            await server.asked('larger')
            await server.asked('smaller')
            # while it's paused the node takes no image, and would refuse the selection later
            await server.show(2, 120, 480, state='paused')
            await page.mouse((left + scale * 60, top + scale * 240))
            await page.until("$('told').textContent == 'not sent: press Go on first'")
            assert not server.requests
            await server.show(3, 120, 480)
            server.open = False
            await server.socket.close()
            await page.until("$('state').textContent == 'no connection'")
            await page.mouse((left + scale * 60, top + scale * 240))
            await page.until("$('told').textContent.startsWith('not sent: there is no')")
    asyncio.run(run())


def test_parameters_by_keyboard(tmp_path):
    """Arrow keys move a slider; values in force are shown, but not over what is being typed."""
    async def run():
        async with page_alone(tmp_path) as (page, server):
            field = "$('parameters').elements.namedItem('%s')"
            particles, score = (field % row['name'] for row in (PARTICLES, SCORE))
            slider = "document.querySelector('[aria-label=\"gmpf.particles\"]')"
            backbone = {'name': 'gmpf.siamese.backbone', 'kind': 'text', 'value': '', 'text': ''}
            rows = [SCORE, PARTICLES, backbone]
            await server.send('parameters', rows=rows)
            await server.show(1)
            await page.until(f'{particles}.value == 2')
            assert 'siamese.backbone' in await page.value("$('parameters').innerText")
            # a screen reader takes an input's description from the input, not from around it
            assert await page.value(f'{score}.title') == SCORE['text']
            await page.value(f'{slider}.focus()')
            for _ in range(5):
                await page.press('ArrowRight')
                chosen = (await server.asked('set'))['value']
                await server.send('values', values={'gmpf.particles': chosen})
                await page.until(f'{slider}.ariaValueText == {chosen}')
            assert chosen > 2
            await page.value(f'{particles}.focus()')
            await server.send('values', values={'gmpf.particles': 20})
            await page.until(f'{particles}.value == 20')
            await page.value(f'{particles}.select()')
            await page.ask('Input.insertText', text='1')
            await page.press('Enter')
            assert (await server.asked('set'))['value'] == 1
            await page.value(f'{score}.focus(); {score}.select()')
            await page.ask('Input.insertText', text='0.7')
            await server.send('parameters', rows=rows)
            await page.until(f'{particles}.value == 2')
            assert await page.value(f'document.activeElement == {score} && {score}.value == 0.7')
            await page.press('Enter')
            assert (await server.asked('set'))['value'] == 0.7
            for text, value in (('0,25', 0.25), ('1e-2', 0.01), ('0.5 m', '0.5 m')):
                await page.value(f"{score}.value = ''")
                for character in text:
                    await page.key(character)
                await page.press('Enter')
                assert (await server.asked('set'))['value'] == value
            await server.send('parameters', rows=rows[:2])
            await page.until(f'!{field % backbone["name"]}')
    asyncio.run(run())


#: Returns the contrast of an element's text with the page, by the formula of WCAG 2.
CONTRAST = """(one => {
    const probe = document.body.appendChild(document.createElement('i'));
    probe.style.background = 'Canvas';
    const numbers = text => text.match(/[\\d.]+/g).slice(0, 3).map(Number);
    const ground = numbers(getComputedStyle(probe).backgroundColor);
    probe.remove();
    let opacity = 1;
    for (let each = one; each; each = each.parentElement) {
        opacity *= getComputedStyle(each).opacity;
    }
    const text = numbers(getComputedStyle(one).color).map(
        (value, index) => opacity * value + (1 - opacity) * ground[index]);
    const light = colour => colour.map(value => value / 255).map(
        value => value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4
    ).reduce((sum, value, index) => sum + [0.2126, 0.7152, 0.0722][index] * value, 0);
    const [dark, bright] = [light(text), light(ground)].sort((a, b) => a - b);
    return (bright + 0.05) / (dark + 0.05);
})"""


def test_it_can_be_read(tmp_path):
    """Text has contrast, in light and in dark; only news is spoken; nothing is wider than it."""
    async def run():
        async with page_alone(tmp_path) as (page, server):
            await server.send('state', state={'name': 'waiting'}, recording=True)
            await page.until("$('record').textContent == 'Stop recording'")
            await page.value("$('record').click()")
            assert await server.asked('record') == {'do': 'record', 'on': False}
            await server.show(1, state='tracking')
            await page.until("$('state').textContent == 'tracking'")
            assert await page.value("$('state').ariaLive") == 'polite'
            await page.value("globalThis.spoken = $('state').firstChild")
            await server.show(2, state='tracking')
            assert await page.value("$('state').firstChild == spoken")
            await server.send('told', text='no', wrong=True)
            await page.until("$('told').className == 'wrong'")
            for scheme in ('light', 'dark'):
                await page.ask('Emulation.setEmulatedMedia', features=[
                    {'name': 'prefers-color-scheme', 'value': scheme}])
                for name in ('searching', 'lost', 'tracking'):
                    await server.show(3, state=name)
                    await page.until(f"$('state').textContent == '{name}'")
                    assert await page.value(f"{CONTRAST}($('state'))") >= 4.5, (scheme, name)
                for selector in ('#told', '#legend', '.confidence', '.speed', 'dt', '#hint'):
                    seen = await page.value(f"{CONTRAST}(document.querySelector('{selector}'))")
                    assert seen >= 4.5, (scheme, selector)
            assert await page.value(
                "[...document.querySelectorAll('meter, input, select, canvas, button')].every("
                'one => one.ariaLabel || one.labels?.length || one.textContent)')
            await page.phone()
            long = {**PARTICLES, 'name': 'gmpf.' + 30 * 'n'}
            await server.send('parameters', rows=[SCORE, long])
            await server.send('told', text=200 * 'n', wrong=False)
            await server.show(4, recording=True)
            for width in (390, 320):
                await page.ask('Emulation.setDeviceMetricsOverride', width=width, height=640,
                               deviceScaleFactor=2, mobile=True)
                await page.painted()
                wide = await page.value('document.documentElement.scrollWidth')
                assert wide <= width
            # a finger slips while it taps
            area = await page.value('canvas.getBoundingClientRect().toJSON()')
            x, y = area['left'] + area['width'] / 2, area['top'] + 99
            for kind, slip in (('touchStart', 0), ('touchMove', 3), ('touchMove', 7)):
                await page.ask('Input.dispatchTouchEvent', type=kind,
                               touchPoints=[{'x': x + slip, 'y': y + slip}])
            await page.ask('Input.dispatchTouchEvent', type='touchEnd', touchPoints=[])
            assert (await server.asked('click'))['x'] == pytest.approx(80)
    asyncio.run(run())
