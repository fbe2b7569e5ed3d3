"""
The commands of the documentation: which there are, and whether those of `vtrack` do what they say.

`python benchmarks/documented_commands.py [PAGE.md...]` runs each of them as it stands on its page,
in a folder with short stand-ins for the bags, pictures and videos that the pages speak of. Those
that run until Ctrl-C get it after a while. benchmarks/walkthrough.py does docs/start.md in order.
"""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile

import cv2

from vtrack_ros.bags import BagWriter
from vtrack_ros.dds import reserve_domain
from vtrack_ros.scenes import render

ROOT = Path(__file__).resolve().parents[1]
EXECUTABLES = ('tracker', 'tracker_lifecycle', 'vtrack')
#: Others' programs.
OTHERS = ('cd', 'colcon', 'dask', 'export', 'git', 'pip', 'rosdep', 'source')
PAGES = [page for page in (*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md'))
         if page.name != 'notebook.md']
#: What isn't run here, and why.
LEFT = {'steady': 'needs the example installed: test/test_trackers_installed.py',
        'dask': 'needs a cluster: test/test_evaluation_running.py',
        'select': 'needs a hand: benchmarks/walkthrough.py and test/test_select_browser.py',
        'camera/left': 'needs a bag with that topic: test/test_bags_play.py',
        'siamese': 'needs networks'}
#: Frames of a stand-in, and how long a command that doesn't end may run, in seconds.
FRAMES, ENDLESS = 12, 8.0


def lines(page: Path) -> Iterator[str]:
    """Return the lines of a page's blocks that are no Python."""
    language = None
    for line in page.read_text().replace('\\\n', '').splitlines():
        if line.startswith('```'):
            language = line[3:] if language is None else None
        elif language in ('', 'bash') or language is None and line.startswith('    '):
            yield line.strip()


def commands(page: Path) -> Iterator[list[str]]:
    """Return the words of a page's commands; what isn't one has no known program."""
    programs = '|'.join(map(re.escape, (*EXECUTABLES, *OTHERS, 'ros2', 'python', 'python3')))
    for line in lines(page):
        if re.match(rf'([A-Z_]+=\S+ )*(({programs}) |(\./)?scripts/|\.venv/bin/)', line):
            words = shlex.split(line.partition(' > ')[0], comments=True)
            while '=' in words[0]:
                del words[0]
            text = ' '.join(map(shlex.quote, words)).replace("'&&'", '\n').replace("'&'", '\n')
            yield from filter(None, map(shlex.split, text.splitlines()))


def write_stand_ins(folder: Path) -> None:
    """Write what the pages' commands read."""
    (folder / 'bags').symlink_to(ROOT / 'bags')
    images = folder / 'DIR' / 'Crossing' / 'img'
    images.mkdir(parents=True)
    video = cv2.VideoWriter(str(folder / 'holiday.mp4'), cv2.VideoWriter_fourcc(*'mp4v'), 30,
                            (128, 96))
    boxes = []
    with BagWriter(folder / 'BAG') as bag:
        for index, shot in enumerate(render('face_fast', frames=FRAMES)):
            stamp = 10**9 + index * 33_333_333
            bag.write_frame(shot.frame, stamp)
            bag.write_truth(shot.truth, stamp)
            cv2.imwrite(str(images / f'{index}.png'), shot.frame)
            video.write(shot.frame)
            boxes.append(','.join(map(str, shot.truth.as_array())))
    video.release()
    (images.parent / 'groundtruth_rect.txt').write_text('\n'.join(boxes))
    (folder / 'sequences').symlink_to('DIR')
    for name in ('pictures', 'VIDEO_OR_FOLDER'):
        (folder / name).symlink_to(images)


def run(words: list[str], folder: Path) -> int | str:
    """Run a command of vtrack; return its exit code, or why it isn't run."""
    for word, reason in LEFT.items():
        if any(word in each for each in words):
            return reason
    if 'my_bag' in words and not (folder / 'my_bag').exists():
        shutil.copytree(folder / 'BAG', folder / 'my_bag')
    if '--out' in words:
        shutil.rmtree(folder / words[words.index('--out') + 1], ignore_errors=True)
    if words[1] == 'synth' and '--frames' not in words and '--list' not in words:
        words = [*words, '--frames', str(FRAMES)]
    process = subprocess.Popen(
        [sys.executable, '-m', 'vtrack_ros.cli.command_line', *words[1:]], cwd=folder,
        stdout=subprocess.DEVNULL, env={**os.environ, 'XDG_CACHE_HOME': str(folder / 'cache')})
    try:
        return process.wait(ENDLESS if '--loop' in words else None)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        return process.wait(ENDLESS)


if __name__ == '__main__':
    failed = 0
    with reserve_domain(), tempfile.TemporaryDirectory() as empty:
        write_stand_ins(Path(empty))
        for page in PAGES:
            if sys.argv[1:] and page.name not in sys.argv[1:]:
                continue
            for words in commands(page):
                if words[0] == 'vtrack':
                    result = run(words, Path(empty))
                    failed += result not in (0, *LEFT.values())
                    print(f'{page.name}: {shlex.join(words)}: {result}', flush=True)
    print(f'{failed} failed')
    sys.exit(bool(failed))
