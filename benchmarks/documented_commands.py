"""
Run the documentation's commands, and check that they work.

`python benchmarks/documented_commands.py [PAGE.md...]` runs each command as printed on its page,
and the examples in Python, in a folder with short stand-ins for the bags, pictures and videos that
the pages mention. Commands that run until Ctrl-C get it after a while; of benchmarks, which take
hours, only the options are checked. If `ros2` is installed, it talks to a node that tracks the
target of a bag; if `rosdep` is installed, it only lists what it would install. What isn't run is
listed with the reason. benchmarks/walkthrough.py runs docs/start.md in order.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import textwrap

import cv2

from vtrack_ros.bags import BagWriter
from vtrack_ros.dds import reserve_domain
from vtrack_ros.scenes import render

ROOT = Path(__file__).resolve().parents[1]
_NODE = 'from vtrack_ros.ros import main as m; import sys; sys.exit(m.{}())'
#: A page's expression for the folder of the installed package's files.
SHARE = '$(ros2 pkg prefix --share vtrack_ros)'
#: Executable of the package -> arguments of Python that start it.
EXECUTABLES = {'tracker': ['-c', _NODE.format('main')],
               'tracker_lifecycle': ['-c', _NODE.format('lifecycle_main')],
               'vtrack': ['-m', 'vtrack_ros.cli.command_line']}
#: Programs of other packages -> why they aren't run here.
OTHERS = {
    **dict.fromkeys(('cd', 'export', 'source', 'git', 'ssh'), 'not of this package'),
    'colcon': 'test/test_package.py builds and tests with it',
    'rosdep': 'needs rosdep and its database',
    'pip': 'needs the network; test/test_package.py installs with it',
    'dask': 'needs a cluster; test/test_evaluation_running.py has one',
    'eval': 'test/test_cli_commands.py completes'}
#: Verbs of `ros2` that are run, if it's installed and a workspace with the package is sourced.
VERBS = ('launch', 'param', 'security', 'topic')
#: Other commands that aren't run: text that they contain -> reason.
LEFT = {
    '--enclave': 'needs a Fast DDS with security; test/test_node_parameters.py has it refused',
    'ros2 security': 'needs ROS 2 installed; test/test_security.py has the policy',
    'ros2 bag': 'needs ROS 2 installed; test/test_bags_play.py has vtrack play',
    'ros2 launch': 'needs ROS 2 installed; test/test_node_files.py has the launch files',
    'ros2 topic': 'needs ROS 2 installed; type and content are checked, test_node_*.py send such',
    'ros2 param': 'needs ROS 2 installed; name and value are checked; test_node_parameters.py',
    'tcp://HOST:8786': 'needs a cluster; test/test_evaluation_running.py has one',
    'camera/left': 'needs a bag with that topic: test/test_bags_play.py',
    'yolo_detections.py': 'needs yolo_msgs; test/test_documentation.py converts',
    'example.py': "the page's program: test/test_node_alone.py runs it",
    'scripts/setup': 'makes the environment that this runs in',
    'scripts/test': 'runs all tests', 'test/test_': 'runs tests',
    'scripts/peers': 'makes an environment of its own, with contributed trackers',
    'walkthrough.py': 'does docs/start.md in order'}
#: Page whose programs in Python aren't run here -> test that runs them.
EXAMPLES_LEFT = {'README.md': 'test/test_documentation.py',
                 'adding_a_tracker.md': 'test/test_documentation.py',
                 'detector.md': 'test/test_documentation.py',
                 'localisers.md': 'test/test_localisation_siamese.py',
                 'node.md': 'test/test_node_alone.py'}
PAGES = [page for page in (*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md'))
         if page.name != 'notebook.md']
#: Words of commands that run until Ctrl-C.
_ENDLESS = {'--loop', 'select', 'tracker', 'tracker_lifecycle', '--camera', 'echo', 'launch'}
#: Number of frames of a stand-in; time, [s], until a command that runs until Ctrl-C gets it.
FRAMES, PATIENCE = 12, 8.0


def blocks(page: Path) -> Iterator[tuple[str, str]]:
    """Yield a page's blocks of code: language, empty if none is given, and text."""
    text = page.read_text()
    fenced = re.compile(r'^```(\w*)\n(.*?)^```', re.DOTALL | re.MULTILINE)
    for found in fenced.finditer(text):
        yield found[1], found[2]
    for indented in re.findall(r'(?:^    .*\n|^\n)+', fenced.sub('', text), re.MULTILINE):
        yield '', textwrap.dedent(indented).strip('\n')


