"""The interface of a tracker: it's started on a box and updated with frames."""

from abc import ABC, abstractmethod
from contextlib import suppress
from dataclasses import dataclass, field
import enum
from numbers import Real
from typing import Any, ClassVar

import numpy as np

from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.parameters import ParameterTable, Value

#: Bounds of the time between two frames, in frame intervals: beyond them numbers under- or
#: overflow in the filters.
SHORTEST_DT, LONGEST_DT = 1e-9, 1e9
#: Bounds of the sides of a target's box, in pixels: below them numbers underflow, and no image's
#: side is longer.
SHORTEST_SIDE, GREATEST_SIDE = 1e-6, 1e6


class TrackState(enum.Enum):
    """Whether the box of an estimate is measured, predicted or meaningless."""

    TRACKING = 'tracking'
    """Measured in this frame."""
    SEARCHING = 'searching'
    """Out of sight: the box is a prediction, and the tracker looks for the target."""
    LOST = 'lost'
    """Out of sight for so long that the prediction means nothing; the search goes on."""


@dataclass(frozen=True)
class Estimate:
    """
    A tracker's output for a frame.

    Parameters
    ----------
    box : Box
        The target's axis-aligned bound.
    angle : float, [rad]
        The rotation since the start about the optical axis (x right, y down, z forward), so
        clockwise is positive as one looks at the image.
    covariance : ndarray, shape (4, 4), [px^2]
        Of (centre x, centre y, width, height); NaN: unknown.
    confidence : float
        In [0, 1]: how sure the tracker is that the box is on the target.
    state : TrackState
        Whether the box is measured or predicted.
    particles : ndarray, shape (N, 4), [px], optional
        The particles' (centre x, centre y, width, height), for drawing.
    affine : ndarray, shape (3, 3), optional
        The target's whole affine frame: maps the unit square about the origin onto the target.

    """

    box: Box
    angle: float
    covariance: Array
    confidence: float
    state: TrackState
    particles: Array | None = field(default=None, repr=False)
    affine: Array | None = None

    @property
    def measured(self) -> bool:
        """Whether the box was measured in this frame, and isn't a prediction."""
        return self.state is TrackState.TRACKING

    @property
    def upright(self) -> Box:
        """Return the box of the target without its rotation, of the target's own size."""
        if self.affine is None:
            return self.box
        width, height = np.hypot(self.affine[0, :2], self.affine[1, :2])
        x, y = self.affine[:2, 2]
        return Box.from_center(x, y, width, height)


class Tracker(ABC):
    """
    A single-object tracker.

    Parameters
    ----------
    seed : int, numpy.random.Generator or None
        The source of its randomness; the same seed and frames give the same output.
    **parameters
        Values for the class's table `PARAMETERS`.

    Raises
    ------
    TypeError, ValueError
        If a parameter is unknown, of the wrong type or out of range, or if the seed is wrong.

    """

    NAME: ClassVar[str]
    SUMMARY: ClassVar[str]
    PARAMETERS: ClassVar[ParameterTable]

    def __init__(self, seed: int | np.random.Generator | None = None, **parameters: Any) -> None:
        self._parameters: dict[str, Value] = self.PARAMETERS.defaults()
        self._rng = generator(seed)
        self._frame_shape: tuple[int, ...] | None = None
        self.configure(**parameters)

    @property
    def parameters(self) -> dict[str, Value]:
        """Return a copy of the parameters in force."""
        return dict(self._parameters)

    def configure(self, **changes: Any) -> None:
        """
        Change parameters; in force from the next frame on, and the target is kept.

        Raises
        ------
        TypeError, ValueError
            If a change is invalid; then none is made.

        """
        values = {**self._parameters, **self.PARAMETERS.checked(changes, self.NAME)}
        self._prepare(values)
        before, self._parameters = self._parameters, values
        try:
            self._configure()
        except Exception:
            self._parameters = before
            with suppress(Exception):
                self._configure()
            raise

    def start(self, frame: Frame, box: Box) -> Estimate:
        """
        Begin, or begin again, on the target in `box`.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W, 3) in BGR order or (H, W)
            The image.
        box : Box
            May reach beyond the image, but needs a part inside it.

        Raises
        ------
        TypeError
            If the frame isn't an ndarray of uint8, or the box isn't a Box.
        ValueError
            If the frame has another shape, no pixel of the box is inside it, or a side of the
            box isn't from a millionth of a pixel to a million pixels.

        """
        frame = checked_frame(frame)
        checked_box(box, frame)
        self._frame_shape = frame.shape
        try:
            return checked_estimate(self._start(frame, box), self.NAME)
        except BaseException:
            # it may be half made: OpenCV's trackers can crash if they are updated then
            self._frame_shape = None
            raise

    def update(self, frame: Frame, dt: float = 1.0) -> Estimate:
        """
        Find the target in the next frame, of the same shape as the one given to `start`.

        Parameters
        ----------
        frame : ndarray of uint8
            The image; the next one may be written into the same array.
        dt : float, [frames]
            The time since the last frame, in frame intervals of at most 40 ms: 1, unless frames
            were dropped, or there are fewer than 25 in a second (2.5 with ten in a second). From
            1e-9 to 1e9; a `TrackingSession` gives 1 to 30.

        Raises
        ------
        RuntimeError
            If the tracker was never started, or its last start failed.
        TypeError, ValueError
            If the frame's type or shape is wrong, or dt is out of range; the tracker is as it was.

        """
        if self._frame_shape is None:
            raise RuntimeError(f'{self.NAME}: call start(frame, box) before update(frame)')
        frame = checked_frame(frame)
        if frame.shape != self._frame_shape:
            raise ValueError(
                f'frame shape changed from {self._frame_shape} to {frame.shape}: '
                'call start again with a box in the new frame')
        if not (isinstance(dt, Real) and SHORTEST_DT <= dt <= LONGEST_DT):
            wrong = ValueError if isinstance(dt, Real) else TypeError
            raise wrong(f'dt must be a number of frame intervals from {SHORTEST_DT:g} to '
                        f'{LONGEST_DT:g}, not {dt!r}')
        return checked_estimate(self._update(frame, float(dt)), self.NAME)

    def _prepare(self, values: dict[str, Value]) -> None:
        """Raise a ValueError if values are invalid in combination; nothing changes then."""

    def _configure(self) -> None:
        """Derive whatever depends on the parameters; called before the first frame too."""

    @abstractmethod
    def _start(self, frame: Frame, box: Box) -> Estimate:
        """Begin on a checked frame and box."""

    @abstractmethod
    def _update(self, frame: Frame, dt: float) -> Estimate:
        """Process one checked frame."""


