"""The movement of a target between two frames, from keypoints matched between them."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.sampling import PixelWindow
from vtrack_ros.frame import Array, Array32, Frame, Point
from vtrack_ros.geometry import affine

#: Largest mean side of the window that keypoints are detected in, and of the target, in samples.
_RESOLUTION, _TARGET = 80, 50
#: Smallest and largest side of the window, in samples: of a thin one there are no more in all.
_SHORTEST, _LONGEST = 8, _RESOLUTION**2 // 8
#: Largest number of keypoints in a window.
_KEYPOINTS = 80
#: Ratio test: upper bound of a match's descriptor distance to the second nearest's [Lowe 2004].
_RATIO = 0.8
#: Known descriptors up to this factor farther than the nearest one are views of the same keypoint.
_SAME = 1.25
#: Number of RANSAC's hypotheses.
_TRIALS = 100
#: Fewest inliers, and the fewest as a share of all matches.
_FEWEST = 4
_FEWEST_SHARE = 0.3
#: Largest allowed change of the logarithm of the scale, and largest rotation, [rad].
_LARGEST_GROWTH, _LARGEST_TURN = 1.0, 1.6
#: The same, but above either of these a pose needs more inliers; and their fewest.
_LARGE_GROWTH, _LARGE_TURN = 0.25, 0.5
_FEWEST_IF_LARGE = 6


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of one frame: points (M, 2), [px], and descriptors (M, 128)."""

    points: Array
    descriptors: Array32


@dataclass(frozen=True)
class PoseChange:
    """
    The rotation, change of scale and translation between two frames, shape (3, 3), in pixels.

    With the inliers among the matched points, shape (M, 2), and their weights, shape (M,).
    """

    matrix: Array
    before: Array
    after: Array
    weights: Array