def lines(page: Path) -> Iterator[str]:
    """Yield the lines of a page's blocks of commands, and the code that its sentences quote."""
    for language, text in blocks(page):
        if language in ('', 'bash'):
            yield from map(str.strip, text.replace('\\\n', '').splitlines())
    prose = re.sub(r'^```.*?^```|^    .*?$', '', page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for quoted in re.findall('`([^`]+)`', prose):
        # A program's name, with or without a verb, isn't a command.
        if not re.fullmatch(r'(\S+ )*(\.venv/bin/)?vtrack( \w+)?|ros2( \w+){1,2}', quoted):
            yield ' '.join(quoted.split())


def commands(page: Path) -> Iterator[list[str]]:
    """Yield the words of a page's commands: lines that begin with a known program."""
    programs = '|'.join((*EXECUTABLES, *OTHERS, 'ros2', 'python', 'python3'))
    for line in lines(page):
        line = line.replace(SHARE, str(ROOT))
        if re.match(rf'([A-Z_]+=\S+ )*(({programs}) (?!=)|(\./)?scripts/|\.venv/bin/)', line):
            words = shlex.split(line.partition(' > ')[0], comments=True)
            while '=' in words[0]:
                del words[0]
            text = ' '.join(map(shlex.quote, words)).replace("'&&'", '\n').replace("'&'", '\n')
            yield from filter(None, map(shlex.split, text.splitlines()))


def arguments(words: list[str]) -> list[str] | str:
    """Return what to run, a program's path or Python's arguments, or why it isn't run."""
    program, text = words[0].removeprefix('./'), ' '.join(words)
    ros2 = shutil.which('ros2')
    if ros2 and program == 'ros2' and words[1] in VERBS:
        return [ros2, *words[1:]]
    rosdep = shutil.which('rosdep')
    if rosdep and program == 'rosdep':
        # A simulation: what it would install on the system that the page is for.
        return [rosdep, *words[1:], '--simulate', '--rosdistro', 'jazzy', '--os', 'ubuntu:noble']
    for key, reason in LEFT.items():
        if key in text:
            return reason
    if program == 'pip' and 'steady_tracker' in text:
        return ['-m', *words, '--quiet', '--target', 'site']
    if program in OTHERS:
        return OTHERS[program]
    if words[:3] == ['ros2', 'run', 'vtrack_ros']:
        return arguments(words[3:])
    if program == 'scripts/demo':
        return ['-m', 'vtrack_ros.demo', *(['--no-browser'] if words[1:] else []), *words[1:]]
    if program.startswith('.venv/bin/'):
        return arguments([Path(program).name, *words[1:]])
    if program in EXECUTABLES:
        return [*EXECUTABLES[program], *words[1:]]
    if program.startswith('python'):
        return [*words[1:], '--help'] if words[1].startswith('benchmarks/') else words[1:]
    return [str(Path(sys.executable).parent / program), *words[1:]]


def write_stand_ins(folder: Path) -> None:
    """Write the files that the pages' commands read."""
    (folder / 'bags').symlink_to(ROOT / 'bags')
    (folder / 'targets.yaml').symlink_to(ROOT / 'config' / 'targets.yaml')
    (folder / 'src').mkdir()
    (folder / 'src' / 'vtrack_ros').symlink_to(ROOT)
    shutil.copytree(ROOT / 'docs' / 'examples', folder / 'docs' / 'examples')
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
    """Run a command; return its exit code, or why it isn't run."""
    call = arguments(words)
    if isinstance(call, str):
        return call
    if 'my_bag' in words and not (folder / 'my_bag').exists():
        shutil.copytree(folder / 'BAG', folder / 'my_bag')
    if '--out' in words:
        shutil.rmtree(folder / words[words.index('--out') + 1], ignore_errors=True)
    if 'synth' in words and '--frames' not in words and '--list' not in words:
        call = [*call, '--frames', str(FRAMES)]
    tool, endless = call[0].startswith('/'), _ENDLESS & {Path(word).name for word in words}
    others = tool and words[0] in ('ros2', 'rosdep')
    at_root = tool and not others or words[0].startswith(('python', '.venv'))
    path = os.pathsep.join((str(folder / 'site'), os.environ.get('PYTHONPATH', '')))
    process = subprocess.Popen(
        call if tool else [sys.executable, *call], stdout=subprocess.PIPE,
        cwd=ROOT if at_root else folder,
        stderr=subprocess.STDOUT, text=True,
        env={**os.environ, 'XDG_CACHE_HOME': str(folder / 'cache'), 'PYTHONPATH': path})
    try:
        output, _ = process.communicate(timeout=PATIENCE if endless else None)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate()
    missing = [word for word in words if call[-1] == '--help' and word.startswith('--')
               and word not in output]
    # A shell and ros2 end with this code on Ctrl-C.
    code = 0 if endless and process.returncode == signal.SIGINT else process.returncode
    if code:
        print(output)
    return f'has no {missing}' if missing else code


@contextmanager
def robot(folder: Path) -> Iterator[None]:
    """If `ros2` is installed, run a camera and a node that tracks its target, for `ros2`."""
    running = []
    if shutil.which('ros2'):
        node = ['--ros-args', '-r', 'image:=/image_raw', '-p', 'init_box:=[86, 112, 27, 83]']
        bag = str(folder / 'camera')
        run(['vtrack', 'synth', 'leave_and_return', '--out', bag, '--frames', '60'], folder)
        camera = ['play', bag, '--loop', '--remap', '/image:=/image_raw']
        running = [subprocess.Popen([sys.executable, *EXECUTABLES[name], *options])
                   for name, options in (('tracker', node), ('vtrack', camera))]
    try:
        yield
    finally:
        for process in running:
            process.send_signal(signal.SIGINT)
            process.wait()


def examples(page: Path) -> list[str]:
    """Return a page's programs in Python."""
    return [text for language, text in blocks(page)
            if language == 'python' or re.match(r'from |import ', text)]


def run_example(text: str, folder: Path) -> int:
    """Run a program."""
    (folder / 'example_of_page.py').write_text(text)
    return subprocess.run([sys.executable, 'example_of_page.py'], cwd=folder,
                          stdout=subprocess.DEVNULL).returncode


if __name__ == '__main__':
    failed, done = 0, set[str]()
    with (reserve_domain(), tempfile.TemporaryDirectory() as empty,
          tempfile.TemporaryDirectory() as place, robot(Path(place))):
        write_stand_ins(Path(empty))
        for page in PAGES:
            if sys.argv[1:] and page.name not in sys.argv[1:]:
                continue
            for words in commands(page):
                if shlex.join(words) not in done:
                    done.add(shlex.join(words))
                    result = run(words, Path(empty))
                    failed += not (result == 0 or isinstance(arguments(words), str))
                    print(f'{page.name}: {shlex.join(words)}: {result}', flush=True)
            if examples(page):
                result = EXAMPLES_LEFT.get(page.name) or run_example(
                    '\n'.join(examples(page)), Path(empty))
                failed += result not in (0, *EXAMPLES_LEFT.values())
                print(f'{page.name}: in Python: {result}', flush=True)
    print(f'{failed} failed')
    sys.exit(bool(failed))
