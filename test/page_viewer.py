"""The page's server, and a viewer of it without a browser."""

import asyncio
from contextlib import asynccontextmanager, contextmanager
import json
import os
import threading

import aiohttp
from forked_process import ForkedProcess
from node_harness import PATIENCE

from vtrack_ros.dds import with_profile


@contextmanager
def serving(*arguments):
    """Start `vtrack select` on a free port; returns its address."""
    process = ForkedProcess('vtrack_ros.cli.command_line', 'main',
                            ['select', '--port', '0', *arguments], with_profile(os.environ))
    output = []
    try:
        for line in process.stdout:
            output.append(line)
            if line.startswith('http'):
                address = line.strip()
                break
        else:
            raise AssertionError(''.join(output))
        # A pipe that nobody reads would fill.
        reader = threading.Thread(target=lambda: output.extend(process.stdout))
        reader.start()
        yield address
    finally:
        if process.poll() is None:
            process.send_signal(2)
        code = process.wait(PATIENCE)
    reader.join(PATIENCE)
    assert code == 0 and 'Traceback' not in ''.join(output), ''.join(output)


class Viewer:
    """A viewer without a browser."""

    def __init__(self, socket):
        self.socket = socket

    async def ask(self, **request):
        """Send a request."""
        await self.socket.send_json(request)

    async def receive(self, kind):
        """Return the next message of a kind; pictures that come before are acknowledged."""
        async with asyncio.timeout(PATIENCE):
            while True:
                message = await self.socket.receive()
                assert message.type is aiohttp.WSMsgType.TEXT, message
                content = json.loads(message.data)
                if content['kind'] == 'picture':
                    content['jpeg'] = await self.socket.receive_bytes()
                    if kind != 'picture':
                        await self.ask(do='shown')
                if content['kind'] == kind:
                    return content

    async def until(self, good):
        """Return the first picture that meets a condition."""
        async with asyncio.timeout(PATIENCE):
            while not good(picture := await self.receive('picture')):
                await self.ask(do='shown')
        await self.ask(do='shown')
        return picture

    async def told(self, words):
        """Return the first line that has these words."""
        async with asyncio.timeout(PATIENCE):
            while words not in (line := await self.receive('told'))['text']:
                pass
        return line


@asynccontextmanager
async def viewer(address, **arguments):
    """Open the page's WebSocket."""
    async with aiohttp.ClientSession() as session, session.ws_connect(
            f'{address}ws', max_msg_size=0, **arguments) as socket:
        yield Viewer(socket)


async def answer(address, **headers):
    """Return the HTTP status of an address."""
    async with aiohttp.ClientSession() as session:
        async with session.get(address, headers=headers) as response:
            return response.status
