"""A one-dimensional correlation filter over the target's scale."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.correlation import inverse_of_half, parabola_offset
from vtrack_ros.appearance.gradients import CHANNELS, oriented_gradients
from vtrack_ros.frame import Frame

_CELL = 4
_AREA = 400
_REGULARISATION = 1e-2


@dataclass(frozen=True)
class ScaleFilter:
    """
    Tells by which factor the target grew [Danelljan et al. 2014, sec. 3.2].

    Parameters
    ----------
    factors : ndarray, shape (scales,)
        The scale factors that are compared, a geometric series about 1.
    grid : ndarray, shape (2, scales * rows, columns), [px]
        Sample points (x, y) of all scales, one below the other, from the target's centre.
    numerator : ndarray of complex64, shape (scales // 2 + 1, features)
    denominator : ndarray of float32, shape (scales // 2 + 1,)
    label : ndarray of complex64, shape (scales // 2 + 1,)
    analysis : ndarray of float32, shape (2 * (scales // 2 + 1), scales)
        Tapered Fourier transform over the scales as a matrix: the real parts, then the imaginary
        ones.
    synthesis : ndarray of float32, shape (2 * (scales // 2 + 1), scales)
        Of `inverse_of_half`.

    """

    factors: NDArray[np.float64]
    grid: NDArray[np.float32]
    numerator: NDArray[np.complex64]
    denominator: NDArray[np.float32]
    label: NDArray[np.complex64]
    analysis: NDArray[np.float32]
    synthesis: NDArray[np.float32]

    @classmethod
    def create(cls, width: float, height: float, scales: int = 17, step: float = 1.025,
               ) -> ScaleFilter:
        """Make an empty filter for a target of that size in the images to come, in pixels."""
        shrink = np.sqrt(min(1.0, _AREA / (width * height)))
        columns, rows = (max(2, round(side * shrink / _CELL)) * _CELL for side in (width, height))
        steps = np.arange(scales) - scales // 2
        factors = step**steps.astype(np.float64)
        x = width * ((np.arange(columns) + 0.5) / columns - 0.5)
        y = height * ((np.arange(rows) + 0.5) / rows - 0.5)
        shape = (scales, rows, columns)
        grid = np.stack([
            np.broadcast_to(axis * factors[:, None, None], shape).reshape(-1, columns) - 0.5
            for axis in (x[None, None, :], y[None, :, None])])
        label = np.fft.rfft(np.exp(-0.5 * (steps / (scales / 16))**2))
        transform = np.fft.rfft(np.diag(np.hanning(scales + 2)[1:-1]), axis=0)
        return cls(factors, grid.astype(np.float32), np.zeros((scales // 2 + 1, 1), np.complex64),
                   np.zeros(scales // 2 + 1, np.float32), label.astype(np.complex64),
                   np.concatenate([transform.real, transform.imag]).astype(np.float32),
                   inverse_of_half(scales))

    def transform(self, grey: Frame, center: tuple[float, float]) -> NDArray[np.complex64]:
        """
        Return the spectrum, over the scales, of the target's gradients.

        Parameters
        ----------
        grey : ndarray of uint8, shape (H, W)
            An image that shows the target.
        center : tuple of float, [px]
            The target's centre in that image.

        """
        stack = cv2.remap(
            grey, self.grid[0] + np.float32(center[0]), self.grid[1] + np.float32(center[1]),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        scales = len(self.factors)
        features = oriented_gradients(stack, _CELL).reshape(CHANNELS, scales, -1)
        parts = self.analysis @ features.transpose(1, 0, 2).reshape(scales, -1)
        spectrum = np.empty((scales // 2 + 1, parts.shape[1]), np.complex64)
        spectrum.real, spectrum.imag = parts[:len(spectrum)], parts[len(spectrum):]
        return spectrum

    def learned(self, spectrum: NDArray[np.complex64], rate: float,
                shift: float = 0.0) -> ScaleFilter:
        """Return the filter after an example whose true scale is `shift` steps off the middle."""
        label = self.label
        if shift:
            label = label * np.exp(
                -2j * np.pi * shift * np.arange(len(label)) / len(self.factors)
            ).astype(np.complex64)
        numerator = (np.float32(rate) * np.conj(label))[:, None] * spectrum
        parts = spectrum.view(np.float32)
        denominator = np.float32(rate) * np.einsum('sf,sf->s', parts, parts)
        if rate < 1:
            keep = np.float32(1 - rate)
            numerator += keep * self.numerator
            denominator += keep * self.denominator
        return ScaleFilter(
            self.factors, self.grid, numerator, denominator, self.label, self.analysis,
            self.synthesis)

    def response(self, spectrum: NDArray[np.complex64]) -> NDArray[np.float32]:
        """Return the response to each factor, shape (scales,)."""
        correlated = (self._conjugate * spectrum).sum(axis=1)
        correlated /= self.denominator + np.float32(_REGULARISATION)
        response: NDArray[np.float32] = correlated.view(np.float32) @ self.synthesis
        return response

    @cached_property
    def _conjugate(self) -> NDArray[np.complex64]:
        return self.numerator.conj()

    def peak(self, response: NDArray[np.float32]) -> tuple[float, float]:
        """Return the best factor, refined by a parabola, and its steps from the middle."""
        best = int(response.argmax())
        place = float(best)
        if 0 < best < len(response) - 1:
            place += parabola_offset(*(float(response[best + i]) for i in (-1, 0, 1)))
        steps = place - len(response) // 2
        return float((self.factors[1] / self.factors[0])**steps), steps
