"""Base class of the trackers whose localiser is selected by the parameter `localiser`."""

import numpy as np

from vtrack_ros.appearance.siamese_network import SiameseNetwork
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.localisation import GuidedSearch, Hypotheses
from vtrack_ros.parameters import Value
from vtrack_ros.tracker import Tracker


class LocalisedTracker(Tracker):
    """
    A tracker whose table holds the parameters `filter_parameters.LOCALISER`.

    When the localiser is changed, the new one learns the target's appearance from the first frame
    and continues at the target's present place.
    """

    _localiser: Hypotheses
    _search: GuidedSearch
    _network: SiameseNetwork | None = None
    _files: tuple[str, str] | None = None

    def _prepare(self, values: dict[str, Value]) -> None:
        files = str(values['siamese.backbone']), str(values['siamese.head'])
        if values['localiser'] != 'siamese':
            self._network = self._files = None
        elif not all(files):
            raise ValueError("localiser 'siamese' needs the files siamese.backbone and "
                             f'siamese.head, but they are {files[0]!r} and {files[1]!r}')
        elif files != self._files:
            self._network, self._files = SiameseNetwork(*files), files

    def _begin(self, frame: Frame, box: Box) -> None:
        """Learn the target in the first frame."""
        self._localiser = Hypotheses(
            frame, box.center, (box.width, box.height), self._rng, self._network)
        self._search = GuidedSearch(frame, self._localiser)

    def _adjust(self) -> None:
        """Apply the parameters of the localiser."""
        if self._localiser.network is not self._network:
            self._localiser.use(self._network)
        self._localiser.require(float(self._parameters['confidence_threshold']))

    def _boxes(self, centers: Array) -> Array:
        """Return boxes of the target's size, shape (N, 4), about centres, shape (N, 2)."""
        box = self._localiser.box
        return np.concatenate([centers, np.full(centers.shape, (box.width, box.height))], 1)
