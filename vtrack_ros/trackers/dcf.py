"""The discriminative correlation filter alone: no temporal filter, no particles."""

import numpy as np

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.localisation import Localiser
from vtrack_ros.localisation.filter_parameters import PRESENCE
from vtrack_ros.tracker import Estimate, Tracker


class CorrelationTracker(Tracker):
    """
    Takes the highest response in the window about the last place.

    It's the baseline that shows what the other trackers add to it.
    """

    NAME = 'dcf'
    SUMMARY = 'discriminative correlation filter without particles (DCF)'
    PARAMETERS = PRESENCE

    def _start(self, frame: Frame, box: Box) -> Estimate:
        self._localiser = Localiser(frame, box.center, (box.width, box.height), self._rng)
        return self._localiser.estimate(np.zeros((4, 4)))

    def _update(self, frame: Frame, dt: float) -> Estimate:
        self._localiser.require(float(self._parameters['confidence_threshold']))
        response = self._localiser.localise(frame, self._localiser.center)
        self._localiser.update(frame, response, response.center, dt)
        return self._localiser.estimate(np.zeros((4, 4)))
