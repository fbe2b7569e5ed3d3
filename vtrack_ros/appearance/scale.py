"""A one-dimensional correlation filter over the target's scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
import scipy.fft

from vtrack_ros.appearance.correlation import parabola_offset
from vtrack_ros.appearance.gradients import oriented_gradients
from vtrack_ros.frame import Frame

_CELL = 4
_AREA = 512
_REGULARISATION = 1e-2


@dataclass(frozen=True)
class ScaleFilter:
    """
    Tells by which factor the target grew [Danelljan et al. 2014, sec. 3.2].

    Parameters
    ----------
    factors : ndarray, shape (scales,)
        The scale factors that are compared, a geometric series about 1.
    grid : ndarray, shape (2, scales * rows, columns)
        Sample points (x, y) of all scales, one below the other, in units of the target's size
        from its centre.
    numerator : ndarray of complex64, shape (scales // 2 + 1, features)
    denominator : ndarray of float32, shape (scales // 2 + 1,)
    label : ndarray of complex64, shape (scales // 2 + 1,)
    taper : ndarray of float32, shape (scales, 1)

    """

    factors: NDArray[np.float64]
    grid: NDArray[np.float32]
    numerator: NDArray[np.complex64]
    denominator: NDArray[np.float32]
    label: NDArray[np.complex64]
    taper: NDArray[np.float32]

    @classmethod
    def create(cls, width: float, height: float, scales: int = 17, step: float = 1.025,
               ) -> ScaleFilter:
        """Make an empty filter for a target of that size, in pixels."""
        shrink = np.sqrt(min(1.0, _AREA / (width * height)))
        columns, rows = (max(2, round(side * shrink / _CELL)) * _CELL for side in (width, height))
        steps = np.arange(scales) - scales // 2
        factors = step**steps.astype(np.float64)
        x = ((np.arange(columns) + 0.5) / columns - 0.5)[None, None, :] * factors[:, None, None]
        y = ((np.arange(rows) + 0.5) / rows - 0.5)[None, :, None] * factors[:, None, None]
        shape = (scales, rows, columns)
        grid = np.stack([np.broadcast_to(axis, shape).reshape(-1, columns) for axis in (x, y)])
        label = np.exp(-0.5 * (steps / (scales / 16))**2).astype(np.float32)
        return cls(factors, grid.astype(np.float32), np.zeros((scales // 2 + 1, 1), np.complex64),
                   np.zeros(scales // 2 + 1, np.float32), scipy.fft.rfft(label),
                   np.hanning(scales + 2)[1:-1, None].astype(np.float32))

    def transform(self, grey: Frame, center: tuple[float, float],
                  size: tuple[float, float]) -> NDArray[np.complex64]:
        """
        Return the spectrum, over the scales, of the target's gradients.

        Parameters
        ----------
        grey : ndarray of uint8, shape (H, W)
            An image that shows the target; its resolution may be any.
        center, size : tuple of float, [px]
            The target's centre and size in that image.

        """
        x = self.grid[0] * np.float32(size[0]) + np.float32(center[0] - 0.5)
        y = self.grid[1] * np.float32(size[1]) + np.float32(center[1] - 0.5)
        stack = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        features = oriented_gradients(stack, _CELL).reshape(len(self.factors), -1)
        spectrum: NDArray[np.complex64] = scipy.fft.rfft(features * self.taper, axis=0)
        return spectrum

    def learned(self, spectrum: NDArray[np.complex64], rate: float,
                shift: float = 0.0) -> ScaleFilter:
        """Return the filter after an example whose true scale is `shift` steps off the middle."""
        label = self.label
        if shift:
            label = label * np.exp(
                -2j * np.pi * shift * np.arange(len(label)) / len(self.factors)
            ).astype(np.complex64)
        numerator = np.conj(label)[:, None] * spectrum
        denominator = np.einsum('sf,sf->s', spectrum.real, spectrum.real)
        denominator += np.einsum('sf,sf->s', spectrum.imag, spectrum.imag)
        if rate < 1:
            keep = np.float32(1 - rate)
            numerator = keep * self.numerator + np.float32(rate) * numerator
            denominator = keep * self.denominator + np.float32(rate) * denominator
        return replace(self, numerator=numerator, denominator=denominator)

    def response(self, spectrum: NDArray[np.complex64]) -> NDArray[np.float32]:
        """Return the response to each factor, shape (scales,)."""
        correlated = np.einsum('sf,sf->s', self.numerator.conj(), spectrum)
        response: NDArray[np.float32] = scipy.fft.irfft(
            correlated / (self.denominator + np.float32(_REGULARISATION)), len(self.factors))
        return response

    def peak(self, response: NDArray[np.float32]) -> tuple[float, float]:
        """Return the best factor, refined by a parabola, and its steps from the middle."""
        best = int(response.argmax())
        place = float(best)
        if 0 < best < len(response) - 1:
            place += parabola_offset(*(float(response[best + i]) for i in (-1, 0, 1)))
        steps = place - len(response) // 2
        return float((self.factors[1] / self.factors[0])**steps), steps
