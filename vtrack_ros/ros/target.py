"""The target: selected, followed, given up; no ROS in here but its words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vtrack_ros.geometry import Box
from vtrack_ros.messages.selections import best_detection, from_detection, from_roi
from vtrack_ros.ros.parameters import INIT_BOX, Settings
from vtrack_ros.ros.quiet_log import Log, QuietLog
from vtrack_ros.session.history import FrameHistory
from vtrack_ros.session.selection import Selection, Selector
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import create_tracker, Estimate, Frame, TrackState

_FROM_PARAMETER = f'parameter {INIT_BOX}'


class Target:
    """
    Follows one target, from whatever selects it until it's given up.

    Parameters
    ----------
    settings : Settings
    log : Log

    """

    def __init__(self, settings: Settings, log: Log) -> None:
        self._settings = settings
        self._log = log
        self._quiet = QuietLog(log)
        self._session = TrackingSession(
            settings.text('tracker'), int(settings.number('seed')), settings.trackers)
        self._history = FrameHistory(
            settings.number('history_seconds'), settings.number('history_megabytes'))
        self._selector = Selector(self._history)
        self._shape: tuple[int, ...] = ()
        self._count = 0
        self.identity = ('target', '')
        self._warm_up()
        self.begin_stream()

    @property
    def tracker(self) -> str:
        """Return the name of the tracker in use."""
        return self._session.tracker

    @property
    def estimate(self) -> Estimate | None:
        """Return the latest estimate; None while there is no target."""
        return self._session.estimate

    @property
    def word(self) -> str:
        """Return the state in a word: waiting, tracking, searching or lost."""
        return 'waiting' if self.estimate is None else self.estimate.state.value

    def begin_stream(self) -> None:
        """Forget what belongs to another stream, and wait for the target of this one."""
        self.forget()
        self._history.clear()
        if self._settings.init_box is not None:
            self._selector.select(Selection(self._settings.init_box, _FROM_PARAMETER))

    def update(self, frame: Frame, stamp: int) -> Estimate | None:
        """
        Take the next frame; None while there is no target.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W, 3) in BGR order or (H, W)
            The pixels.
        stamp : int, [ns]
            When they were taken.

        """
        shape, self._shape = self._shape, frame.shape
        self._history.append(stamp, frame)
        before = self.estimate
        try:
            estimate = self._started() or self._session.update(frame, stamp)
        except Exception as error:
            # Whatever a tracker comes across in the pixels, the node must outlive it.
            self._quiet.error(f'tracker {self.tracker} failed, the target is forgotten: '
                              f'{type(error).__name__}: {error}')
            self._session.forget()
            return None
        if before is not None and estimate is None:
            self._log.warning(f'{_change(shape, frame.shape)}: the target is forgotten')
        return estimate

    def on_detection(self, message: Any) -> None:
        """Take a vision_msgs/msg/Detection2D as the target."""
        try:
            self._selector.select(from_detection(message, '~/init'))
        except (TypeError, ValueError) as error:
            self._refuse('~/init', error)

    def on_roi(self, message: Any) -> None:
        """Take a sensor_msgs/msg/RegionOfInterest of the next frame as the target."""
        try:
            self._selector.select(from_roi(message, '~/init_roi'))
        except (TypeError, ValueError) as error:
            self._refuse('~/init_roi', error)

    def on_detections(self, message: Any) -> None:
        """Take the best detection of the wanted class while there is no target, or it's lost."""
        lost = self.estimate is None or self.estimate.state is TrackState.LOST
        if not lost or self._selector.pending is not None:
            return
        try:
            best = best_detection(
                message, self._settings.text('init_class'), self._settings.number('init_score'),
                '~/init_detections')
            if best is not None:
                self._selector.select(best)
        except ValueError as error:
            self._refuse('~/init_detections', error)

    def forget(self) -> None:
        """Give the target up, and any that was about to be one."""
        self._session.forget()
        self._selector.clear()

    def restart(self) -> Estimate | None:
        """Learn the target afresh where it was last measured; None where there's none."""
        return self._session.restart()

    def change(self, settings: Settings, changes: Settings, names: Sequence[str]) -> None:
        """
        Put changed parameters in force.

        Parameters
        ----------
        settings : Settings
            All that hold now.
        changes : Settings
            Those that changed.
        names : sequence of str
            Their full names.

        """
        self._settings = settings
        tracker, seed = changes.node.get('tracker'), changes.node.get('seed')
        had_target = self.estimate is not None
        self._session.change(
            None if tracker is None else str(tracker), None if seed is None else int(seed),
            changes.trackers)
        if had_target and self.estimate is None:
            self._log.warning(f'{self.tracker} cannot start on the target: it is forgotten')
        self._history.seconds = settings.number('history_seconds')
        self._history.megabytes = settings.number('history_megabytes')
        if INIT_BOX in names:
            pending = self._selector.pending
            if settings.init_box is not None:
                self._selector.select(Selection(settings.init_box, _FROM_PARAMETER))
            elif pending is not None and pending.source == _FROM_PARAMETER:
                self._selector.clear()

    def _warm_up(self) -> None:
        """
        Load what a tracker loads with its first frames.

        Otherwise that would take the time of several frames just when the target is selected.

        """
        ground = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
        settings = self._settings.trackers.get(self.tracker, {})
        tracker = create_tracker(self.tracker, seed=0, **settings)
        tracker.start(ground, Box(60, 40, 40, 40))
        for _ in range(3):
            tracker.update(ground)

    def _started(self) -> Estimate | None:
        """Start on the selection whose frame is there; None where there's none."""
        source = getattr(self._selector.pending, 'source', '')
        try:
            ready = self._selector.ready()
            if ready is None:
                return None
            selection, frames = ready
            (stamp, frame), later = frames[0], frames[1:]
            self._session.start(frame, stamp, selection.box_on(frame))
        except ValueError as error:
            self._refuse(source, error)
            return None
        for stamp, frame in later:
            self._session.update(frame, stamp)
        self._count += 1
        self.identity = (selection.class_id or 'target', selection.target_id or str(self._count))
        box = selection.box
        self._log.info(f'{selection.source}: started {self.tracker} on the box at '
                       f'({box.x:g}, {box.y:g}) of {box.width:g} x {box.height:g} px')
        return self.estimate

    def _refuse(self, source: str, error: Exception) -> None:
        self._quiet.error(f'{source} refused: {error}')


def _change(before: tuple[int, ...], now: tuple[int, ...]) -> str:
    """Say what is different in frames of another shape."""
    if before[:2] != now[:2]:
        sizes = [' x '.join(map(str, shape[1::-1])) for shape in (before, now)]
        return f'the image size changed from {sizes[0]} to {sizes[1]}'
    kinds = ['colour' if len(shape) == 3 else 'grey' for shape in (before, now)]
    return f'the images changed from {kinds[0]} to {kinds[1]}'
