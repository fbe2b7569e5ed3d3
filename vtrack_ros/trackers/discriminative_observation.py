"""A discriminative target as the evidence of a particle filter."""

from __future__ import annotations

import numpy as np

from vtrack_ros.appearance.histogram import Boxes
from vtrack_ros.frame import Frame
from vtrack_ros.trackers.discriminative import DiscriminativeTarget, ERRORS
from vtrack_ros.trackers.observation import Array, Conclusion, Measurement, Observation
from vtrack_ros.trackers.sighting import Sighting

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
    errors = ERRORS

    def __init__(self, target: DiscriminativeTarget, temperature: float,
                 measuring: bool) -> None:
        self.target = target
        self._measuring = measuring
        self.temperature = temperature
        self._sighting: Sighting | None = None

    def start(self, frame: Frame, box: Array) -> None:
        """Begin on a box."""
        x, y, width, height = (float(value) for value in box)
        self.target.start(frame, (x, y), (width, height))

    def look(self, frame: Frame, box: Array, predicted: Array) -> Measurement | None:
        """Make the evidence map about the box; the measured centre is its maximum."""
        x, y = box[:2].tolist()
        self._sighting = self.target.look(frame, (x, y))
        if self.target.sight.unseen_frames or not self._measuring:
            return None
        usual = max(self.target.live.evidence_mean, 1e-6)
        quality = min(max(self._sighting.peak / usual, 0.2), 1.0)
        error = _MEASURED_ERROR * np.sqrt(box[2] * box[3]) / quality
        return Measurement(np.array(self._sighting.center), error**2 * np.eye(2))

    def log_likelihood(self, boxes: Boxes) -> Array:
        """Return the evidence at the centres, on the scale of the temperature."""
        assert self._sighting is not None
        usual = max(self.target.live.evidence_mean, 1e-6)
        evidence: Array = self._sighting.at(boxes[:, :2])
        evidence *= 1 / (self.temperature * usual)
        return evidence

    def conclude(self, frame: Frame, box: Array, dt: float) -> Conclusion:
        """Settle on the evidence's maximum next to the particles' mean, or on the highest."""
        assert self._sighting is not None
        center = self._sighting.climb((float(box[0]), float(box[1])))
        center = self._sighting.unless_dominated(center)
        jumped = self.target.settle(frame, self._sighting, center, dt)
        live, sight = self.target.live, self.target.sight
        return Conclusion(np.array([*live.center, *live.size]), sight.confidence,
                          sight.unseen_frames, jumped)
