"""The target saved on disk, so that a restarted node goes on with it."""

from concurrent.futures import Future, ThreadPoolExecutor
import os
from pathlib import Path
import time
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from vtrack_ros.frame import Frame
from vtrack_ros.ros.parameter_node import ParameterNode
from vtrack_ros.session.saved_target import MARK, SavedTarget
from vtrack_ros.session.target import Target
from vtrack_ros.tracker import Estimate

#: Interval at which the target is saved, in seconds.
INTERVAL = 1.0
#: Upper bound of a valid file's size, in bytes; a larger one is refused.
LARGEST = 1 << 22


class StateFile:
    """
    Saves a node's target in the file that `state_file` names, and restores it from there.

    A timer checks the target, and a thread of its own writes it, so that tracking doesn't wait for
    the disk; only `close` does. Where the parameter is empty, nothing is done.
    """

    def __init__(self, node: ParameterNode, target: Target) -> None:
        self._node = node
        self._target = target
        self._log = Node.get_logger(node)
        self._saved: SavedTarget | None = None
        self._latest: Estimate | None = None
        self._frame_id = ''
        self._is_ours = False
        self._writing: Future[None] | None = None
        self._last_error = ''
        name = node.settings.text('state_file')
        self._path = Path(os.path.realpath(os.path.expanduser(name))) if name else None
        if self._path is None:
            return
        self._read(self._path)
        if self._path is None:
            return
        self._thread = ThreadPoolExecutor(1)
        self._timer = node.create_timer(
            INTERVAL, self.save, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def waits(self) -> bool:
        """Whether there is a saved target, to be restored with the first frame."""
        return self._saved is not None

    def take_up(self, frame: Frame, stamp: int, frame_id: str) -> None:
        """Restore the saved target, if there is one, with the first frame that comes."""
        saved, self._saved, self._frame_id = self._saved, None, frame_id
        if saved is None:
            return
        longest = self._node.settings.number('state_seconds')
        try:
            saved.check(frame, stamp, frame_id, time.time_ns(), longest)
            self._is_ours = self._target.take_up(saved, f'state_file {self._path}')
        except ValueError as error:
            self._refuse(str(error))

    def give_up(self) -> None:
        """Give up a saved target that waits: it isn't restored, and `save` removes its file."""
        if self._saved is not None:
            self._saved, self._is_ours = None, True

    def save(self) -> None:
        """Have the target written, or its file removed, if it changed and no write is running."""
        if self._path is None or self._writing is not None and not self._writing.done():
            return
        self._tell()
        estimate, before = self._target.estimate, self._latest
        if estimate is before and not (estimate is None and self._is_ours):
            return
        make = self._target.saved(
            self._node.get_fully_qualified_name(), self._frame_id, time.time_ns())
        self._latest = estimate
        if make is not None:
            self._is_ours = True
            path = self._path
            self._writing = self._thread.submit(lambda: _write(path, make().text()))
        elif self._is_ours:
            self._is_ours = False
            self._writing = self._thread.submit(self._path.unlink, missing_ok=True)

    def close(self, keep: bool = True) -> None:
        """Write the target for the last time, or, without `keep`, remove the file; then stop."""
        if self._path is None:
            return
        self._node.destroy_timer(self._timer)
        if self._writing is not None:
            self._writing.exception()
        if not keep:
            self.give_up()
            self._target.forget()
        self.save()
        self._thread.shutdown()
        self._tell()
        self._path = None

    def _read(self, path: Path) -> None:
        try:
            if not path.exists():
                if not path.parent.is_dir():
                    raise FileNotFoundError(f'the folder {path.parent} does not exist')
                return
            if not path.is_file():
                raise OSError('it is not a file')
            with open(path, 'rb') as file:
                data = file.read(LARGEST + 1)
        except OSError as error:
            self._refuse(f'{error}; the target will not be saved')
            self._path = None
            return
        if data.strip(b'\0') and not data.startswith(MARK.encode()):
            self._refuse('it does not contain a saved target, and is left unchanged; the target '
                         'will not be saved')
            self._path = None
            return
        try:
            saved = SavedTarget.parsed(data.decode() if len(data) <= LARGEST else '')
            if saved.node != self._node.get_fully_qualified_name():
                raise ValueError(f'it belongs to the node {saved.node}')
        except ValueError as error:
            self._refuse(f'it is damaged, or not for this node: {error}')
            return
        self._saved = saved

    def _refuse(self, why: str) -> None:
        self._log.warning(f'state_file {self._path} is not used: {why}')

    def _tell(self) -> None:
        """Log why the target could not be written, once for each reason."""
        error: Any = self._writing.exception() if self._writing is not None else None
        text = f'state_file {self._path} could not be written: {error}' if error else ''
        if text and text != self._last_error:
            self._log.error(text)
        if self._writing is not None:
            self._last_error = text


def _write(path: Path, text: str) -> None:
    """Replace a file atomically: it stays whole, old or new, even if the power fails."""
    beside = path.with_name(f'{path.name}.tmp')
    try:
        with open(beside, 'w', encoding='ascii') as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except OSError:
        beside.unlink(missing_ok=True)
        raise
    os.replace(beside, path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
