"""The demo with a camera: its images, the node and the page, each in a process of its own."""

from collections.abc import Sequence
from pathlib import Path
import time
import webbrowser

from vtrack_ros.demo.camera_source import NoImagesError, opened
from vtrack_ros.demo.processes import Child, end_all, PROCESS_TIMEOUT

#: The bag that is played if there is no camera.
_SCENE = Path(__file__).resolve().parents[2] / 'bags' / 'leave_and_return'


def run_live(source: str, node: Sequence[str], folder: Path, show: bool = True) -> None:
    """
    Track a target in the images of a camera or a video until Ctrl-C.

    Takes a camera's number or a video file, the node's ROS arguments, and a folder for the
    processes' logs; with `show` the page is opened in a browser. A recorded scene is played if
    there is no such camera. NoImagesError if a file can't be read, DemoError if a process fails.
    """
    try:
        opened(source).release()
        images: tuple[str, ...] = ('vtrack_ros.demo.camera_source', source)
    except NoImagesError as error:
        if not source.isdecimal():
            raise
        print(f'{error}: playing the recorded scene {_SCENE.name} instead', flush=True)
        images = ('vtrack_ros.cli.command_line', 'play', str(_SCENE), '--loop')
        node = [*node, '-p', 'image_transport:=compressed']
    children = [Child('node', folder / 'node.log', 'vtrack_ros.ros.main', '--ros-args', *node)]
    try:
        children.append(Child('player' if len(images) > 2 else 'camera', folder / 'camera.log',
                              *images))
        page = Child('page', folder / 'page.log', 'vtrack_ros.cli.command_line', 'select',
                     '--port', '0')
        children.append(page)
        deadline = time.monotonic() + PROCESS_TIMEOUT
        while not (address := _address(page.said)):
            page.check()
            if time.monotonic() > deadline:
                raise page.failure('did not start')
            time.sleep(0.05)
        print(f'drag a box around the target, or click on it: {address}\nCtrl-C ends it',
              flush=True)
        if show:
            webbrowser.open(address)
        while True:
            for child in children:
                child.check()
            time.sleep(0.2)
    except KeyboardInterrupt:
        print()
    finally:
        end_all(children)


def _address(said: str) -> str:
    """Return the page's address, empty if it hasn't been printed; warnings may come before it."""
    return next((line for line in said.splitlines() if line.startswith('http')), '')
