"""Colour histograms on ellipses: similarity, mean shift, and the bandwidth matrix."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.histogram import joint_bins
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry.ellipse import SIGMA, square_root

Bins = NDArray[np.intp]

#: Sample points along the ellipse's diameter, whatever its size in pixels.
_GRID = 24
#: Factor by which the ellipse is enlarged to measure the bandwidth, or growth couldn't be seen.
_REACH = 1.4
#: The surroundings lie between these multiples of the ellipse.
_NEAR, _FAR = 1.3, 2.2
#: Bins of a grey frame's intensity.
_GREY_LEVELS = 32
#: Lower bound of the density p in a colour's weight sqrt(q / p); also added to the denominator of
#: a pixel's likelihood ratio.
_FLOOR = 1e-3
#: Tolerance of mean shift: it stops after a step shorter than this share of the semi-axis.
_STILL = 0.006


def _disc(grid: int, radius: float) -> Array:
    """Return the points of a grid within a radius, from the centre outwards: shape (M, 2)."""
    half = int(np.ceil(grid * radius / 2))
    axis = (np.arange(-half, half) + 0.5) * 2 / grid
    points = np.stack([plane.ravel() for plane in np.meshgrid(axis, axis)], 1)
    distance = np.hypot(points[:, 0], points[:, 1])
    points = points[np.argsort(distance, kind='stable')]
    return points[:np.count_nonzero(distance <= radius)]


_REGION = _disc(_GRID, _REACH)
_INSIDE = int(np.count_nonzero(np.hypot(_REGION[:, 0], _REGION[:, 1]) <= 1))
_ELLIPSE = _REGION[:_INSIDE]
_KERNEL = np.exp(-0.5 * SIGMA**2 * (_ELLIPSE**2).sum(1))
_KERNEL /= _KERNEL.sum()
_SURROUNDINGS = _disc(_GRID // 2, _FAR)
_SURROUNDINGS = _SURROUNDINGS[np.hypot(_SURROUNDINGS[:, 0], _SURROUNDINGS[:, 1]) > _NEAR]
#: Mean of u u^T over the points of the unit disc: sigma^2 / 4 of [Yin2013, eq. 11] in these units.
_UNIFORM = np.eye(2) * float((_ELLIPSE**2).mean())


@dataclass(frozen=True)
class EllipseColours:
    """
    The colours of a target that an ellipse surrounds.

    An ellipse is a centre and a frame: the matrix B, shape (2, 2) in pixels, that maps the unit
    disc onto the ellipse, so that the bandwidth matrix is `B B^T / sigma^2` [Yin2013, eq. 8]. It
    is sampled on a fixed grid of the disc, so that the cost doesn't depend on its size, and the
    Gaussian kernel's values are constants. Points outside the image have no colour.

    If it's `weighted`, colours that also occur in the first surroundings are weighted down, by
    their likelihood ratio `q / (q + background)`, in target and candidates alike, in the manner of
    the background-weighted histogram of Comaniciu et al. (2003). The paper has no such weights.

    The histogram is the colours' kernel density [Yin2013, eq. 1], `background` their frequency
    about the target, shape (colours,) both. `bins` gives a colour's index in `density`, shape
    (n + 1,), the weighted density `q` of the target's own n colours; the last entry, for all other
    colours, is 0. A candidate's density is multiplied by `share`. `moment`, shape (2, 2), is the
    inverse root of the second moment of the target's weights, in units of its frame.
    """

    histogram: Array
    background: Array
    weighted: bool
    bins: Bins
    density: Array
    share: Array
    moment: Array

    @classmethod
    def create(cls, frame: Frame, center: Array, matrix: Array, levels: int = 16,
               weighted: bool = True) -> EllipseColours:
        """
        Learn the colours of the target in an ellipse, (2,) and (2, 2), [px].

        `levels` is the number of levels of each channel, a power of 2 (a grey frame has 32);
        `weighted` is whether colours that the surroundings share are weighted down.
        """
        count = levels**3 if frame.ndim == 3 else _GREY_LEVELS
        inside = _colours(frame, *_spread(center, matrix, _ELLIPSE), levels)
        histogram = np.bincount(inside, _KERNEL, count + 1)[:count]
        around = _colours(frame, *_spread(center, matrix, _SURROUNDINGS), levels)
        background = np.bincount(around, None, count + 1)[:count].astype(np.float64)
        background /= max(background.sum(), 1.0)
        empty = np.zeros(0)
        model = cls(histogram, background, weighted, empty.astype(np.intp), empty, empty,
                    np.eye(2))._indexed()
        return replace(model, moment=np.linalg.inv(square_root(model._moment(
            frame, center, matrix, _REGION))))

    def updated(self, frame: Frame, center: Array, matrix: Array, rate: float) -> EllipseColours:
        """Return the model after an update of the histogram with that learning rate."""
        count = len(self.histogram)
        inside = _colours(frame, *_spread(center, matrix, _ELLIPSE), self._levels)
        seen = np.bincount(inside, _KERNEL, count + 1)[:count]
        return replace(self, histogram=self.histogram + rate * (seen - self.histogram))._indexed()

    def coefficients(self, frame: Frame, centers: Array, matrix: Array) -> Array:
        """Return the candidates' Bhattacharyya coefficients, shape (N,) [Yin2013, eq. 5]."""
        # x and y are separate arrays: sums over a last axis of two take five times as long
        (x, y), (columns, rows) = centers.T, _spread(np.zeros(2), matrix, _ELLIPSE)
        found = self._found(frame, x[:, None] + columns, y[:, None] + rows)
        count, size = len(centers), len(self.density)
        found += size * np.arange(count)[:, None]
        density = np.bincount(
            found.ravel(), np.broadcast_to(_KERNEL, found.shape).ravel(), count * size)
        density = density.reshape(count, size) * self.share
        # only sums above 1 are normalised: a candidate with background colours stays below 1
        total = np.maximum(density.sum(1), 1.0)
        return np.minimum(np.sqrt(density) @ np.sqrt(self.density) / np.sqrt(total), 1.0)

    def climb(self, frame: Frame, center: Array, matrix: Array, steps: int = 10) -> Array:
        """
        Return the nearest maximum of similarity, found by mean shift [Yin2013, eqs 2-3].

        A step goes to the mean of the sample points, weighted with kernel and `sqrt(q / p)`; as
        printed the denominator lacks the weights and has a factor `s` too many.
        """
        columns, rows = _spread(np.zeros(2), matrix, _ELLIPSE)
        tolerance = _STILL * np.abs(matrix).max()
        for _ in range(steps):
            found = self._found(frame, center[0] + columns, center[1] + rows)
            weights = self._weights(found)[found] * _KERNEL
            total = weights.sum()
            if total <= 1e-9:
                break
            step = np.array([columns @ weights, rows @ weights]) / total
            center = center + step
            if np.abs(step).max() < tolerance:
                break
        return center

    def growth(self, frame: Frame, center: Array, matrix: Array) -> Array:
        """
        Return the matrix A by which the target's form changed: its frame is `B A` now.

        The second moment of the weights [Yin2013, eq. 11], here over an ellipse 1.4 times as
        large, relative to what it was at the start: for a target of colours that the background
        lacks, the printed moment times `4 / sigma^2`. A is symmetric, and the identity where
        nothing changed.
        """
        moment = self._moment(frame, center, matrix, _REGION)
        return square_root(self.moment @ moment @ self.moment)

    def printed_growth(self, frame: Frame, center: Array, matrix: Array) -> Array:
        """
        Return the matrix A by which [Yin2013, eq. 11], as printed, changes the form.

        The new bandwidth matrix is the second moment of the weights over the ellipse. A target of
        colours that the background lacks ends in an ellipse 1.25 times as large as itself; one
        that shares its colours with the background grows by that factor each time.
        """
        return SIGMA * square_root(self._moment(frame, center, matrix, _ELLIPSE))

    @property
    def separation(self) -> float:
        """Dissimilarity of target and surroundings, in [0, 1]: 1 where they share no colour."""
        return 1.0 - float(np.sqrt(self.histogram * self.background).sum())

    def likelihood(self, pixels: Frame) -> Array:
        """Return the likelihood ratio `q / (q + background)` of pixels' colours, in [0, 1]."""
        ratio = self.histogram / (self.histogram + self.background + _FLOOR)
        levels = self._levels if pixels.ndim == 3 else _GREY_LEVELS
        return ratio.take(joint_bins(cv2.split(pixels), levels))

    @property
    def _levels(self) -> int:
        return int(round(len(self.histogram) ** (1 / 3)))

    def _indexed(self) -> EllipseColours:
        """Return the model with `bins`, `density` and `share` derived from the histograms."""
        own = self.histogram > 1e-4
        if not own.any():
            own = self.histogram >= self.histogram.max()
        bins = np.full(len(own) + 1, np.count_nonzero(own), np.intp)
        bins[:-1][own] = np.arange(np.count_nonzero(own))
        density = self.histogram[own]
        share = np.ones(len(density))
        if self.weighted:
            share = density / np.maximum(density + self.background[own], 1e-9)
        total = max(float(density @ share), 1e-9)
        return replace(self, bins=bins, density=np.append(density * share / total, 0.0),
                       share=np.append(share / total, 0.0))

    def _weights(self, found: Bins) -> Array:
        """Return each bin's weight sqrt(q / p) for a candidate [Yin2013, eq. 3]."""
        density = np.bincount(found, _KERNEL, len(self.density)) * self.share
        ratio = np.sqrt(self.density / np.maximum(density, _FLOOR))
        # colours shared with the background get less weight here, too
        return ratio * self.share / max(float(self.share.max()), 1e-9)

    def _moment(self, frame: Frame, center: Array, matrix: Array, points: Array) -> Array:
        """Return the weights' second moment over points of the disc, sorted by their radius."""
        found = self._found(frame, *_spread(center, matrix, points))
        weights = self._weights(found[:_INSIDE])[found]
        total = weights.sum()
        if total <= 1e-9:
            return _UNIFORM.copy()
        result: Array = (points * weights[:, None]).T @ points / total
        # invertible even if all weight is on a line or a point
        return result + 1e-4 * np.eye(2)

    def _found(self, frame: Frame, x: Array, y: Array) -> Bins:
        return self.bins.take(_colours(frame, x, y, self._levels))


def _spread(center: Array, matrix: Array, points: Array) -> tuple[Array, Array]:
    """Return x and y of an ellipse's points, shape (M,) each, for points of the disc."""
    x, y = center[:, None] + matrix @ points.T
    return x, y


def _colours(frame: Frame, x: Array, y: Array, levels: int) -> Bins:
    """Return the colours' bins at points; outside the frame, the number of colours."""
    height, width = frame.shape[:2]
    beyond = x.min() < 0 or y.min() < 0 or x.max() >= width or y.max() >= height
    index = y.astype(np.intp) * width + x.astype(np.intp)
    if beyond:
        outside = (x < 0) | (y < 0) | (x >= width) | (y >= height)
        index[outside] = 0
    channels = frame.size // (height * width)
    flat, first = frame.ravel(), index * channels
    colours = joint_bins(
        [flat.take(first + channel) for channel in range(channels)],
        levels if frame.ndim == 3 else _GREY_LEVELS)
    if beyond:
        colours[outside] = levels**3 if frame.ndim == 3 else _GREY_LEVELS
    return colours