def detected(frame: Frame, center: Point, target: Point, reach: float = 1.0) -> Keypoints:
    """Return SIFT keypoints [Lowe 2004] of a window `reach` times as large as a target, [px]."""
    size = reach * target[0], reach * target[1]
    side = min(_RESOLUTION, reach * _TARGET)
    shrink = min(1.0, side / float(np.sqrt(size[0] * size[1])))
    columns, rows = (min(max(_SHORTEST, round(length * shrink)), _LONGEST) for length in size)
    whole = PixelWindow.about(center, size)
    window = whole.sampled(frame, rows, columns)
    if window.ndim == 3:
        window = cv2.cvtColor(window, cv2.COLOR_BGR2GRAY)
    sift = cv2.SIFT.create(nfeatures=_KEYPOINTS, contrastThreshold=0.02)
    found, descriptors = sift.detectAndCompute(window, None)
    if descriptors is None:
        return Keypoints(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    pixels = np.array([keypoint.pt for keypoint in found])
    offset = (pixels + 0.5) / (columns, rows) - 0.5
    return Keypoints(whole.center + offset * (whole.width, whole.height), descriptors)


def nearest(known: Array32, seen: Array32) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """
    Match known descriptors (M, d) with seen ones (N, d); return the matches' rows in both.

    A match has to pass Lowe's ratio test. Several known descriptors may match the same seen one if
    they're about equally near to it: then they are views of the same keypoint.
    """
    if not len(known) or len(seen) < 2:
        none = np.zeros(0, np.intp)
        return none, none
    squares = np.square(known).sum(1)[:, None] + np.square(seen).sum(1) - 2 * known @ seen.T
    order = np.argpartition(squares, 1, axis=1)[:, :2]
    best, second = np.take_along_axis(squares, order, 1).T
    swapped = best > second
    found = np.where(swapped, order[:, 1], order[:, 0])
    best, second = np.minimum(best, second), np.maximum(best, second)
    limit = _SAME**2 * np.maximum(squares.min(0), 0)
    good = np.flatnonzero((best <= limit[found]) & (best < _RATIO**2 * second))
    return good, found[good]


def pose_change(before: Array, after: Array, tolerance: float, rng: np.random.Generator,
                weights: Array | None = None) -> PoseChange | None:
    """
    Return the pose change of the largest consensus of matches; None if that is too small.

    RANSAC over pairs of matches [Fischler and Bolles 1981], then least squares over the inliers
    within a tolerance, [px]: rotation by the Sylvester equation, translation by [Xiang, eq. 4].
    """
    count = len(before)
    if count < _FEWEST:
        return None
    if weights is None:
        weights = np.ones(count)
    # a similarity is a complex linear function z' = a z + b
    source, target = before @ (1, 1j), after @ (1, 1j)
    first = rng.integers(0, count, _TRIALS)
    second = (first + rng.integers(1, count, _TRIALS)) % count
    base = source[second] - source[first]
    usable = np.abs(base) > tolerance
    turn = (target[second] - target[first])[usable] / base[usable]
    likely = (np.abs(np.log(np.maximum(np.abs(turn), 1e-9))) < _LARGEST_GROWTH) & (
        np.abs(np.angle(turn)) < _LARGEST_TURN)
    turn, first = turn[likely], first[usable][likely]
    shift = target[first] - turn * source[first]
    if not len(turn):
        return None
    agrees = np.abs(turn[:, None] * source + shift[:, None] - target) < tolerance
    inliers = agrees[int((agrees @ weights).argmax())]
    for _ in range(2):
        if inliers.sum() < max(_FEWEST, _FEWEST_SHARE * count):
            return None
        matrix = similarity(before[inliers], after[inliers], weights[inliers])
        errors = np.linalg.norm(before @ matrix[:2, :2].T + matrix[:2, 2] - after, axis=1)
        inliers = errors < tolerance
    if inliers.sum() < max(_FEWEST, _FEWEST_SHARE * count):
        return None
    large = (abs(np.log(float(affine.scale(matrix)))) > _LARGE_GROWTH
             or abs(float(affine.angle(matrix))) > _LARGE_TURN)
    if large and inliers.sum() < _FEWEST_IF_LARGE:
        return None
    return PoseChange(matrix, before[inliers], after[inliers], weights[inliers])


def similarity(before: Array, after: Array, weights: Array | None = None) -> Array:
    """
    Return the least squares rotation, scale and translation between matched points, weighted.

    The paper's R is a pure rotation, but its own targets come nearer: the ratio of the spreads
    [Horn 1987, sec. 2.E] is taken out first and multiplied in again. Shape (3, 3):
    p' = s R p + l with l = mean(p') - s R mean(p) [Xiang, eq. 4].
    """
    share = np.ones(len(before)) if weights is None else weights
    share = share / share.sum()
    mean_before, mean_after = share @ before, share @ after
    root = np.sqrt(share)[:, None]
    centred, target = root * (before - mean_before), root * (after - mean_after)
    spread = max(float(np.square(centred).sum()), 1e-12)
    ratio = float(np.sqrt(max(float(np.square(target).sum()), 1e-12) / spread))
    result = np.eye(3)
    result[:2, :2] = ratio * sylvester_rotation(centred, target / ratio)
    result[:2, 2] = mean_after - result[:2, :2] @ mean_before
    return result


def sylvester_rotation(before: Array, after: Array) -> Array:
    """
    Return the rotation R, shape (2, 2), that minimises sum ||R p - p'||^2 over centred points.

    With a symmetric multiplier L of the constraint R^T R = I, linearised at a rotation R0 as
    R0^T R + R^T R0 = 2 I, the normal equations are R P = M - R0 L, where P = sum p p^T and
    M = sum p' p^T. Eliminating R leaves the Sylvester equation

        P^-1 L + L P^-1 = R0^T M P^-1 + P^-1 M^T R0 - 2 I.

    Its solution updates R0; at the fixed point R is the least squares rotation. [Xiang,
    eqs 2-3; the printed formulas are lost, this is the derivation that the text describes.]
    """
    scatter, cross = before.T @ before, after.T @ before
    # points on a line leave P singular; a little isotropic scatter changes no rotation
    scatter = scatter + 1e-9 * max(float(np.trace(scatter)), 1e-12) * np.eye(2)
    # in the eigenvectors of P the equation is diagonal
    values, vectors = np.linalg.eigh(scatter)
    precision = vectors / values @ vectors.T
    sums = 1 / values[:, None] + 1 / values
    rotation = np.eye(2)
    for _ in range(30):
        product = rotation.T @ cross @ precision
        right = product + product.T - 2 * np.eye(2)
        multiplier = vectors @ (vectors.T @ right @ vectors / sums) @ vectors.T
        linear = (cross - rotation @ multiplier) @ precision
        turn = np.arctan2(linear[1, 0] - linear[0, 1], linear[0, 0] + linear[1, 1])
        before_turn = np.arctan2(rotation[1, 0], rotation[0, 0])
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        if abs(turn - before_turn) < 1e-10:
            break
    return rotation


def keypoint_error(states: Array, before: Array, change: PoseChange) -> Array:
    """
    Return the error of the matches if the target moved into each of the affine frames.

    It's the weighted mean of the squared distances, [px^2], shape (N,) [Xiang, sec. 3.3.3; the
    text has a sum, with which the term's weight would depend on the number of keypoints].
    """
    moves = states @ affine.inverse(before)
    # the mean of |A u - w|^2 over points u = (x, y, 1) and their matches w, from the moments
    points = np.column_stack([change.before, np.ones(len(change.before))])
    shares = change.weights / change.weights.sum()
    scatter, cross = (points.T * shares) @ points, (change.after.T * shares) @ points
    rows = moves[:, :2]
    result: Array = (np.einsum('nij,jk,nik->n', rows, scatter, rows)
                     - 2 * np.einsum('nij,ij->n', rows, cross)
                     + shares @ np.square(change.after).sum(1))
    return np.maximum(result, 0.0)
