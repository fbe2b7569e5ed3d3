"""A discriminative target as the evidence of a particle filter."""

from __future__ import annotations

import numpy as np

from vtrack_ros.appearance.histogram import Boxes
from vtrack_ros.frame import Frame
from vtrack_ros.localisation import Localiser, ResponseMap
from vtrack_ros.trackers.observation import Array, Conclusion, Measurement, Observation

#: Error of the measured centre, as a share of the target's mean side, where it's seen well.
_MEASURED_ERROR = 0.05


class DiscriminativeObservation(Observation):
    """
    The evidence map of a `DiscriminativeTarget`.

    The particles decide between modes of the evidence that are about level, and the mode's own
    maximum is the estimate: a weighted mean is no more exact than the particles are dense. What
    is clearly the highest is believed against the prior, for targets dart off.

    Parameters
    ----------
    target : DiscriminativeTarget
    temperature : float
        Share of the usual evidence that makes a factor of e in the likelihood.
    measuring : bool
        Whether anybody asks for the measured centre.

    """

    sized = False
    errors = 0.07, 0.10

    def __init__(self, rng: np.random.Generator, temperature: float, measuring: bool) -> None:
        self._rng = rng
        self._measuring = measuring
        self.temperature = temperature
        self._response: ResponseMap | None = None

    def start(self, frame: Frame, box: Array) -> None:
        """Begin on a box."""
        x, y, width, height = (float(value) for value in box)
        self.localiser = Localiser(frame, (x, y), (width, height), self._rng)

    def look(self, frame: Frame, box: Array, predicted: Array) -> Measurement | None:
        """Make the response map about the box; the measured centre is its maximum."""
        x, y = box[:2].tolist()
        self._response = self.localiser.localise(frame, (x, y))
        if self.localiser.unseen_frames or not self._measuring:
            return None
        quality = min(max(self._response.peak / self.localiser.usual_response, 0.2), 1.0)
        error = _MEASURED_ERROR * np.sqrt(box[2] * box[3]) / quality
        return Measurement(np.array(self._response.center), error**2 * np.eye(2))

    def log_likelihood(self, boxes: Boxes) -> Array:
        """Return the response at the centres, on the scale of the temperature."""
        assert self._response is not None
        response: Array = self._response.sample(boxes[:, :2])
        response *= 1 / (self.temperature * self.localiser.usual_response)
        return response

    def conclude(self, frame: Frame, box: Array, dt: float) -> Conclusion:
        """Decide for the response's maximum next to the particles' mean, or the highest."""
        assert self._response is not None
        localiser = self.localiser
        center = self._response.local_maximum((float(box[0]), float(box[1])))
        center = self._response.unless_dominated(center)
        jumped = localiser.update(frame, self._response, center, dt)
        estimate = localiser.estimate(np.zeros((4, 4)))
        return Conclusion(np.array([*localiser.center, *localiser.size]), estimate.confidence,
                          localiser.unseen_frames, jumped)
