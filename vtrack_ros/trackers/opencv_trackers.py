"""OpenCV's own trackers behind this package's interface, to compare with in one's own node."""

import ctypes
from typing import Any, ClassVar

import cv2
import numpy as np

from vtrack_ros.appearance.siamese_network import read_backbone, read_head, read_network
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.parameters import Parameter, ParameterTable, Value
from vtrack_ros.tracker import Estimate, Tracker, TrackState

#: The covariance of their estimates: unknown, as none of them reports one.
_NO_COVARIANCE: Array = np.full((4, 4), np.nan)


class OpenCVTracker(Tracker):
    """
    One of OpenCV's trackers, with its defaults.

    Where it reports failure the box keeps its last value, the confidence is 0 and the state LOST;
    elsewhere the confidence is its score, or 1 if it gives none. The covariance is NaN: unknown.

    ValueError where the installed OpenCV doesn't have it.
    """

    PARAMETERS = ParameterTable(())
    #: The name of the class in `cv2` or `cv2.legacy`.
    OPENCV_NAME: ClassVar[str]
    #: Which OpenCV has it, for an error message.
    NEEDS: ClassVar[str] = 'its contrib modules (the package opencv-contrib-python-headless)'
    #: Whether every seed gives the same output.
    DETERMINISTIC: ClassVar[bool] = True

    @classmethod
    def available(cls) -> bool:
        """Return whether the OpenCV that is installed has it."""
        return _factory(cls.OPENCV_NAME) is not None

    def _prepare(self, values: dict[str, Value]) -> None:
        if not self.available():
            raise ValueError(f'{self.NAME} needs an OpenCV with {self.NEEDS}; '
                             f'the installed {cv2.__version__} lacks it')

    def _create(self) -> Any:
        """Return OpenCV's tracker."""
        return _factory(self.OPENCV_NAME)()

    def _start(self, frame: Frame, box: Box) -> Estimate:
        self._box = box
        try:
            self._peer = self._create()
            self._peer.init(_colour(frame), _whole(box))
        except cv2.error as error:
            raise ValueError(f"{self.NAME} can't start on {box}: {error}") from None
        return self._estimate(True)

    def _update(self, frame: Frame, dt: float) -> Estimate:
        try:
            found, rectangle = self._peer.update(_colour(frame))
        except cv2.error:
            # some raise an error where the box has left the image
            found = False
        found = bool(found) and min(rectangle[2:]) > 0 and bool(np.isfinite(rectangle).all())
        if found:
            self._box = Box(*rectangle)
        return self._estimate(found)

    def _estimate(self, found: bool) -> Estimate:
        state = TrackState.TRACKING if found else TrackState.LOST
        return Estimate(self._box, 0.0, _NO_COVARIANCE, self._score() if found else 0.0, state)

    def _score(self) -> float:
        """Return the confidence in a target that it has found, in [0, 1]."""
        return 1.0


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
    NEEDS = 'the module video'
    DETERMINISTIC = False
    #: Least product of width - 1 and height - 1, [px]: in a smaller box no feature has the area
    #: of 9 that OpenCV needs, and it would draw places for one forever.
    _LEAST_AREA = 10

    def _start(self, frame: Frame, box: Box) -> Estimate:
        _, _, width, height = _whole(box)
        if (width - 1) * (height - 1) < self._LEAST_AREA:
            raise ValueError(f"{self.NAME} can't start on {box}: it's too small for the features")
        # It draws from OpenCV's global generator and from the C library's.
        cv2.setRNGSeed(int(self._rng.integers(2**31)))
        ctypes.CDLL(None).srand(int(self._rng.integers(2**31)))
        return super()._start(frame, box)


class MOSSE(OpenCVTracker):
    """Minimum output sum of squared error filter [Bolme2010]."""

    NAME = 'opencv_mosse'
    SUMMARY = "OpenCV's MOSSE"
    OPENCV_NAME = 'TrackerMOSSE'


class NetworkTracker(OpenCVTracker):
    """One of OpenCV's trackers that has a score, and needs network files as parameters."""

    #: Parameter -> field of OpenCV's settings.
    _FIELDS: ClassVar[dict[str, str]]

    def _prepare(self, values: dict[str, Value]) -> None:
        super()._prepare(values)
        missing = [name for name in self.PARAMETERS if not values[name]]
        if missing:
            raise ValueError(f'{self.NAME} needs the files ' + ', '.join(missing))

    def _create(self) -> Any:
        settings = getattr(cv2, f'{self.OPENCV_NAME}_Params')()
        for name, path in self._parameters.items():
            setattr(settings, self._FIELDS[name], path)
        return _factory(self.OPENCV_NAME)(settings)

    def _score(self) -> float:
        return min(max(float(self._peer.getTrackingScore()), 0.0), 1.0)


class Nano(NetworkTracker):
    """NanoTrack, a small Siamese network."""

    NAME = 'opencv_nano'
    SUMMARY = "OpenCV's NanoTrack"
    OPENCV_NAME = 'TrackerNano'
    NEEDS = 'TrackerNano (4.7 or newer)'
    PARAMETERS = ParameterTable([
        Parameter('backbone', '', "ONNX file of NanoTrack V2's backbone. Takes effect with the "
                  'next target or ~/reinit.', check=read_backbone),
        Parameter('head', '', "ONNX file of NanoTrack V2's head. Takes effect with the next "
                  'target or ~/reinit.', check=read_head),
    ])
    _FIELDS = {'backbone': 'backbone', 'head': 'neckhead'}


class Vit(NetworkTracker):
    """VitTrack, a small vision transformer."""

    NAME = 'opencv_vit'
    SUMMARY = "OpenCV's VitTrack"
    OPENCV_NAME = 'TrackerVit'
    NEEDS = 'TrackerVit (4.9 or newer)'
    PARAMETERS = ParameterTable([
        Parameter('network', '', "ONNX file of VitTrack's network. Takes effect with the next "
                  'target or ~/reinit.', check=read_network),
    ])
    _FIELDS = {'network': 'net'}


class CamShift(OpenCVTracker):
    """
    Continuously adaptive mean shift on a hue histogram [Bradski1998], as `cv2.CamShift` runs it.

    Dark and colourless pixels, whose hue is noise, are left out: the settings are those of the
    demonstration that comes with OpenCV. It is lost where no pixel of the window has the target's
    hue.
    """

    NAME = 'opencv_camshift'
    SUMMARY = "OpenCV's CamShift on hue"
    #: Bounds of (hue, saturation, value) of the pixels that are used.
    _LOW, _HIGH = (0, 60, 32), (180, 255, 255)
    #: Termination of mean shift: 10 iterations, or a step below 1 pixel.
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


#: OpenCV's trackers, whether the installed one has them or not.
OPENCV_TRACKERS: tuple[type[OpenCVTracker], ...] = (CSRT, KCF, MIL, MOSSE, CamShift, Nano, Vit)
