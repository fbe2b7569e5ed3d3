"""
Run the commands of docs/start.md as printed there, in order, in an empty folder.

`python benchmarks/walkthrough.py [FOLDER]` runs the part without ROS, after the set-up; where the
reader opens the page, this program draws the box. The exit code is 0 if there was a tracked video,
a tracked live topic, a target chosen on the page, and a report.
"""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile

import aiohttp

from vtrack_ros.bags import BagReader
from vtrack_ros.dds import reserve_domain

ROOT = Path(__file__).resolve().parents[1]
#: How long a command or the page may take, in seconds.
PATIENCE = 600.0


def blocks() -> list[str]:
    """Return the blocks of commands, without the set-up."""
    page = (ROOT / 'docs' / 'start.md').read_text()
    found = re.findall(r'```bash\n(.*?)```', page[:page.index('## With ROS')], re.DOTALL)
    kept = [re.sub(r'^(git|\./scripts/setup|source) .*\n', '', text, flags=re.MULTILINE)
            for text in found]
    return [text for text in kept if text]


async def choose(address: str, folder: Path) -> str:
    """Draw a box about the target on the page; return `tracking` as soon as it's tracked."""
    with BagReader(folder / 'my_bag') as bag:
        truth = bag.truth()
    async with asyncio.timeout(PATIENCE), aiohttp.ClientSession() as session, \
            session.ws_connect(f'{address}ws') as socket:
        chosen = 0
        async for message in socket:
            if message.type is not aiohttp.WSMsgType.TEXT:
                continue
            told = message.json()
            if told['kind'] == 'told' and told['text']:
                print(told['text'])
            if told['kind'] != 'picture':
                continue
            await socket.send_json({'do': 'shown'})
            if chosen and told.get('box') and told['state'].get('name') == 'tracking':
                return 'tracking'
            box = truth.get(int(told['stamp']))
            if box is not None and not chosen:
                chosen += 1
                await socket.send_json({
                    'do': 'box', 'stamp': told['stamp'], 'x': box.x, 'y': box.y,
                    'width': box.width, 'height': box.height})
    return 'never tracked'


def run(folder: Path) -> int:
    """Run the blocks; return how many of the results are missing."""
    environment = {**os.environ, 'PATH': f'{Path(sys.executable).parent}:{os.environ["PATH"]}'}
    background: list[subprocess.Popen[str]] = []
    state = ''
    try:
        for command in ''.join(blocks()).splitlines():
            command = command.partition('#')[0].strip()
            print(f'$ {command}', flush=True)
            stays = command.endswith('&') or command == 'vtrack select'
            process = subprocess.Popen(
                f'exec {command.removesuffix("&")}', shell=True, cwd=folder, env=environment,
                text=True, stdout=subprocess.PIPE if command == 'vtrack select' else None)
            if stays:
                background.append(process)
            elif process.wait(PATIENCE):
                print(f'it ended with {process.returncode}')
            if command == 'vtrack select':
                assert process.stdout is not None
                state = asyncio.run(choose(process.stdout.readline().strip(), folder))
                print(f'the target is {state}')
    finally:
        for process in background:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE)
    wanted = [folder / 'result' / 'video.mp4', folder / 'report.html']
    missing = [str(path) for path in wanted if not path.is_file()]
    print('missing: ' + ', '.join(missing) if missing else 'video and report are there')
    return len(missing) + (state != 'tracking')


if __name__ == '__main__':
    with reserve_domain(), tempfile.TemporaryDirectory() as empty:
        sys.exit(run(Path(sys.argv[1] if sys.argv[1:] else empty)))
