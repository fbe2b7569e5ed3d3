"""Estimate a target's extent from a point on it: boxes that differ from their surroundings."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.sampling import shrunk
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box

#: Windows about the point: (side, sizes of the candidates in it), in image heights.
_WINDOWS = ((0.12, np.geomspace(0.01, 0.02, 4)[:-1]), (0.35, np.geomspace(0.02, 0.1, 8)[:-1]),
            (1.4, np.geomspace(0.1, 0.55, 9)[:-1]), (2.4, np.geomspace(0.55, 1.0, 4)))
#: Least size of a candidate, [px], or the image height if that is less.
_LEAST_SIZE = 8.0
#: Width over height of the candidates.
_ASPECTS = np.array([0.33, 0.45, 0.62, 0.8, 1.0, 1.25, 1.7, 2.2])
#: Upper bound of a window's sides after downsampling, [px], and number of quantised colours.
_SIDE, _COLOURS = 128, 16
#: Factor on the lightness before colours are quantised; below 1: shadows fall on targets too.
_LIGHTNESS = 0.6
#: Width of the surroundings that a box is compared with in colour, and in texture, in mean sides
#: from its border; half the width of the band along a border where edges count, in sides.
_COLOURS_ABOUT, _TEXTURE_ABOUT, _BAND = 0.2, 0.3, 0.12
#: Weights in a candidate's log score, [1/nat]: colour difference, texture contrast, edges along
#: the border, and log prior.
_COLOUR, _TEXTURE, _BORDER, _PRIOR = 8.0, 3.0, 1.5, 0.5
#: Added to a mean gradient before its logarithm, so that noise doesn't count as texture; in
#: eighths of a grey level.
_LEAST_GRADIENT = 5.0
#: Pseudo-count: number of pixels with the window's mean gradient that are added to those of a box
#: or a band, so that one with few or no pixels of its own has little influence.
_USUAL_PIXELS = 9.0
#: Prior: (mean, standard deviation) of log(size / sqrt(image height)), both in pixels, and of
#: log(aspect). The root, since targets in larger images have more pixels, but a smaller share.
_SIZE, _ASPECT = (np.log(2.7), 0.7), (-0.25, 0.5)
#: Segmentation (GrabCut): margin of the image part about the box, in mean sides; upper bound of
#: its sides after downsampling, [px]; share of the box's sides, about its centre, that is marked
#: as surely target; multiple of the box's sides beyond which all is marked as surely background.
_SEGMENT_MARGIN, _SEGMENT_SIDE, _SURE_SHARE, _SEGMENT_REACH = 0.6, 96, 0.5, 1.6
#: Segmentation: iterations; least side of the image part, [px], whose square is the least number
#: of pixels of either label; share of the segment left out beyond each bound of its box, [%].
_ITERATIONS, _LEAST_SEGMENT_SIDE, _TRIMMED = 3, 8, 1.0
#: Least factor of the area between one extent and the next larger or smaller one.
_STEP = 1.5


def find_extent(frame: Frame, x: float, y: float, least: float = 0.0,
                most: float = math.inf) -> Box:
    """
    Return the box about a point that is most probably the target's extent.

    The candidates are boxes centred at the point, in four windows of the frame. A candidate's
    probability has four factors: the Jensen-Shannon divergence between the colours inside and
    around it; how much more texture is inside than around it; edges along its four sides; and a
    prior of its size and aspect. The result is the candidate with the highest expected overlap
    with the target under these probabilities, not the most probable one: each factor has many
    maxima, at parts of the target and at what the target is a part of. Since a click is seldom at
    the centre, the box is then averaged with that of the target as segmented there.

    The point, (x, y) in pixels, is inside the frame, best at the target's centre; the box's area
    in the frame is from `least` to `most`, [px^2]. ValueError if there's no such extent.
    """
    height, width = frame.shape[:2]
    visible = min(_LEAST_SIZE / height, _WINDOWS[-1][1][-1])
    windows = [(side, sizes[sizes >= visible]) for side, sizes in _WINDOWS]
    rows = [_candidates(frame, x, y, side * height, sizes * height)
            for side, sizes in windows if len(sizes)]
    sizes, scores = (np.concatenate(part) for part in zip(*rows))
    center = np.array([x, y])
    inside = np.minimum(center + sizes / 2, (width, height)) - np.maximum(center - sizes / 2, 0)
    visible_areas = inside.prod(axis=1)
    possible = (visible_areas >= least) & (visible_areas <= most)
    if not possible.any():
        area = f'{least:.0f} px^2 or more' if least else f'{most:.0f} px^2 or less'
        raise ValueError(f'found no extent of {area} about ({x:.0f}, {y:.0f}) in the image of '
                         f'{width} x {height}')
    sizes, scores = sizes[possible], scores[possible]
    probability = np.exp(scores - scores.max())
    shared = np.minimum(sizes[:, None], sizes).prod(axis=2)
    areas = sizes.prod(axis=1)
    overlap = shared / (areas[:, None] + areas - shared)
    w, h = sizes[np.argmax(overlap @ probability)]
    box = Box.from_center(x, y, float(w), float(h))
    box = box.clipped(width, height) or box
    mean = Box(*(box.as_array() + _segmented(frame, box).as_array()) / 2)
    mean = mean.clipped(width, height) or box
    return mean if least <= mean.area <= most else box


def next_extent(frame: Frame, box: Box, larger: bool) -> Box:
    """
    Return the most probable extent about a box's centre that is larger, or smaller, than the box.

    For a click that found a part of the target only, or what the target is a part of. The area
    differs by a factor of at least 1.5; ValueError if there's none; otherwise as `find_extent`.
    """
    height, width = frame.shape[:2]
    x, y = (min(max(place, 0.0), float(side)) for place, side in zip(box.center, (width, height)))
    least, most = (_STEP * box.area, math.inf) if larger else (0.0, box.area / _STEP)
    return find_extent(frame, x, y, least, most)


def _candidates(frame: Frame, x: float, y: float, side: float,
                sizes: Array) -> tuple[Array, Array]:
    """Return a window's candidates, (width, height) [px], shape (n, 2), and their log scores."""
    height, width = frame.shape[:2]
    left, top = int(max(0, x - side / 2)), int(max(0, y - side / 2))
    right, bottom = int(min(width, x + side / 2 + 1)), int(min(height, y + side / 2 + 1))
    window = _reduced(frame[top:bottom, left:right], _SIDE)
    scale = np.array(window.shape[1::-1]) / (right - left, bottom - top)
    size, aspect = (grid.ravel() for grid in np.meshgrid(sizes, _ASPECTS, indexing='ij'))
    candidates = size[:, None] * np.stack([np.sqrt(aspect), 1 / np.sqrt(aspect)], 1)
    center = (np.array([x, y]) - (left, top)) * scale
    boxes = np.concatenate([center - candidates * scale / 2, center + candidates * scale / 2], 1)
    prior = sum(-0.5 * ((np.log(value) - mean) / deviation) ** 2 for value, (mean, deviation) in (
        (size / math.sqrt(height), _SIZE), (aspect, _ASPECT)))
    difference = _COLOUR * _difference_in_colour(window, boxes) + _edges(window, boxes)
    return candidates, _PRIOR * prior + difference


