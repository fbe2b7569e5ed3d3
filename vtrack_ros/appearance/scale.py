"""How much a target grew: a linear regression from what it looks like."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.features import GRADIENT_CHANNELS, oriented_gradients
from vtrack_ros.frame import Frame

_CELL = 4
#: Samples of one look, at most.
_AREA = 1200
#: Side of the region that is looked at, in units of the target's: its outline has to be in it.
_REACH = 1.4
#: Logarithms of the scales whose look is learned, and of the scale of a look.
_EXAMPLES = 0.1 * np.arange(-2, 3)
_AS_IT_IS = np.zeros(1)
#: Ridge, as a share of the examples' mean energy.
_RIDGE = 0.1


@dataclass(frozen=True)
class ScaleRegression:
    """
    Tells by which factor the target grew.

    A hyperplane tracker [Jurie and Dhome 2002] for one parameter: what the target would look like
    if the box were too small or too large is known by resampling one image, and ridge regression
    finds the weights with which the difference of looks gives the logarithm of the size's error.

    Parameters
    ----------
    grid : ndarray of float32, shape (2, rows, columns), [px]
        Sample points (x, y) of one look, from the target's centre.
    examples : ndarray of float32, shape (examples, features)
        Running average of the looks at all scales.
    weights : ndarray of float32, shape (features,)
    offset : float
        An estimate is `weights @ look + offset`.

    """

    grid: NDArray[np.float32]
    examples: NDArray[np.float32]
    weights: NDArray[np.float32]
    offset: float

    @classmethod
    def create(cls, width: float, height: float) -> ScaleRegression:
        """Make an empty regression for a target of that size in the images to come, in pixels."""
        width, height = _REACH * width, _REACH * height
        shrink = np.sqrt(min(1.0, _AREA / (width * height)))
        columns, rows = (max(2, round(side * shrink / _CELL)) * _CELL for side in (width, height))
        x, y = (side * ((np.arange(samples) + 0.5) / samples - 0.5)
                for side, samples in ((width, columns), (height, rows)))
        grid = np.stack(np.meshgrid(x, y)).astype(np.float32)
        nothing = np.empty(0, np.float32)
        return cls(grid, nothing, nothing, 0.0)

    def growth(self, grey: Frame, center: tuple[float, float]) -> float:
        """
        Return the factor by which the target is larger than it was learned.

        Parameters
        ----------
        grey : ndarray of uint8, shape (H, W)
            An image that shows the target.
        center : tuple of float, [px]
            The target's centre in that image.

        """
        excess = float(self._looks(grey, center, _AS_IT_IS)[0] @ self.weights) + self.offset
        return float(np.exp(min(max(-excess, _EXAMPLES[0]), _EXAMPLES[-1])))

    def updated(self, grey: Frame, center: tuple[float, float], growth: float,
                rate: float) -> ScaleRegression:
        """
        Return the regression after an example of the target, `growth` times as large as before.

        Parameters
        ----------
        grey, center
            As in `growth`.
        growth : float
            The factor.
        rate : float
            The example's weight in the running average; 1 forgets all that was before.

        """
        examples = self._looks(grey, center, _EXAMPLES + np.log(growth))
        if rate < 1:
            examples *= np.float32(rate)
            examples += np.float32(1 - rate) * self.examples
        mean = examples.mean(axis=0)
        differences = examples - mean
        products = differences @ differences.T
        ridge = _RIDGE * np.trace(products) / len(products) + 1e-6
        dual = np.linalg.solve(products + ridge * np.eye(len(products)), _EXAMPLES)
        weights = dual.astype(np.float32) @ differences
        return ScaleRegression(self.grid, examples, weights, -float(mean @ weights))

    def _looks(self, grey: Frame, center: tuple[float, float],
               scales: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the gradients, shape (scales, features), at logarithms of scale."""
        columns = self.grid.shape[2]
        factors = np.exp(scales).astype(np.float32)[:, None, None]
        # OpenCV counts from the centre of a pixel, boxes from its outer corner
        x, y = ((factors * axis + np.float32(middle - 0.5)).reshape(-1, columns)
                for axis, middle in zip(self.grid, center))
        # one below the other; that a look's first and last rows see its neighbour does no harm
        stack = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        features = oriented_gradients(stack, _CELL).reshape(GRADIENT_CHANNELS, len(scales), -1)
        return features.transpose(1, 0, 2).reshape(len(scales), -1)
