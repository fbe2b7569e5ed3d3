"""Tracking one target through a stream of stamped frames, for node and replay alike."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
import math
from typing import Any

import numpy as np

from vtrack_ros.appearance.extent import next_extent
from vtrack_ros.geometry import Box
from vtrack_ros.parameters import Value
from vtrack_ros.session.exemplar import Exemplar
from vtrack_ros.session.frame_interval import FrameIntervalEstimator
from vtrack_ros.session.last_measurement import LastMeasurement
from vtrack_ros.session.motion_filter import Motion, MotionFilter
from vtrack_ros.tracker import checked_frame, generator
from vtrack_ros.trackers import create_tracker, Estimate, Frame, Tracker, tracker_class

#: A new tracker is updated this many times with the frame of the last measurement; and before
#: that, with the exemplar rotated in steps of at most this angle, [rad].
_REPEATS, _TURN_STEP = 5, 0.1
#: It has recognised the target if its box overlaps the last measured one by at least this (IoU),
#: and its rotation differs by at most this, [rad].
_SAME_PLACE, _SAME_ANGLE = 0.5, 0.3


class TrackingSession:
    """
    Runs the chosen tracker over stamped frames; changes of tracker or parameters keep the target.

    A stamp that goes backwards (a bag that loops, a clock that was set back) or a frame of another
    size ends the tracking: the session then has no target until it's started again. A stamp that
    stands still (a driver that doesn't stamp) counts as one frame interval.

    The latest frame and that of the last measurement are kept, not copied: the next frame must not
    be written into the same array.

    Every tracker is created with the seed; `parameters` are tracker name -> parameter name ->
    value, and default where missing. TypeError or ValueError if one is wrong.
    """

    def __init__(self, tracker: str = 'gmpf', seed: int = 0,
                 parameters: Mapping[str, Mapping[str, Any]] | None = None) -> None:
        generator(seed)
        self._seed = seed
        self._name = tracker
        self._parameters = {owner: _checked(owner, values)
                            for owner, values in (parameters or {}).items()}
        self._tracker = self._create(tracker)
        self._estimate: Estimate | None = None
        self._frame: Frame | None = None
        self._stamp = 0
        self._last_measurement: LastMeasurement | None = None
        self._exemplar: Exemplar | None = None
        self._interval = FrameIntervalEstimator()
        self._motion = MotionFilter()
        self._failure = ''

    @property
    def tracker(self) -> str:
        """Return the name of the tracker in use."""
        return self._name

    @property
    def estimate(self) -> Estimate | None:
        """Return the latest estimate; None while there is no target."""
        return self._estimate

    @property
    def last_measurement(self) -> LastMeasurement | None:
        """Return the latest measured box with its frame; None while there is no target."""
        return self._last_measurement

    @property
    def exemplar(self) -> Exemplar | None:
        """Return what the target looked like when it was selected; None while there is none."""
        return self._exemplar

    @property
    def failure(self) -> str:
        """Return why the latest request or change gave up the target; empty if it didn't."""
        return self._failure

    @property
    def interval(self) -> float | None:
        """Return the usual interval between the target's frames [ns]; None before it's known."""
        return self._interval.interval

    def motion(self, age: float = 0.0) -> Motion | None:
        """Return the target's motion `age` seconds after the latest frame; None if unknown."""
        return self._motion.motion(age)

    def start(self, frame: Frame, stamp: int, box: Box) -> Estimate:
        """Begin on the target in `box` of a frame stamped in ns; errors as `Tracker.start`."""
        estimate = self._start(self._create(self._name), frame, stamp, box)
        self._exemplar = Exemplar.of(frame, box)
        return estimate

    def update(self, frame: Frame, stamp: int) -> Estimate | None:
        """
        Take the next frame, stamped in ns; None where there is no target (any more).

        TypeError or ValueError if it isn't a frame; the target is kept.
        """
        frame = checked_frame(frame)
        if self._estimate is None or self._frame is None:
            return None
        if stamp < self._stamp or frame.shape != self._frame.shape:
            self.forget()
            return None
        dt = self._interval.steps(stamp - self._stamp)
        estimate = self._estimate = self._tracker.update(frame, dt)
        self._frame, self._stamp = frame, stamp
        self._motion.add(estimate, stamp)
        if estimate.measured:
            # without an affine frame the box is the bound, whatever the angle
            angle = 0.0 if estimate.affine is None else estimate.angle
            self._last_measurement = LastMeasurement(frame, stamp, estimate.upright, angle)
        return estimate

    def take_up(self, seen: LastMeasurement, interval: int, exemplar: Exemplar) -> None:
        """
        Continue with the target of another session, from its last measurement.

        `interval` [ns] is its usual one, 0 where that isn't known. ValueError if the tracker fails
        on it; then there is no target.
        """
        try:
            self._show(self._create(self._name), seen, exemplar)
        except Exception as error:
            # such as of another package's tracker, which may raise anything
            self.forget()
            raise ValueError(f'{type(error).__name__}: {error}') from error
        self._exemplar = exemplar
        if interval > 0:
            self._interval.add(interval)

    def forget(self) -> None:
        """Give up the target."""
        self._estimate = self._frame = self._last_measurement = self._exemplar = None
        self._motion.restart()

    def restart(self) -> Estimate | None:
        """
        Learn the target afresh where it was last measured, and go on; None without a target.

        ValueError if a new tracker can't be made; then the target is tracked as before.
        """
        seen, self._failure = self._last_measurement, ''
        return None if seen is None else self._learn_afresh(seen)

    def resize(self, larger: bool) -> Estimate | None:
        """
        Learn the target afresh in the next larger or smaller extent that is found about it.

        It's found where the target was last measured; see `next_extent`. Returns None without a
        target; ValueError if there's no such extent, or as `restart`.
        """
        seen, self._failure = self._last_measurement, ''
        if seen is None:
            return None
        box = next_extent(seen.frame, seen.bound, larger)
        return self._learn_afresh(LastMeasurement(seen.frame, seen.stamp, box))

    def _learn_afresh(self, seen: LastMeasurement) -> Estimate | None:
        """Start a new tracker, and keep a new exemplar, where the target was seen."""
        tracker = self._create(self._name)
        self._last_measurement = seen
        estimate = self._take_over(tracker, afresh=True)
        if estimate is not None:
            self._exemplar = Exemplar.of(seen.frame, seen.bound)
        return estimate

    def warm_up(self) -> None:
        """
        Track random pixels, so that all is loaded; to be called before the first start.

        Otherwise loading would take the time of several frames just when the target is selected.
        ValueError if the tracker fails.
        """
        # NumPy loads it with the first median or percentile
        import_module('numpy.ma')
        ground = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
        try:
            self._tracker.start(ground, Box(60, 40, 40, 40))
            for _ in range(3):
                self._tracker.update(ground)
        except Exception as error:
            raise ValueError(f'{self._name} fails: {type(error).__name__}: {error}') from error

    def change(self, tracker: str | None = None, seed: int | None = None,
               parameters: Mapping[str, Mapping[str, Any]] | None = None) -> None:
        """
        Change the tracker or any tracker's parameters; in force from the next frame on.

        A changed parameter keeps the running tracker's memory; another tracker starts where the
        target was last measured. A new seed is used from the next start on. TypeError or
        ValueError if a name or a value is wrong; then nothing is changed.
        """
        name = self._name if tracker is None else tracker
        seed = self._seed if seed is None else seed
        generator(seed)
        given = {owner: dict(values) for owner, values in (parameters or {}).items()}
        # The tracker in use checks its own parameters, all together, in `configure`.
        own = given.pop(name, {})
        others = {owner: _checked(owner, values) for owner, values in given.items()}
        replacement = None
        with _named(name):
            if name != self._name:
                replacement = create_tracker(
                    name, seed=seed, **{**self._parameters.get(name, {}), **own})
            elif own:
                self._tracker.configure(**own)
        in_force = (replacement or self._tracker).parameters
        others[name] = {key: in_force[key] for key in own}
        for owner, values in others.items():
            self._parameters.setdefault(owner, {}).update(values)
        self._name, self._seed, self._failure = name, seed, ''
        if replacement is not None and self._take_over(replacement) is None:
            self._tracker = replacement

    def _create(self, name: str) -> Tracker:
        with _named(name):
            return create_tracker(name, seed=self._seed, **self._parameters.get(name, {}))

    def _start(self, tracker: Tracker, frame: Frame, stamp: int, box: Box) -> Estimate:
        estimate = tracker.start(frame, box)
        self._tracker, self._estimate, self._frame = tracker, estimate, frame
        self._stamp = stamp
        self._last_measurement = LastMeasurement(frame, stamp, box)
        self._interval = FrameIntervalEstimator()
        self._motion.restart()
        self._motion.add(estimate, stamp)
        return estimate

    def _show(self, tracker: Tracker, seen: LastMeasurement, exemplar: Exemplar) -> None:
        """
        Start a tracker on the exemplar, and update it with the frame of the last measurement.

        The last measurement alone has a small error, which would accumulate. In between, the
        exemplar is shown rotated in steps up to the last measured angle. If the tracker doesn't
        recognise the target then, or can't measure rotation, it's started on the last measurement.
        """
        frame, stamp, shape = seen.frame, seen.stamp, seen.frame.shape
        self._start(tracker, exemplar.placed(seen.box, shape), stamp, seen.box)
        steps = math.ceil(abs(seen.angle) / _TURN_STEP)
        for step in range(1, steps + 1):
            self.update(exemplar.placed(seen.box, shape, step / steps * seen.angle), stamp)
        for _ in range(_REPEATS):
            estimate = self.update(frame, stamp)
        if not (estimate is not None and estimate.measured
                and estimate.box.iou(seen.bound) >= _SAME_PLACE
                and abs(math.remainder(estimate.angle - seen.angle, math.tau)) <= _SAME_ANGLE):
            self._start(tracker, frame, stamp, seen.bound)
            # the usual response is learned in the second frame, for which this one is used again
            self.update(frame, stamp)

    def _take_over(self, tracker: Tracker, afresh: bool = False) -> Estimate | None:
        """Start a new tracker on the last measurement, and update it with the latest frame."""
        seen, interval, exemplar = self._last_measurement, self._interval, self._exemplar
        frame, stamp, self._failure = self._frame, self._stamp, ''
        if seen is None or frame is None:
            return None
        try:
            if afresh or not seen.angle or exemplar is None:
                self._start(tracker, seen.frame, seen.stamp, seen.bound)
            else:
                self._show(tracker, seen, exemplar)
            self._interval = interval
            return self._estimate if frame is seen.frame else self.update(frame, stamp)
        except Exception as error:
            # A tracker may measure a box outside the image, where no tracker can start. And no
            # failure of one, such as another package's, may leave a request without an answer.
            self.forget()
            self._failure = f'{type(error).__name__}: {error}'
            return None


def _checked(owner: str, values: Mapping[str, Any]) -> dict[str, Value]:
    with _named(owner):
        return tracker_class(owner).PARAMETERS.checked(values, owner)


@contextmanager
def _named(owner: str) -> Iterator[None]:
    """Prefix errors about a tracker's parameters with its name."""
    try:
        yield
    except (TypeError, ValueError) as error:
        text, kind = str(error), TypeError if isinstance(error, TypeError) else ValueError
        raise kind(text if owner in text else f'{owner}.{text}') from None
    except Exception as error:
        # another package's tracker may raise anything, such as about a file that is gone
        raise ValueError(f'{owner}: {type(error).__name__}: {error}') from error