def _reduced(window: Frame, side: int) -> Frame:
    """Return a window in colour, downsampled to at most `side` pixels a side."""
    window = shrunk(window, side)
    if window.ndim == 2:
        window = np.asarray(cv2.cvtColor(window, cv2.COLOR_GRAY2BGR), np.uint8)
    return window


def _difference_in_colour(window: Frame, boxes: Array) -> Array:
    """Return the divergence between the colours inside boxes and around them, in nats."""
    table = _summed(_colours(window)[..., None] == np.arange(_COLOURS))
    inside = _sums(table, boxes)
    about = _sums(table, _grown(boxes, _COLOURS_ABOUT)) - inside
    return _divergence(_shares(inside), _shares(about))


def _edges(window: Frame, boxes: Array) -> Array:
    """Return the boxes' log scores by texture contrast and by edges along their borders."""
    grey = cv2.cvtColor(window, cv2.COLOR_BGR2GRAY).astype(np.float32)
    across, down = (np.abs(cv2.Sobel(grey, cv2.CV_32F, *order)) for order in ((1, 0), (0, 1)))
    # gradient magnitude, horizontal and vertical gradient and, last, number of pixels
    kinds = np.stack([np.hypot(across, down), across, down, np.ones_like(grey)], axis=-1)
    table = _summed(kinds)

    usual = table[-1, -1] / table[-1, -1, 3]

    def strength(sums: Array, kind: int) -> Array:
        mean = (sums[:, kind] + _USUAL_PIXELS * usual[kind]) / (sums[:, 3] + _USUAL_PIXELS)
        return np.asarray(np.log(mean + _LEAST_GRADIENT))
    inside = _sums(table, boxes)
    about = _sums(table, _grown(boxes, _TEXTURE_ABOUT)) - inside
    # less texture inside than around isn't penalised: a target may be of one colour
    texture = np.maximum(strength(inside, 0) - strength(about, 0), 0)
    (x0, y0, x1, y1), (x, y) = boxes.T, _BAND * (boxes[:, 2:] - boxes[:, :2]).T
    bands = ((1, (x0 - x, y0, x0 + x, y1)), (1, (x1 - x, y0, x1 + x, y1)),
             (2, (x0, y0 - y, x1, y0 + y)), (2, (x0, y1 - y, x1, y1 + y)))
    border = sum(strength(_sums(table, np.stack(band, 1)), kind) for kind, band in bands) / 4
    return np.asarray(_TEXTURE * texture + _BORDER * border)


