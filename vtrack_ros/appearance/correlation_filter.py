"""A discriminative correlation filter over feature maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

Spectrum = NDArray[np.complex64]

_WHOLE = slice(None)


@dataclass(frozen=True)
class CorrelationFilter:
    """
    The filter whose response to the target is a Gaussian at the target's place.

    Ridge regression over all cyclic shifts of the window, solved one frequency at a time
    [Danelljan et al. 2014, eqs 2-6]: numerator and denominator are averaged over time.

    Parameters
    ----------
    numerator : ndarray of complex64, shape ([filters,] channels, rows, columns // 2 + 1)
        Its running average; of several filters, to be asked at once, where there's one axis more.
    denominator : ndarray of float32, shape (rows, columns // 2 + 1)
        Its running average.
    label : ndarray of complex64, shape (rows, columns // 2 + 1)
        Conjugate spectrum of the wanted response, whose peak is in the middle of the window.
    shape : tuple of int, [cells]
        (rows, columns) of the window.
    regularisation : float

    """

    numerator: Spectrum
    denominator: NDArray[np.float32]
    label: Spectrum
    shape: tuple[int, int]
    regularisation: float

    @classmethod
    def create(cls, rows: int, columns: int, width: float, regularisation: float = 1e-2,
               ) -> CorrelationFilter:
        """Make an empty filter; `width` is the wanted response's standard deviation in cells."""
        y = np.arange(rows)[:, None] - rows // 2
        x = np.arange(columns)[None, :] - columns // 2
        label = np.exp(-(x**2 + y**2) / (2 * width**2)).astype(np.float32)
        spectrum = np.fft.rfft2(label).conj().astype(np.complex64)
        return cls(np.zeros((1, *spectrum.shape), np.complex64),
                   np.zeros(spectrum.shape, np.float32), spectrum,
                   (rows, columns), regularisation)

    @staticmethod
    def transform(features: NDArray[np.float32]) -> Spectrum:
        """Return the spectrum of features of shape (channels, rows, columns), edges faded."""
        channels, rows, columns = features.shape
        over_columns, over_rows = _transform(rows, columns)
        half = (features.reshape(-1, columns) @ over_columns).view(np.complex64)
        # one product of large matrices is twice as quick as one for each channel
        side_by_side = half.reshape(channels, rows, -1).swapaxes(0, 1).reshape(rows, -1)
        spectrum: Spectrum = (over_rows @ side_by_side).reshape(rows, channels, -1)
        return np.ascontiguousarray(spectrum.swapaxes(0, 1))

    def updated(self, spectrum: Spectrum, rate: float,
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
        over_rows, over_columns = _frequencies(*self.shape)
        wanted = self.label * np.exp(shift[1] * over_rows)
        wanted *= rate * np.exp(shift[0] * over_columns)
        numerator = wanted * spectrum
        denominator = power(spectrum)
        denominator *= rate
        if rate < 1:
            numerator += (1 - rate) * self.numerator
            denominator += (1 - rate) * self.denominator
        return CorrelationFilter(
            numerator, denominator, self.label, self.shape, self.regularisation)

    def response(self, spectrum: Spectrum, rows: slice = _WHOLE, columns: slice = _WHOLE,
                 ) -> NDArray[np.float32]:
        """
        Return the response, shape ([filters,] rows, columns): 1 at the target, 0 elsewhere.

        Parameters
        ----------
        spectrum : ndarray of complex64, shape (channels, rows, columns // 2 + 1)
            Of a window.
        rows, columns : slice
            The part that is wanted; all of it by default.

        """
        # a sum over products: einsum is three times as slow with complex numbers
        correlated = np.add.reduce(self._conjugate * spectrum, axis=-3)
        correlated /= self._divisor
        over_rows, over_columns = _inverse_transform(*self.shape)
        half: Spectrum = over_rows[rows] @ correlated
        response: NDArray[np.float32] = half.view(np.float32) @ over_columns[:, columns]
        return response

    def confined(self, width: float, height: float) -> CorrelationFilter:
        """
        Return the filter without what it knows of a target's surroundings.

        Parameters
        ----------
        width, height : float, [cells]
            The target's; what is further from its middle has no influence on the response there.

        """
        rows, columns = self.shape
        kernel = np.fft.irfft2(self._conjugate / self._divisor, (rows, columns))
        down, across = (np.abs(np.fft.fftfreq(cells) * cells) for cells in (rows, columns))
        kernel *= np.clip(height / 2 + 0.5 - down, 0, 1)[:, None]
        kernel *= np.clip(width / 2 + 0.5 - across, 0, 1)
        numerator = np.fft.rfft2(kernel).conj() * self._divisor
        return replace(self, numerator=numerator.astype(np.complex64))

    @cached_property
    def _conjugate(self) -> Spectrum:
        return self.numerator.conj()

    @cached_property
    def _divisor(self) -> NDArray[np.float32]:
        return self.denominator + np.float32(self.regularisation)


@lru_cache(maxsize=32)
def _frequencies(rows: int, columns: int) -> tuple[Spectrum, Spectrum]:
    """Return 2 pi i times the frequencies, shapes (rows, 1) and (columns // 2 + 1,)."""
    over_rows = 2j * np.pi * np.fft.fftfreq(rows)[:, None]
    over_columns = 2j * np.pi * np.fft.rfftfreq(columns)
    return over_rows.astype(np.complex64), over_columns.astype(np.complex64)


# Windows are so small that Fourier transforms are quicker as matrix products.


@lru_cache(maxsize=32)
def _transform(rows: int, columns: int) -> tuple[NDArray[np.float32], Spectrum]:
    """
    Return the tapered Fourier transform of real maps as two matrices.

    Returns
    -------
    ndarray of float32, shape (columns, 2 * (columns // 2 + 1))
        To be multiplied with a map from the right; real and imaginary parts are interleaved.
    ndarray of complex64, shape (rows, rows)
        To be multiplied with the result from the left.

    """
    over_columns = np.fft.rfft(np.diag(taper(columns))).astype(np.complex64).view(np.float32)
    return over_columns, np.fft.fft(np.diag(taper(rows))).T.astype(np.complex64)


def taper(length: int) -> NDArray[np.float64]:
    """Return by how much each cell along a side counts, so that a window's edges fade."""
    return np.hanning(length + 2)[1:-1]


@lru_cache(maxsize=32)
def _inverse_transform(rows: int, columns: int) -> tuple[Spectrum, NDArray[np.float32]]:
    """
    Return the inverse as two matrices.

    Returns
    -------
    ndarray of complex64, shape (rows, rows)
        To be multiplied with a spectrum from the left.
    ndarray of float32, shape (2 * (columns // 2 + 1), columns)
        To be multiplied with the result, whose real and imaginary parts are interleaved, from
        the right.

    """
    return np.fft.ifft(np.eye(rows)).astype(np.complex64), _inverse_of_half(columns)


def _inverse_of_half(length: int) -> NDArray[np.float32]:
    """
    Return the matrix that makes real series from their non-negative frequencies.

    Returns
    -------
    ndarray of float32, shape (2 * (length // 2 + 1), length)
        To be multiplied with spectra, real and imaginary parts interleaved, from the right.

    """
    half = np.eye(length // 2 + 1)
    parts = np.stack([np.fft.irfft(half, length), np.fft.irfft(1j * half, length)], axis=1)
    return parts.reshape(-1, length).astype(np.float32)


def power(spectrum: Spectrum) -> NDArray[np.float32]:
    """Return the sum of squared magnitudes over the first axis."""
    parts = spectrum.view(np.float32)
    squares = np.einsum('c...,c...->...', parts, parts)
    total: NDArray[np.float32] = squares[..., ::2] + squares[..., 1::2]
    return total