def generator(seed: int | np.random.Generator | None) -> np.random.Generator:
    """Return the generator of a seed; TypeError or ValueError, which names it, if it's wrong."""
    try:
        return np.random.default_rng(seed)
    except (TypeError, ValueError) as error:
        raise type(error)(f'seed {seed!r}: {error}') from None


def checked_frame(frame: Any) -> Frame:
    """Return a contiguous frame; TypeError or ValueError if it isn't a frame."""
    if not isinstance(frame, np.ndarray):
        raise TypeError(f'frame must be a numpy array of uint8, not {type(frame).__name__}')
    if frame.dtype != np.uint8:
        raise TypeError(f'frame must be of uint8, not {frame.dtype}')
    if frame.ndim not in (2, 3) or (frame.ndim == 3 and frame.shape[2] != 3):
        raise ValueError(
            f'frame must have shape (H, W, 3) in BGR order or (H, W), not {frame.shape}')
    if 0 in frame.shape:
        raise ValueError(f'frame must have at least one pixel, but its shape is {frame.shape}')
    return np.ascontiguousarray(frame)


def checked_box(box: Any, frame: Frame) -> None:
    """Check that a box is a Box (TypeError), of a possible size, partly inside (ValueError)."""
    if not isinstance(box, Box):
        raise TypeError(f'box must be a Box(x, y, width, height), not {type(box).__name__}')
    height, width = frame.shape[:2]
    name = f'box ({box.x:g}, {box.y:g}, {box.width:g}, {box.height:g})'
    if box.clipped(width, height) is None:
        raise ValueError(f'{name} has no pixel inside the image of {width} x {height}')
    if min(box.width, box.height) < SHORTEST_SIDE:
        raise ValueError(f'{name} is too small; width and height must be at least '
                         f'{SHORTEST_SIDE:g} px')
    if max(box.width, box.height) > GREATEST_SIDE:
        raise ValueError(f'{name} is too large; width and height must be at most '
                         f'{GREATEST_SIDE:.0f} px')


def checked_estimate(estimate: Any, name: str) -> Estimate:
    """Return what a tracker of that name returned; TypeError or ValueError if it's no estimate."""
    if not isinstance(estimate, Estimate):
        raise TypeError(f'{name}: _start and _update must return an Estimate, not '
                        f'{type(estimate).__name__}')
    for part, kind in (('box', Box), ('covariance', np.ndarray), ('state', TrackState)):
        if not isinstance(value := getattr(estimate, part), kind):
            raise TypeError(f'{name}: the {part} of an estimate must be a {kind.__name__}, '
                            f'not {value!r}')
    if estimate.covariance.shape != (4, 4):
        raise ValueError(f'{name}: the covariance of an estimate must have the shape (4, 4), '
                         f'not {estimate.covariance.shape}')
    if not (isinstance(estimate.confidence, Real) and 0 <= estimate.confidence <= 1):
        raise ValueError(f'{name}: the confidence of an estimate must be a number from 0 to 1, '
                         f'not {estimate.confidence!r}')
    shape = (0, 4) if estimate.particles is None else np.shape(estimate.particles)
    if len(shape) != 2 or shape[1] != 4:
        raise ValueError(f'{name}: the particles of an estimate must have the shape (N, 4), '
                         f'not {shape}')
    return estimate
