"""One target: selecting it, tracking it and giving it up."""

from collections.abc import Callable
from typing import Protocol

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.session.history import FrameHistory, seconds
from vtrack_ros.session.saved_target import SavedTarget
from vtrack_ros.session.selection import Selection, Selector
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.tracker import Estimate, TrackState


class Log(Protocol):
    """Where a target's events are logged."""

    def info(self, text: str) -> None:
        """Log that a request was carried out."""

    def warning(self, text: str) -> None:
        """Log that a target was given up."""

    def error(self, text: str) -> None:
        """Log that a request was refused."""

    def repeated_error(self, text: str) -> None:
        """Log an error that may recur with every frame."""


class Target:
    """
    Tracks one target, from its selection until it's given up.

    Each target has a session of its own; several may share the history of the latest frames, which
    has to include the frame to be tracked. `init_box` is selected with the first frame of every
    stream; `identity` is the target's class and id.
    """

    def __init__(self, session: TrackingSession, history: FrameHistory, log: Log) -> None:
        self._session = session
        self._selector = Selector(history)
        self._log = log
        self._shape: tuple[int, ...] = ()
        self._count = 0
        self.identity = ('target', '')
        self.init_box: Selection | None = None

    @property
    def estimate(self) -> Estimate | None:
        """Return the latest estimate; None while there is no target."""
        return self._session.estimate

    @property
    def state_name(self) -> str:
        """Return the state's name: waiting, tracking, searching or lost."""
        return 'waiting' if self.estimate is None else self.estimate.state.value

    @property
    def starts_on_init_box(self) -> bool:
        """Whether `init_box` is going to be selected with the next frame."""
        return self.init_box is not None and self._selector.pending is self.init_box

    def begin_stream(self, from_init_box: bool = True) -> None:
        """
        Forget the previous stream's target; by default select `init_box` in the new one.

        A selection for the next frame, which may have been made before the new stream, is kept,
        but not a detector's; one on a frame of the previous stream is refused.
        """
        pending = self._selector.pending
        self.forget()
        if pending is not None and not pending.automatic:
            if pending.stamp is None:
                self._selector.select(pending)
                return
            self._log.error(f'{pending.source} refused: its stamp {seconds(pending.stamp)} s is '
                            'of the previous stream')
        if from_init_box and self.init_box is not None:
            self._selector.select(self.init_box)

    def set_init_box(self, box: Box | None, source: str) -> None:
        """Set the box to select in the next frame and in every new stream; None: no box."""
        before, self.init_box = self.init_box, None if box is None else Selection(box, source)
        if self.init_box is not None:
            self._selector.select(self.init_box)
        elif before is not None and self._selector.pending is before:
            self._selector.pending = None

    def select(self, selection: Selection) -> None:
        """Take a selection that replaces the present target; ValueError if its frame is gone."""
        self._selector.select(selection)

    def saved(self, node: str, frame_id: str, time: int) -> Callable[[], SavedTarget] | None:
        """Return a function that makes the target's data: see `SavedTarget.of`."""
        return SavedTarget.of(self._session, self.identity, node, frame_id, time)

    def take_up(self, saved: SavedTarget, source: str) -> bool:
        """
        Continue with a target of the same stream that `source` saved; return whether it was taken.

        It takes precedence over `init_box` and a detector's selection, but not over a target or
        any other selection.
        ValueError if it can't be used.
        """
        pending = self._selector.pending
        chosen = pending is not None and pending is not self.init_box and not pending.automatic
        if self.estimate is not None or chosen:
            return False
        seen, id_text = saved.measurement(), saved.identity[1]
        number = int(id_text) if id_text.isdecimal() else 0
        self._session.take_up(seen, saved.interval, saved.exemplar())
        self._selector.pending, self._shape = None, seen.frame.shape
        self.identity = saved.identity
        # the next target has another number
        self._count = max(self._count, number)
        box, before = seen.bound, saved.tracker
        tracker = self._session.tracker + (f' (was {before})' if before != self._session.tracker
                                           else '')
        self._log.info(f'{source}: {tracker} continues with the target at ({box.x:g}, '
                       f'{box.y:g}) of {box.width:g} x {box.height:g} px')
        return True

    @property
    def wanted(self) -> bool:
        """Whether a detector may select: no target or a lost one, and no pending selection."""
        lost = self.estimate is None or self.estimate.state is TrackState.LOST
        return lost and self._selector.pending is None

    def update(self, frame: Frame, stamp: int) -> Estimate | None:
        """Take the next frame, stamped in nanoseconds; None while there is no target."""
        shape, self._shape = self._shape, frame.shape
        before = self.estimate
        try:
            estimate = self._started() or self._session.update(frame, stamp)
        except Exception as error:
            # No failure of a tracker, whatever the pixels, may end the program.
            self._log.repeated_error(f'tracker {self._session.tracker} failed, the target is '
                                     f'forgotten: {type(error).__name__}: {error}')
            self._session.forget()
            return None
        if before is not None and estimate is None:
            self._log.warning(f'{_change(shape, frame.shape)}: the target is forgotten')
        return estimate

    def forget(self) -> None:
        """Give up the target, and any pending selection."""
        self._session.forget()
        self._selector.pending = None

    def _started(self) -> Estimate | None:
        """Start on the pending selection if its frame has come; None if not started."""
        pending = self._selector.pending
        source, automatic = (pending.source, pending.automatic) if pending else ('', False)
        try:
            ready = self._selector.ready()
            if ready is None:
                return None
            selection, frames = ready
            (stamp, frame), later = frames[0], frames[1:]
            box = selection.box_on(frame)
            self._session.start(frame, stamp, box)
        except ValueError as error:
            tell = self._log.repeated_error if automatic else self._log.error
            tell(f'{source} refused: {error}')
            return None
        for stamp, frame in later:
            self._session.update(frame, stamp)
        self._count += 1
        self.identity = (selection.class_id or 'target', selection.target_id or str(self._count))
        self._log.info(f'{selection.source}: started {self._session.tracker} on the box at '
                       f'({box.x:g}, {box.y:g}) of {box.width:g} x {box.height:g} px')
        return self.estimate


def _change(before: tuple[int, ...], now: tuple[int, ...]) -> str:
    """Return a text that says how the frames' shape changed."""
    if before[:2] != now[:2]:
        sizes = [' x '.join(map(str, shape[1::-1])) for shape in (before, now)]
        return f'the image size changed from {sizes[0]} to {sizes[1]}'
    kinds = ['colour' if len(shape) == 3 else 'grey' for shape in (before, now)]
    return f'the images changed from {kinds[0]} to {kinds[1]}'
