"""A real Chromium, controlled over its DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
import shutil
from typing import Any

import aiohttp

PATIENCE = 20.0
CHROMIUM = next(filter(None, map(shutil.which, (
    'chromium', 'chromium-browser', 'google-chrome'))), None)


class Page:
    """A page in the browser."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._number = 0

    async def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol."""
        self._number += 1
        await self._socket.send_json(
            {'id': self._number, 'method': method, 'params': parameters})
        while (answer := await self._socket.receive_json()).get('id') != self._number:
            pass
        assert 'result' in answer, answer
        return answer['result']

    async def value(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
        answer = await self.ask('Runtime.evaluate', expression=expression, returnByValue=True)
        assert 'exceptionDetails' not in answer, answer
        return answer['result'].get('value')

    async def until(self, expression: str) -> None:
        """Wait until an expression in the page is true."""
        try:
            async with asyncio.timeout(PATIENCE):
                while not await self.value(expression):
                    await asyncio.sleep(0.02)
        except TimeoutError:
            seen = await self.value('document.body.innerText')
            raise AssertionError(f'never {expression}, but {seen[:400]}') from None

    async def painted(self) -> None:
        """Wait until the page is on the screen; before that the browser may drop events."""
        await self.ask('Runtime.evaluate', awaitPromise=True, expression=(
            'new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))'))
        await self.ask('Page.captureScreenshot')

    async def mouse(self, *points: tuple[float, float]) -> None:
        """Press at the first point, move along the others, and let go; in pixels of the page."""
        kinds = ['mousePressed', *['mouseMoved'] * (len(points) - 1)]
        for kind, (x, y) in zip([*kinds, 'mouseReleased'], [*points, points[-1]]):
            await self.ask('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left',
                           buttons=1, clickCount=1)

    async def key(self, text: str) -> None:
        """Press and release the key that types a character."""
        for kind in ('keyDown', 'keyUp'):
            await self.ask('Input.dispatchKeyEvent', type=kind, key=text, text=text)

    async def press(self, name: str) -> None:
        """Press and release a key that has a name, such as Enter."""
        code = {'Enter': 13, 'Escape': 27, 'ArrowRight': 39}[name]
        text = {'text': '\r'} if name == 'Enter' else {}
        for kind in ('keyDown', 'keyUp'):
            await self.ask('Input.dispatchKeyEvent', type=kind, key=name,
                           windowsVirtualKeyCode=code, **text)

    async def phone(self) -> None:
        """Emulate a phone's screen and touch input from now on."""
        await self.ask('Emulation.setDeviceMetricsOverride', width=390, height=844,
                       deviceScaleFactor=2, mobile=True)
        await self.ask('Emulation.setTouchEmulationEnabled', enabled=True)
        await self.painted()

    async def finger(self, *points: tuple[float, float], resting: tuple[float, float]) -> None:
        """
        Touch the first point, move along the others, and let go; in pixels of the page.

        At the last point a second finger touches another point, `resting`, moves and lets go.
        """
        kinds = ['touchStart', *['touchMove'] * (len(points) - 1)]
        x, y = resting
        one, others = points[-1], [[(x, y)], [(x + 1, y)], [(x + 4, y)], []]
        kinds += ['touchStart', 'touchMove', 'touchMove', 'touchEnd']
        for kind, touched in zip(kinds, [*([point] for point in points),
                                         *([one, *other] for other in others)]):
            await self.ask('Input.dispatchTouchEvent', type=kind, touchPoints=[
                {'x': x, 'y': y, 'id': number} for number, (x, y) in enumerate(touched)])
        await self.ask('Input.dispatchTouchEvent', type='touchEnd', touchPoints=[])

    async def screenshot(self, path: Path) -> None:
        """Write a screenshot of the page as PNG."""
        answer = await self.ask('Page.captureScreenshot')
        path.write_bytes(base64.b64decode(answer['data']))


@asynccontextmanager
async def open_page(address: str, profile: Path, size: str = '1200,800') -> AsyncIterator[Page]:
    """Open an address in a browser of its own, whose files are in the folder `profile`."""
    assert CHROMIUM is not None
    process = await asyncio.create_subprocess_exec(
        CHROMIUM, '--headless=new', '--no-sandbox', '--disable-gpu', f'--window-size={size}',
        '--disable-dev-shm-usage', '--no-first-run', '--disable-background-networking',
        '--remote-debugging-port=0', '--remote-allow-origins=*', f'--user-data-dir={profile}',
        'about:blank', stderr=asyncio.subprocess.PIPE)
    try:
        async with asyncio.timeout(PATIENCE), aiohttp.ClientSession() as session:
            line = b''
            while b'DevTools listening on' not in line:
                line = await process.stderr.readline()
                assert line, 'the browser ended'
            port = line.decode().split('/')[2]
            async with session.get(f'http://{port}/json') as answer:
                found = [one for one in await answer.json() if one['type'] == 'page']
        async with aiohttp.ClientSession() as session, session.ws_connect(
                found[0]['webSocketDebuggerUrl'], max_msg_size=0) as socket:
            page = Page(socket)
            await page.ask('Page.navigate', url=address)
            yield page
    finally:
        process.terminate()
        await process.wait()
