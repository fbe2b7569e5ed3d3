"""
Ridge regressions from features: where a target is, and by how much it grew.

Both average their examples over time, and neither is changed in place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.features import Features, GRADIENT_CHANNELS, oriented_gradients
from vtrack_ros.appearance.sampling import sample_grids
from vtrack_ros.frame import Array, Array32, Frame, Point

Spectrum = NDArray[np.complex64]

_WHOLE = slice(None)

#: Side of a gradient cell of the scale regression, in samples.
_CELL = 4
#: Upper bound of a patch's number of samples.
_AREA = 1200
#: Side of the sampled region, in target sides; above 1, so that the target's outline is in it.
_REACH = 1.4
#: Log scales of the examples that are learned, and of the one that is measured.
_EXAMPLES = 0.1 * np.arange(-2, 3)
_AS_IT_IS = np.zeros(1)
#: Ridge, as a share of the examples' mean energy.
_RIDGE = 0.1


@dataclass(frozen=True)
class CorrelationFilter:
    """
    The filter whose response to the target is a Gaussian at the target's place.

    Ridge regression over all cyclic shifts of the window, solved one frequency at a time
    [Danelljan et al. 2014, eqs 2-6]: numerator, shape (channels, rows, columns // 2 + 1), and
    denominator are exponential moving averages. Several filters can be evaluated at once: the
    numerator then has one more axis in front. The label is the conjugate spectrum of the desired
    response, whose peak is in the middle of the window.
    """

    numerator: Spectrum
    denominator: Array32
    label: Spectrum
    shape: tuple[int, int]
    regularisation: float

    #: Learning rate while the target is tracked: weight of an example in the moving average.
    RATE: ClassVar[float] = 0.02

    @classmethod
    def create(cls, rows: int, columns: int, width: float, regularisation: float = 1e-2,
               ) -> CorrelationFilter:
        """Make an empty filter; `width` is the desired response's standard deviation in cells."""
        y = np.arange(rows)[:, None] - rows // 2
        x = np.arange(columns)[None, :] - columns // 2
        label = np.exp(-(x**2 + y**2) / (2 * width**2)).astype(np.float32)
        spectrum = np.fft.rfft2(label).conj().astype(np.complex64)
        return cls(np.zeros((1, *spectrum.shape), np.complex64),
                   np.zeros(spectrum.shape, np.float32), spectrum,
                   (rows, columns), regularisation)

    @staticmethod
    def transform(features: Features) -> Spectrum:
        """Return the spectrum of features, shape (channels, rows, columns), tapered at edges."""
        return transformed_maps(features, tapered=True)

    def updated(self, spectrum: Spectrum, rate: float,
                shift: Point = (0.0, 0.0)) -> CorrelationFilter:
        """
        Return the filter after one more example, with weight `rate` in the moving average.

        `shift` is where, in cells from the middle of the window, the target is in the example.
        """
        over_rows, over_columns = fourier_matrices(*self.shape)
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

    def mixed(self, other: CorrelationFilter, share: float) -> Self:
        """Return the weighted mean of this filter and another one, which has weight `share`."""
        own, its = np.float32(1 - share), np.float32(share)
        return replace(
            self, numerator=own * self.numerator + its * other.numerator,
            denominator=own * self.denominator + its * other.denominator)

    def response(self, spectrum: Spectrum, rows: slice = _WHOLE, columns: slice = _WHOLE,
                 ) -> Array32:
        """
        Return the response, shape ([filters,] rows, columns): 1 at the target, 0 elsewhere.

        `spectrum` is a window's; `rows` and `columns` select the part that is computed.
        """
        # a sum over products: einsum is three times as slow with complex numbers
        correlated = np.add.reduce(self._conjugate * spectrum, axis=-3)
        correlated /= self._divisor
        over_rows, over_columns = inverse_matrices(*self.shape)
        half: Spectrum = over_rows[rows] @ correlated
        return half.view(np.float32) @ over_columns[:, columns]

    def confined(self, width: float, height: float) -> CorrelationFilter:
        """
        Return the filter with its kernel masked to the box of a target, without surroundings.

        What is outside a box of this width and height, in cells, about a place has no influence
        on the response at that place.
        """
        rows, columns = self.shape
        kernel = np.fft.irfft2(self._conjugate / self._divisor, (rows, columns))
        kernel *= box_support(rows, columns, width, height)
        numerator = np.fft.rfft2(kernel).conj() * self._divisor
        return replace(self, numerator=numerator.astype(np.complex64))

    @cached_property
    def _conjugate(self) -> Spectrum:
        return self.numerator.conj()

    @cached_property
    def _divisor(self) -> Array32:
        return self.denominator + np.float32(self.regularisation)


@dataclass(frozen=True)
class ScaleRegression:
    """
    Estimates the factor by which the target grew.

    A hyperplane tracker [Jurie and Dhome 2002] for one parameter: examples of a box that is too
    small or too large are made by resampling one image, and ridge regression finds the weights by
    which the features give the logarithm of the error of size. `axes`, shapes (columns,) and
    (rows,), are the sample points' x and y from the target's centre, in pixels; `examples`, shape
    (scales, features), are the moving averages of the features at each scale.
    """

    axes: tuple[Array32, Array32]
    examples: Array32

    @classmethod
    def create(cls, width: float, height: float) -> ScaleRegression:
        """Make an empty regression for a target of that size, in pixels, in later images."""
        width, height = _REACH * width, _REACH * height
        shrink = np.sqrt(min(1.0, _AREA / (width * height)))
        columns, rows = (max(2, round(side * shrink / _CELL)) * _CELL for side in (width, height))
        x, y = ((side * ((np.arange(samples) + 0.5) / samples - 0.5)).astype(np.float32)
                for side, samples in ((width, columns), (height, rows)))
        return cls((x, y), np.empty(0, np.float32))

    def growth(self, grey: Frame, center: Point) -> float:
        """Return the factor by which a target at `center`, [px], is larger than learned."""
        mean, weights = self._solution
        excess = float((self._features(grey, center, _AS_IT_IS)[0] - mean) @ weights)
        return float(np.exp(min(max(-excess, _EXAMPLES[0]), _EXAMPLES[-1])))

    def updated(self, grey: Frame, center: Point, growth: float, rate: float) -> ScaleRegression:
        """Return the regression after an example of a target that has grown by a factor."""
        examples = self._features(grey, center, _EXAMPLES + np.log(growth))
        fresh = ScaleRegression(self.axes, examples)
        return self.mixed(fresh, rate) if rate < 1 else fresh

    def mixed(self, other: ScaleRegression, share: float) -> ScaleRegression:
        """Return the weighted mean of this and another one, which has weight `share`."""
        examples = np.float32(1 - share) * self.examples + np.float32(share) * other.examples
        return ScaleRegression(self.axes, examples)

    @cached_property
    def _solution(self) -> tuple[Array32, Array32]:
        """Return the mean features, and the weights of deviations from them."""
        mean = self.examples.mean(axis=0)
        differences = self.examples - mean
        products = differences @ differences.T
        ridge = _RIDGE * np.trace(products) / len(products) + 1e-6
        dual = np.linalg.solve(products + ridge * np.eye(len(products)), _EXAMPLES)
        return mean, dual.astype(np.float32) @ differences

    def _features(self, grey: Frame, center: Point, scales: Array) -> Array32:
        """Return the gradient features, shape (scales, features), at log scales."""
        factors = np.exp(scales).astype(np.float32)[:, None]
        # samples count from the centre of a pixel, boxes from its outer corner
        x, y = (factors * axis + np.float32(middle - 0.5)
                for axis, middle in zip(self.axes, center))
        # patches are stacked vertically: gradients across their borders do no harm
        stack = sample_grids(grey, x, y).reshape(-1, x.shape[1])
        features = oriented_gradients(stack, _CELL).reshape(GRADIENT_CHANNELS, len(scales), -1)
        return features.transpose(1, 0, 2).reshape(len(scales), -1)


@lru_cache(maxsize=32)
def fourier_matrices(rows: int, columns: int) -> tuple[Spectrum, Spectrum]:
    """Return 2 pi i times the frequencies, shapes (rows, 1) and (columns // 2 + 1,)."""
    over_rows = 2j * np.pi * np.fft.fftfreq(rows)[:, None]
    over_columns = 2j * np.pi * np.fft.rfftfreq(columns)
    return over_rows.astype(np.complex64), over_columns.astype(np.complex64)


# Windows are so small that Fourier transforms are quicker as matrix products. There is one product
# for each channel: OpenBLAS splits larger ones among threads, which take milliseconds to wake up
# on a busy machine.


@lru_cache(maxsize=64)
def transform_matrices(rows: int, columns: int, tapered: bool) -> tuple[Array32, Spectrum]:
    """
    Return the Fourier transform of real maps as matrices: the right factor, the left factor.

    Real and imaginary parts are interleaved in the first. Both include `taper` if wanted.
    """
    across, down = (np.diag(taper(cells)) if tapered else np.eye(cells)
                    for cells in (columns, rows))
    over_columns = np.fft.rfft(across).astype(np.complex64).view(np.float32)
    return over_columns, np.fft.fft(down).T.astype(np.complex64)


def transformed_maps(maps: Array32, tapered: bool = False) -> Spectrum:
    """Return the spectrum of maps, shape (channels, rows, columns), that may be tapered first."""
    over_columns, over_rows = transform_matrices(*maps.shape[1:], tapered)
    spectrum: Spectrum = over_rows @ (maps @ over_columns).view(np.complex64)
    return spectrum


def inverse_maps(spectrum: Spectrum) -> Array32:
    """Return the maps, shape (channels, rows, columns), of a spectrum."""
    over_rows, over_columns = inverse_matrices(spectrum.shape[1], 2 * (spectrum.shape[2] - 1))
    maps: Array32 = (over_rows @ spectrum).view(np.float32) @ over_columns
    return maps


@lru_cache(maxsize=32)
def box_support(rows: int, columns: int, width: float, height: float) -> Array32:
    """Return each cell's share inside a box about (0, 0), cyclically; sizes in cells."""
    return np.outer(side_support(rows, height), side_support(columns, width))


def side_support(cells: int, length: float) -> Array32:
    """Return each cell's share, along a side, inside a length about 0, cyclically."""
    distance = np.abs(np.fft.fftfreq(cells) * cells)
    return np.clip(length / 2 + 0.5 - distance, 0, 1).astype(np.float32)


def taper(length: int) -> Array:
    """Return a Hann window without its zeros: weights of the cells along a side."""
    return np.hanning(length + 2)[1:-1]


@lru_cache(maxsize=32)
def inverse_matrices(rows: int, columns: int) -> tuple[Spectrum, Array32]:
    """
    Return the inverse Fourier transform as matrices: the left factor, then the right factor.

    The second makes real series from their non-negative frequencies, whose real and imaginary
    parts are interleaved.
    """
    half = np.eye(columns // 2 + 1)
    parts = np.stack([np.fft.irfft(half, columns), np.fft.irfft(1j * half, columns)], axis=1)
    return (np.fft.ifft(np.eye(rows)).astype(np.complex64),
            parts.reshape(-1, columns).astype(np.float32))


def power(spectrum: Spectrum) -> Array32:
    """Return the sum of squared magnitudes over the first axis."""
    parts = spectrum.view(np.float32)
    squares = np.einsum('c...,c...->...', parts, parts)
    total: Array32 = squares[..., ::2] + squares[..., 1::2]
    return total
