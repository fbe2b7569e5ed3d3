"""The page's server: sends pictures as fast as viewers take them, and handles their requests."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from importlib.resources import files
import json
from pathlib import Path
from socket import gaierror
from typing import Any

from aiohttp import web, WSMsgType
import cv2

from vtrack_ros.appearance.sampling import shrunk
from vtrack_ros.geometry import Box
from vtrack_ros.messages.images import decoded
from vtrack_ros.selecting.access import guard
from vtrack_ros.selecting.tracker_link import TrackerLink
from vtrack_ros.signals import ending_signals

#: The longest message that a viewer may send, in bytes.
LONGEST_MESSAGE = 4096
#: Interval at which the node's presence is checked, in seconds.
_BEAT = 0.3
#: The JPEG that is sent of an image: its longest side at most, in pixels, and its quality, in %.
_LONGEST_SIDE, _QUALITY = 1280, 80
_PAGE = {'': ('page.html', 'text/html'), 'page.js': ('page.js', 'text/javascript'),
         'page.css': ('page.css', 'text/css')}
_HEADERS = {
    'Content-Security-Policy':
        "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff', 'Referrer-Policy': 'no-referrer',
    'Cache-Control': 'no-store'}


class Viewer:
    """
    One browser: the next picture is sent once the previous one was shown.

    The viewer sends JSON objects whose `do` is `shown`, `box` (stamp, x, y, width, height),
    `click` (stamp, x, y), `reset`, `reinit`, `larger`, `smaller`, `enable` (on), `particles` (on),
    `record` (on) or `set` (name, kind, value). It receives JSON objects whose `kind` is `picture`
    (the JPEG follows as a binary message), `state` (while there's no picture), `parameters`,
    `values` (of parameters that were set, by name) or `told` (a line to show).

    `asked` is called when `particles`, whether the viewer wants them, has changed.
    """

    def __init__(self, socket: web.WebSocketResponse, link: TrackerLink, folder: Path,
                 asked: Callable[[], None]) -> None:
        self._socket, self._link, self._folder = socket, link, folder
        self._asked = asked
        self.particles = False
        self._news = asyncio.Event()
        self._shown = asyncio.Event()
        self._shown.set()

    def changed(self) -> None:
        """Note that there is something new to show."""
        self._news.set()

    async def tell(self, text: str, wrong: bool = False) -> None:
        """Send a line of text for the viewer to show."""
        await self._socket.send_json({'kind': 'told', 'text': text, 'wrong': wrong})

    async def show_values(self, values: dict[str, Any]) -> None:
        """Send the new values of some parameters."""
        await self._socket.send_json({'kind': 'values', 'values': values})

    async def send_pictures(self) -> None:
        """
        Send the newest picture whenever there is another one, until it's cancelled.

        Before the first one, such as while no camera runs, send the state alone.
        """
        sent: object = None
        while True:
            await self._shown.wait()
            await self._news.wait()
            self._news.clear()
            found = self._link.picture()
            if found is None:
                alone = {'state': self._link.state, 'recording': self._link.recording}
                if alone != sent:
                    sent = alone
                    await self._socket.send_json({'kind': 'state', **alone})
                continue
            if not self.particles:
                found[1].pop('particles', None)
            if (known := (found[0], json.dumps(found[1]))) == sent:
                continue
            try:
                data, width, height = await asyncio.to_thread(_jpeg, found[0])
            except ValueError as error:
                await self.tell(str(error), wrong=True)
                continue
            sent = known
            self._shown.clear()
            await self._socket.send_json(
                {'kind': 'picture', 'width': width, 'height': height, **found[1]})
            await self._socket.send_bytes(data)

    async def listen(self) -> None:
        """Handle the viewer's requests until it disconnects."""
        async for message in self._socket:
            if message.type is not WSMsgType.TEXT:
                continue
            try:
                await self._do(json.loads(message.data))
            except (KeyError, TypeError, ValueError, OverflowError, RecursionError, OSError,
                    ModuleNotFoundError) as error:
                await self.tell(f'refused: {error}', wrong=True)

    async def follow_node(self) -> None:
        """Send the parameters whenever the node appears, until it's cancelled."""
        before = None
        while True:
            there = self._link.reachable
            if there and not before:
                # where the node is too busy to answer, this is tried again
                there = await self.send_parameters()
                if there:
                    await self.tell('')
            elif not there and before is not False:
                await self.tell(f'waiting for the node {self._link.target}: is it running?', True)
            before = there
            await asyncio.sleep(_BEAT)

    async def send_parameters(self) -> bool:
        """Send the node's parameters, or an error message; return whether they were sent."""
        try:
            rows = await self._link.parameters()
        except TimeoutError as error:
            await self.tell(str(error), wrong=True)
            return False
        await self._socket.send_json({'kind': 'parameters', 'rows': rows})
        return True

    async def _do(self, asked: dict[str, Any]) -> None:
        do = asked['do']
        if do == 'shown':
            self._shown.set()
        elif do == 'box':
            self._link.select_box(_stamp(asked), Box(
                *(float(asked[name]) for name in ('x', 'y', 'width', 'height'))))
        elif do == 'click':
            self._link.select_point(_stamp(asked), float(asked['x']), float(asked['y']))
        elif do == 'particles':
            self.particles = bool(asked['on'])
            self._asked()
        elif do == 'record':
            await self.tell(await self._link.record(self._folder if asked['on'] else None))
        elif do in ('reset', 'reinit', 'larger', 'smaller', 'enable'):
            fields = {'data': bool(asked['on'])} if do == 'enable' else {}
            answer = await self._link.ask(do, **fields)
            await self.tell(answer.message, wrong=not answer.success)
        elif do == 'set':
            reason = await self._link.set_parameter(
                str(asked['name']), str(asked['kind']), asked['value'])
            await self.tell(reason or f'{asked["name"]} is {asked["value"]}', wrong=bool(reason))
            if reason:
                await self.send_parameters()
        else:
            raise ValueError(f'unknown request {do!r}')


async def serve(target: str, host: str, port: int, token: str, folder: Path) -> None:
    """
    Serve the page of a tracking node until a signal ends it; recordings go into the folder.

    OSError if the host is unknown or isn't this machine's, or the port is taken.
    """
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in ending_signals():
        loop.add_signal_handler(number, stop.set)
    viewers: set[Viewer] = set()
    tasks: set[asyncio.Task[None]] = set()
    views: set[asyncio.Task[Any]] = set()

    def changed() -> None:
        for viewer in viewers:
            viewer.changed()

    async def sent(message: Awaitable[None]) -> None:
        # a viewer that has gone may still wait for the answer to its request
        with suppress(ConnectionError):
            await message

    def send(message: Callable[[Viewer], Awaitable[None]]) -> None:
        for viewer in viewers:
            task = loop.create_task(sent(message(viewer)))
            tasks.add(task)
            task.add_done_callback(tasks.discard)
    link = TrackerLink(target, changed,
                       lambda text: send(lambda viewer: viewer.tell(text, wrong=True)),
                       lambda values: send(lambda viewer: viewer.show_values(values)))

    def asked() -> None:
        link.want_particles(any(viewer.particles for viewer in viewers))

    async def page(request: web.Request) -> web.Response:
        name, kind = _PAGE[request.path.rpartition('/')[2]]
        body = files('vtrack_ros.selecting').joinpath('web', name).read_bytes()
        return web.Response(body=body, content_type=kind, charset='utf-8', headers=_HEADERS)

    async def viewing(request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(max_msg_size=LONGEST_MESSAGE, heartbeat=20.0)
        await socket.prepare(request)
        viewer = Viewer(socket, link, folder, asked)
        viewers.add(viewer)
        if (view := asyncio.current_task()) is not None:
            views.add(view)
            view.add_done_callback(views.discard)
        link.watch(True)
        try:
            # any failure ends this viewer and is reported; the page connects again
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(viewer.send_pictures()),
                         group.create_task(viewer.follow_node())]
                await viewer.listen()
                for task in tasks:
                    task.cancel()
        except* ConnectionError:
            pass
        finally:
            viewers.discard(viewer)
            link.watch(bool(viewers))
            asked()
        return socket

    application = web.Application(middlewares=[guard(token)], client_max_size=LONGEST_MESSAGE)
    root = f'/{token}' if token else ''
    application.router.add_get(f'{root}/ws', viewing)
    for name in _PAGE:
        application.router.add_get(f'{root}/{name}', page)
    runner = web.AppRunner(application, shutdown_timeout=1.0)
    try:
        await runner.setup()
        try:
            await web.TCPSite(runner, host, port).start()
        except (gaierror, UnicodeError) as error:
            # these say what is wrong, but not with which name
            raise OSError(f'{host}: {getattr(error, "strerror", error)}') from None
        named = f'[{host}]' if ':' in host else host
        # these stand for all addresses of this machine, and lead nowhere from another one
        elsewhere = f", elsewhere with this machine's name in place of {named}" * (
            host in ('0.0.0.0', '::'))
        print(f'http://{named}:{runner.addresses[0][1]}{root}/\n'
              f'open it in a browser{elsewhere}; Ctrl-C ends it', flush=True)
        await stop.wait()
    finally:
        await runner.cleanup()
        # they may still wait for the node's answer, and use the link until they end
        for view in tuple(views):
            view.cancel()
        await asyncio.gather(*views, return_exceptions=True)
        link.close()


def _stamp(asked: dict[str, Any]) -> int:
    """Return a picture's stamp, a string since JavaScript's numbers lack the digits."""
    stamp = int(asked['stamp'])
    if not 0 <= stamp < 2**31 * 10**9:
        raise ValueError(f'{stamp} is not a valid stamp')
    return stamp


def _jpeg(message: Any) -> tuple[bytes, int, int]:
    """Return an image message as JPEG, and the image's own width and height."""
    frame = decoded(message)
    height, width = frame.shape[:2]
    _, data = cv2.imencode(
        '.jpg', shrunk(frame, _LONGEST_SIDE), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes(), width, height
