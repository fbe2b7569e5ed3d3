"""OpenCV's own trackers behind this package's face, to be measured by the same harness."""

import ctypes
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.parameters import ParameterTable
from vtrack_ros.tracker import Estimate, Tracker, TrackState

#: None of the peers says how sure it is of the place.
_NO_COVARIANCE: NDArray[np.float64] = np.full((4, 4), np.nan)


class OpenCVTracker(Tracker):
    """
    One of OpenCV's trackers, with its defaults.

    Where it reports failure the box keeps its last value, the confidence is 0 and the state LOST;
    elsewhere the confidence is 1, for it gives no other.
    """

    PARAMETERS = ParameterTable(())
    #: The name of the class in `cv2` or `cv2.legacy`.
    OPENCV_NAME: ClassVar[str]
    #: Whether every seed gives the same output.
    DETERMINISTIC: ClassVar[bool] = True

    @classmethod
    def available(cls) -> bool:
        """Return whether the OpenCV that is installed has it."""
        return _factory(cls.OPENCV_NAME) is not None

    def _configure(self) -> None:
        self._peer: Any = None
        self._box = Box(0, 0, 1, 1)

    def _start(self, frame: Frame, box: Box) -> Estimate:
        self._peer = _factory(self.OPENCV_NAME)()
        self._box = box
        self._peer.init(_colour(frame), _whole(box))
        return self._estimate(True)

    def _update(self, frame: Frame, dt: float) -> Estimate:
        found, rectangle = self._peer.update(_colour(frame))
        if found and rectangle[2] > 0 and rectangle[3] > 0:
            self._box = Box(*rectangle)
        return self._estimate(bool(found))

    def _estimate(self, found: bool) -> Estimate:
        state = TrackState.TRACKING if found else TrackState.LOST
        return Estimate(self._box, 0.0, _NO_COVARIANCE, float(found), state)


class CSRT(OpenCVTracker):
    """Discriminative correlation filter with channel and spatial reliability [Lukezic2017]."""

    NAME = 'opencv_csrt'
    SUMMARY = "OpenCV's CSRT"
    OPENCV_NAME = 'TrackerCSRT'


class KCF(OpenCVTracker):
    """Kernelised correlation filter [Henriques2015]."""

    NAME = 'opencv_kcf'
    SUMMARY = "OpenCV's KCF"
    OPENCV_NAME = 'TrackerKCF'


class MIL(OpenCVTracker):
    """Online multiple-instance learning [Babenko2009]."""

    NAME = 'opencv_mil'
    SUMMARY = "OpenCV's MIL"
    OPENCV_NAME = 'TrackerMIL'
    DETERMINISTIC = False

    def _start(self, frame: Frame, box: Box) -> Estimate:
        # It draws from OpenCV's global generator and from the C library's.
        cv2.setRNGSeed(int(self._rng.integers(2**31)))
        ctypes.CDLL(None).srand(int(self._rng.integers(2**31)))
        return super()._start(frame, box)


class MOSSE(OpenCVTracker):
    """Minimum output sum of squared error filter [Bolme2010]."""

    NAME = 'opencv_mosse'
    SUMMARY = "OpenCV's MOSSE"
    OPENCV_NAME = 'TrackerMOSSE'


class CamShift(OpenCVTracker):
    """
    Continuously adaptive mean shift on a hue histogram [Bradski1998], as `cv2.CamShift` runs it.

    Dark and colourless pixels, whose hue is noise, are left out: the settings are those of the
    demonstration that comes with OpenCV. It is lost where no pixel of the window has the target's
    hue.
    """

    NAME = 'opencv_camshift'
    SUMMARY = "OpenCV's CamShift on hue"
    _LOW, _HIGH = (0, 60, 32), (180, 255, 255)
    _STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)

    @classmethod
    def available(cls) -> bool:
        """Return that every OpenCV has it."""
        return True

    def _start(self, frame: Frame, box: Box) -> Estimate:
        hsv, mask = self._hue(frame)
        height, width = frame.shape[:2]
        inside = box.clipped(width, height) or box
        left, top, wide, high = _whole(inside)
        part = np.s_[top:top + high, left:left + wide]
        self._histogram = cv2.calcHist([hsv[part]], [0], mask[part], [16], [0, 180])
        cv2.normalize(self._histogram, self._histogram, 0, 255, cv2.NORM_MINMAX)
        self._box = box
        self._window: Any = (left, top, wide, high)
        return self._estimate(True)

    def _update(self, frame: Frame, dt: float) -> Estimate:
        hsv, mask = self._hue(frame)
        likely = cv2.calcBackProject([hsv], [0], self._histogram, [0, 180], 1) & mask
        _, window = cv2.CamShift(likely, self._window, self._STOP)
        left, top, wide, high = window
        found = bool(likely[top:top + high, left:left + wide].any())
        if found:
            self._window = window
            self._box = Box(*window)
        return self._estimate(found)

    def _hue(self, frame: Frame) -> tuple[Any, Any]:
        hsv = cv2.cvtColor(_colour(frame), cv2.COLOR_BGR2HSV)
        return hsv, cv2.inRange(hsv, np.array(self._LOW), np.array(self._HIGH))


def _factory(name: str) -> Any:
    for place in (cv2, getattr(cv2, 'legacy', None)):
        factory = getattr(place, f'{name}_create', None)
        if factory is None:
            factory = getattr(getattr(place, name, None), 'create', None)
        if factory is not None:
            return factory
    return None


def _colour(frame: Frame) -> Any:
    return cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) if frame.ndim == 2 else frame


def _whole(box: Box) -> tuple[int, int, int, int]:
    """Return the box in whole pixels, which is what OpenCV's trackers start on."""
    return (round(box.x), round(box.y), max(1, round(box.width)), max(1, round(box.height)))


#: The peers that the installed OpenCV has, by name.
PEERS: dict[str, type[OpenCVTracker]] = {
    peer.NAME: peer for peer in (CSRT, KCF, MIL, MOSSE, CamShift) if peer.available()}
