"""How large the thing about a point is: the boxes whose colours differ from their surroundings."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box

#: The windows that are looked at: their side, and the sizes sought there, in image heights.
_WINDOWS = ((0.35, np.geomspace(0.02, 0.1, 8)[:-1]), (1.4, np.geomspace(0.1, 0.55, 9)))
#: Width over height of the candidates.
_ASPECTS = np.array([0.33, 0.45, 0.62, 0.8, 1.0, 1.25, 1.7, 2.2])
#: A window is reduced to so many pixels a side, and to so many colours.
_SIDE, _COLOURS = 128, 16
#: Lightness counts for less than colour: shadows fall on targets too.
_LIGHTNESS = 0.6
#: Side of a candidate with its surroundings, in sides of it (of its mean side).
_SURROUNDINGS = 2.0
#: What a nat of contrast counts, and one of the prior.
_CONTRAST, _PRIOR = 5.0, 0.3
#: Mean and standard deviation of the logarithms of size, in image heights, and aspect.
_SIZE, _ASPECT = (np.log(0.18), 0.7), (-0.25, 0.5)


def find_extent(frame: Frame, x: float, y: float) -> Box:
    """
    Return the box about a point that is most probably the target's extent.

    The candidates are boxes centred at the point, in two windows of the frame. Each is as probable
    as its prior says, of sizes and aspects that targets have, and the Jensen-Shannon divergence
    of the colours inside it from those about it. The answer is the candidate with the highest
    expected overlap with the target under these probabilities, not the likeliest one: the contrast
    has many maxima, at parts of the target and at what it's a part of.

    Parameters
    ----------
    frame : ndarray of uint8, shape (H, W, 3) in BGR order or (H, W)
        The image.
    x, y : float, [px]
        The point, inside the frame; best at the target's centre.

    """
    height, width = frame.shape[:2]
    rows = [_candidates(frame, x, y, side * height, sizes * height) for side, sizes in _WINDOWS]
    sizes, scores = (np.concatenate(part) for part in zip(*rows))
    probability = np.exp(scores - scores.max())
    least = np.minimum(sizes[:, None], sizes).prod(axis=2)
    area = sizes.prod(axis=1)
    overlap = least / (area[:, None] + area - least)
    w, h = sizes[np.argmax(overlap @ probability)]
    box = Box.from_center(x, y, float(w), float(h))
    return box.clipped(width, height) or box


def _candidates(frame: Frame, x: float, y: float, side: float,
                sizes: Array) -> tuple[Array, Array]:
    """Return widths and heights [px], shape (n, 2), in a window about a point, and log scores."""
    height, width = frame.shape[:2]
    left, top = int(max(0, x - side / 2)), int(max(0, y - side / 2))
    right, bottom = int(min(width, x + side / 2 + 1)), int(min(height, y + side / 2 + 1))
    window = frame[top:bottom, left:right]
    # no side of it is reduced to nothing
    reduced = min(1.0, max(_SIDE / max(window.shape[:2]), 1 / min(window.shape[:2])))
    colours = _colours(window, reduced)
    scale = np.array(colours.shape[::-1]) / (right - left, bottom - top)
    counts = np.zeros((colours.shape[0] + 1, colours.shape[1] + 1, _COLOURS))
    counts[1:, 1:] = (colours[..., None] == np.arange(_COLOURS)).cumsum(0).cumsum(1)

    size, aspect = (grid.ravel() for grid in np.meshgrid(sizes, _ASPECTS, indexing='ij'))
    candidates = size[:, None] * np.stack([np.sqrt(aspect), 1 / np.sqrt(aspect)], 1)
    center = (np.array([x, y]) - (left, top)) * scale
    inside = _counted(counts, center, candidates * scale)
    larger = (candidates + (_SURROUNDINGS - 1) * size[:, None]) * scale
    about = _counted(counts, center, larger) - inside
    contrast = _divergence(_shares(inside), _shares(about))
    prior = sum(-0.5 * ((np.log(value) - mean) / deviation) ** 2 for value, (mean, deviation) in (
        (size / height, _SIZE), (aspect, _ASPECT)))
    return candidates, _CONTRAST * contrast + _PRIOR * prior


def _colours(window: Frame, reduced: float) -> NDArray[np.int32]:
    """Return which of its few colours each pixel of a reduced window has."""
    if reduced < 1:
        window = np.asarray(cv2.resize(window, None, fx=reduced, fy=reduced,
                                       interpolation=cv2.INTER_AREA), np.uint8)
    if window.ndim == 2:
        window = np.asarray(cv2.cvtColor(window, cv2.COLOR_GRAY2BGR), np.uint8)
    lab = cv2.cvtColor(window, cv2.COLOR_BGR2LAB).astype(np.float32)
    lab[..., 0] *= _LIGHTNESS
    pixels = cv2.GaussianBlur(lab, (0, 0), 0.7).reshape(-1, 3)
    # Begun from the lightness, the clusters need no random numbers.
    ranks = np.empty(len(pixels), np.int32)
    ranks[np.argsort(pixels[:, 0], kind='stable')] = np.arange(len(pixels))
    labels = (ranks * _COLOURS // len(pixels)).astype(np.int32)[:, None]
    if len(pixels) > _COLOURS:
        criteria = (cv2.TERM_CRITERIA_MAX_ITER, 8, 0.0)
        _, labels, _ = cv2.kmeans(
            pixels, _COLOURS, labels, criteria, 1, cv2.KMEANS_USE_INITIAL_LABELS)
    return np.asarray(labels, np.int32).reshape(lab.shape[:2])


def _counted(counts: Array, center: Array, sizes: Array) -> Array:
    """Return how many pixels of each colour are in boxes about a point, of a summed-area table."""
    limit = np.array(counts.shape[1::-1]) - 1
    x0, y0 = np.clip(np.round(center - sizes / 2), 0, limit).astype(int).T
    x1, y1 = np.clip(np.round(center + sizes / 2), 0, limit).astype(int).T
    return np.asarray(counts[y1, x1] - counts[y0, x1] - counts[y1, x0] + counts[y0, x0])


def _shares(counts: Array) -> Array:
    """Return the colours' shares, even the rarest of which is possible."""
    return np.asarray((counts + 0.5 / _COLOURS) / (counts.sum(axis=1, keepdims=True) + 0.5))


def _divergence(p: Array, q: Array) -> Array:
    """Return the Jensen-Shannon divergence of distributions, shape (n, colours), in nats."""
    mean = (p + q) / 2
    return np.asarray((p * np.log(p / mean) + q * np.log(q / mean)).sum(axis=1) / 2)