def _colours(window: Frame) -> NDArray[np.int32]:
    """Return each pixel's label after quantising a window's colours by k-means."""
    lab = cv2.cvtColor(window, cv2.COLOR_BGR2LAB).astype(np.float32)
    lab[..., 0] *= _LIGHTNESS
    pixels = cv2.GaussianBlur(lab, (0, 0), 0.7).reshape(-1, 3)
    # The initial clusters are quantiles of the lightness: no random numbers are needed.
    ranks = np.empty(len(pixels), np.int32)
    ranks[np.argsort(pixels[:, 0], kind='stable')] = np.arange(len(pixels))
    labels = (ranks * _COLOURS // len(pixels)).astype(np.int32)[:, None]
    if len(pixels) > _COLOURS:
        criteria = (cv2.TERM_CRITERIA_MAX_ITER, 8, 0.0)
        _, labels, _ = cv2.kmeans(
            pixels, _COLOURS, labels, criteria, 1, cv2.KMEANS_USE_INITIAL_LABELS)
    return np.asarray(labels, np.int32).reshape(lab.shape[:2])


def _segmented(frame: Frame, box: Box) -> Box:
    """
    Return the bounds of the target as GrabCut segments it about a box [Rother et al. 2004].

    The box itself is returned if the image part or the pixels of either label are too few.
    """
    x, y, width, height = box.as_array()
    about = _SEGMENT_MARGIN * math.sqrt(box.area)
    left, top = int(max(0, x - about)), int(max(0, y - about))
    part = frame[top:int(y + height + about), left:int(x + width + about)]
    rows, columns = part.shape[:2]
    if min(rows, columns) < _LEAST_SEGMENT_SIDE:
        return box
    part = _reduced(part, _SEGMENT_SIDE)
    scale = np.array(part.shape[1::-1]) / (columns, rows)
    middle, half = (np.array(box.center) - (left, top)) * scale, scale * (width, height) / 2
    mask = np.full(part.shape[:2], cv2.GC_BGD, np.uint8)
    for reach, label in ((_SEGMENT_REACH, cv2.GC_PR_BGD), (1.0, cv2.GC_PR_FGD),
                         (_SURE_SHARE, cv2.GC_FGD)):
        (x0, y0), (x1, y1) = (np.maximum(corner, 0).astype(int) for corner in (
            middle - reach * half, middle + reach * half + 1))
        mask[y0:y1, x0:x1] = label
    # the target's labels, sure and probable, are the odd numbers
    if min(np.bincount(mask.ravel() & 1, minlength=2)) < _LEAST_SEGMENT_SIDE**2:
        return box
    # a fixed seed, so that the result is reproducible
    cv2.setRNGSeed(0)
    nothing = np.zeros((1, 65))
    cv2.grabCut(part, mask, None, nothing, nothing.copy(), _ITERATIONS, cv2.GC_INIT_WITH_MASK)
    _, pieces = cv2.connectedComponents(mask & 1)
    column, row = middle.astype(int)
    places = np.stack(np.nonzero(pieces == pieces[row, column]))[::-1]
    low, high = np.percentile(places, (_TRIMMED, 100 - _TRIMMED), axis=1)
    return Box(*((left, top) + low / scale), *((high - low + 1) / scale))


def _grown(boxes: Array, share: float) -> Array:
    """Return boxes extended in each direction by a share of their mean side."""
    more = share * np.sqrt((boxes[:, 2:] - boxes[:, :2]).prod(axis=1, keepdims=True))
    return np.concatenate([boxes[:, :2] - more, boxes[:, 2:] + more], axis=1)


def _summed(values: Array) -> Array:
    """Return the summed-area table of values, shape (rows, columns, kinds)."""
    table = np.zeros((values.shape[0] + 1, values.shape[1] + 1, values.shape[2]))
    table[1:, 1:] = values.cumsum(0).cumsum(1)
    return table


def _sums(table: Array, boxes: Array) -> Array:
    """Return the sums over boxes (x0, y0, x1, y1), clipped to the image, from its table."""
    limit = np.array(table.shape[1::-1]) - 1
    (x0, y0), (x1, y1) = (np.clip(np.round(corner), 0, limit).astype(int).T
                          for corner in (boxes[:, :2], boxes[:, 2:]))
    return np.asarray(table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0])


def _shares(counts: Array) -> Array:
    """Return the colours' shares, smoothed by a pseudo-count so that none is 0."""
    return np.asarray((counts + 0.5 / _COLOURS) / (counts.sum(axis=1, keepdims=True) + 0.5))


def _divergence(p: Array, q: Array) -> Array:
    """Return the Jensen-Shannon divergence of distributions, shape (n, colours), in nats."""
    mean = (p + q) / 2
    return np.asarray((p * np.log(p / mean) + q * np.log(q / mean)).sum(axis=1) / 2)
