"""A tracker of one's own: the highest response, but only part of a short step there."""

import numpy as np

from vtrack_ros.localisation import Localiser
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Tracker


class SteadyTracker(Tracker):
    """Goes to the highest response of the shared target model; if that is near, smoothly."""

    NAME = 'steady'
    SUMMARY = 'highest response, smoothed'
    PARAMETERS = ParameterTable([
        Parameter('share', 0.7, 'Share of a short step that is made in a frame.', 0.1, 1.0)])

    def _configure(self):
        """Take the parameters: at the start, and whenever one of them changes."""
        self._share = float(self.parameters['share'])

    def _start(self, frame, box):
        self._localiser = Localiser(frame, box.center, (box.width, box.height), self._rng)
        return self._estimate()

    def _update(self, frame, dt):
        here = np.array(self._localiser.center)
        response = self._localiser.localise(frame, self._localiser.center)
        x, y = here + self._share * (response.center - here)
        # Of a place more than a cell from the window's middle the localiser takes the maximum
        # near it: the model has to learn the target, not what is beside it.
        self._localiser.update(frame, response, (float(x), float(y)), dt)
        return self._estimate()

    def _estimate(self):
        # No filter, so that the covariance is but the localiser's own.
        return self._localiser.estimate(np.zeros((4, 4)))
