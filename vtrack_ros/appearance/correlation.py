"""A discriminative correlation filter over feature maps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
import scipy.fft

Spectrum = NDArray[np.complex64]


@dataclass(frozen=True)
class CorrelationFilter:
    """
    The filter whose response to the target is a Gaussian at the target's place.

    Ridge regression over all cyclic shifts of the window, solved one frequency at a time
    [Danelljan et al. 2014, eqs 2-6]: numerator and denominator are averaged over time.

    Parameters
    ----------
    numerator : ndarray of complex64, shape (channels, rows, columns // 2 + 1)
        Its running average.
    denominator : ndarray of float32, shape (rows, columns // 2 + 1)
        Its running average.
    label : ndarray of complex64, shape (rows, columns // 2 + 1)
        Spectrum of the wanted response, whose peak is in the middle of the window.
    taper : ndarray of float32, shape (rows, columns, 1)
        What the features are multiplied with so that the window's edges fade.
    regularisation : float

    """

    numerator: Spectrum
    denominator: NDArray[np.float32]
    label: Spectrum
    taper: NDArray[np.float32]
    regularisation: float

    @classmethod
    def create(cls, rows: int, columns: int, width: float, regularisation: float = 1e-2,
               ) -> CorrelationFilter:
        """Make an empty filter; `width` is the wanted response's standard deviation in cells."""
        y = np.arange(rows)[:, None] - rows // 2
        x = np.arange(columns)[None, :] - columns // 2
        label = np.exp(-(x**2 + y**2) / (2 * width**2)).astype(np.float32)
        taper = np.hanning(rows + 2)[1:-1, None] * np.hanning(columns + 2)[None, 1:-1]
        spectrum = scipy.fft.rfft2(label)
        return cls(np.zeros((1, *spectrum.shape), np.complex64),
                   np.zeros(spectrum.shape, np.float32), spectrum,
                   taper.astype(np.float32)[:, :, None], regularisation)

    def transform(self, features: NDArray[np.float32]) -> Spectrum:
        """Return the spectrum of tapered features of shape (rows, columns, channels)."""
        tapered = np.ascontiguousarray((features * self.taper).transpose(2, 0, 1))
        spectrum: Spectrum = scipy.fft.rfft2(tapered, overwrite_x=True)
        return spectrum

    def learned(self, spectrum: Spectrum, rate: float,
                shift: tuple[float, float] = (0.0, 0.0)) -> CorrelationFilter:
        """
        Return the filter after one more example.

        Parameters
        ----------
        spectrum : ndarray of complex64, shape (channels, rows, columns // 2 + 1)
            Of the example.
        rate : float
            The example's weight in the running average; 1 forgets all that was before.
        shift : tuple of float, [cells]
            Where (x, y) from the middle of the window the target is in the example.

        """
        label = self.label
        if shift != (0.0, 0.0):
            rows, columns = self.taper.shape[:2]
            phase_x = np.exp(-2j * np.pi * shift[0] * np.arange(columns // 2 + 1) / columns)
            phase_y = np.exp(-2j * np.pi * shift[1] * scipy.fft.fftfreq(rows))
            label = label * (phase_y[:, None] * phase_x).astype(np.complex64)
        numerator = np.conj(label) * spectrum
        denominator = np.einsum('cij,cij->ij', spectrum.real, spectrum.real)
        denominator += np.einsum('cij,cij->ij', spectrum.imag, spectrum.imag)
        if rate < 1:
            keep = np.float32(1 - rate)
            numerator *= np.float32(rate)
            denominator *= np.float32(rate)
            numerator += keep * self.numerator
            denominator += keep * self.denominator
        return replace(self, numerator=numerator, denominator=denominator)

    def response(self, spectrum: Spectrum) -> NDArray[np.float32]:
        """Return the response, shape (rows, columns): about 1 at the target, 0 elsewhere."""
        correlated = np.einsum('cij,cij->ij', self.numerator.conj(), spectrum)
        correlated /= self.denominator + np.float32(self.regularisation)
        response: NDArray[np.float32] = scipy.fft.irfft2(
            correlated, s=self.taper.shape[:2], overwrite_x=True)
        return response


def subcell_peak(response: NDArray[np.float32]) -> tuple[float, float, float]:
    """
    Return the highest value of a map and its place (value, x, y), refined by a parabola.

    Parameters
    ----------
    response : ndarray, shape (rows, columns)
        The map.

    Returns
    -------
    tuple of float
        The value at the highest cell, and x and y in cells from the first cell.

    """
    row, column = divmod(int(response.argmax()), response.shape[1])
    x, y = subcell_offset(response, row, column)
    return float(response[row, column]), column + x, row + y


def subcell_offset(response: NDArray[np.float32], row: int, column: int) -> tuple[float, float]:
    """Return how far (x, y) a maximum is from its cell, from -0.5 to 0.5; 0 at the border."""
    x = y = 0.0
    value = float(response[row, column])
    if 0 < column < response.shape[1] - 1:
        x = parabola_offset(float(response[row, column - 1]), value,
                            float(response[row, column + 1]))
    if 0 < row < response.shape[0] - 1:
        y = parabola_offset(float(response[row - 1, column]), value,
                            float(response[row + 1, column]))
    return x, y


def parabola_offset(before: float, peak: float, after: float) -> float:
    """Return where, from -0.5 to 0.5, the parabola through three equidistant values peaks."""
    curvature = before - 2 * peak + after
    return 0.5 * (before - after) / curvature if curvature < 0 else 0.0
