"""A memory of the keypoints that move with a target, in the target's own coordinates."""

import numpy as np

from vtrack_ros.frame import Array
from vtrack_ros.geometry import affine
from vtrack_ros.replicas.keypoints import Keypoints, nearest, pose_change, PoseChange

#: Number of sightings from which on a keypoint counts as the target's own.
_OWN = 3
#: Number of consecutive frames without a sighting after which a candidate is dropped.
_PATIENCE = 2
#: Most keypoints kept.
_CAPACITY = 400
#: A keypoint's place is a running mean over about this many of its latest sightings.
_MEAN_OF = 30
#: Growth of the uncertainty per frame (with a measured pose, without one); matches have the weight
#: 1 / (1 + uncertainty).
_MEASURED_UNCERTAINTY, _UNMEASURED_UNCERTAINTY = 0.02, 0.5
#: Inlier tolerance of points, as a share of the target's mean side; one pixel at least.
_TOLERANCE = 0.04


class KeypointMemory:
    """
    Remembers where on the target its keypoints are, and what they look like.

    Poses that are measured between consecutive frames accumulate their errors, and a keypoint of
    the background or of an occluder within the box counts as much as one of the target's. Here a
    new keypoint is a candidate at first: it counts as the target's own once it has been seen at
    the same place on the target in several frames (those of the first frame, at once). Keypoints
    of the background behind a moving target fail that. The pose is measured against these places
    on the rectangle of a (width, height) that affine frames map onto the target.

    A place is as uncertain as the poses were when the keypoint was seen there, on average, and a
    pose is as uncertain as the places that it was measured from. In frames without keypoints the
    uncertainty grows, so that keypoints from before such a gap outweigh those from after it.
    """

    def __init__(self, size: tuple[float, float]) -> None:
        self._half = np.array(size) / 2
        self._points = np.zeros((0, 2))
        self._descriptors = np.zeros((0, 128), np.float32)
        #: Of each keypoint: number of sightings, frames since the last one, and uncertainty.
        self._seen_times = np.zeros(0)
        self._unseen = np.zeros(0)
        self._uncertainties = np.zeros(0)
        self._started = False
        self.uncertainty = 0.0

    def measure(self, seen: Keypoints, state: Array,
                rng: np.random.Generator) -> PoseChange | None:
        """Return how the target moved from its affine frame, shape (3, 3); None if unknown."""
        self._seen = seen
        self._which, self._as = nearest(self._descriptors, seen.descriptors)
        own = self._seen_times[self._which] >= _OWN
        which = self._which[own]
        change = pose_change(
            self._points[which] @ state[:2, :2].T + state[:2, 2], seen.points[self._as[own]],
            max(1.0, _TOLERANCE * float(affine.scale(state))), rng,
            1 / (1 + self._uncertainties[which]))
        self._measured = change is not None
        if change is None:
            self.uncertainty += _UNMEASURED_UNCERTAINTY * self._started
        else:
            # weights are 1 / (1 + uncertainty): this is the harmonic mean of 1 + uncertainty
            mean = len(change.weights) / float(change.weights.sum())
            self.uncertainty = _MEASURED_UNCERTAINTY + mean - 1
        return change

    def learn(self, state: Array) -> None:
        """Learn from the keypoints last measured, with the target's affine frame there."""
        inverse = affine.inverse(state)
        seen = self._seen.points @ inverse[:2, :2].T + inverse[:2, 2]
        off = seen[self._as] - self._points[self._which]
        agrees = np.square(off).sum(1) < max(_TOLERANCE, 1 / float(affine.scale(state)))**2
        which, seen_as = self._which[agrees], self._as[agrees]
        self._unseen += 1
        self._unseen[which] = 0
        self._seen_times[which] += 1
        if self._measured:
            # seen elsewhere, it isn't the target's; in the first frame all count as the target's
            self._seen_times[self._which[~agrees]] -= 1
        share = 1 / np.minimum(self._seen_times[which], _MEAN_OF)
        self._points[which] += share[:, None] * off[agrees]
        self._uncertainties[which] += share * (self.uncertainty - self._uncertainties[which])
        self._descriptors[which] = self._seen.descriptors[seen_as]
        # of keypoints that match the same one, the least uncertain is kept
        order = np.lexsort((self._uncertainties[which], seen_as))
        same = np.zeros(len(order), np.bool_)
        same[1:] = np.diff(seen_as[order]) == 0
        gone = np.zeros(len(self._points), np.bool_)
        gone[which[order[same]]] = True
        gone |= (self._unseen >= _PATIENCE) & (self._seen_times < _OWN)
        fresh = (np.abs(seen) < self._half).all(1)
        fresh[seen_as] = False
        count = int(fresh.sum())
        kept = np.flatnonzero(~gone)
        if len(kept) + count > _CAPACITY:
            # the most recently seen ones are kept
            kept = kept[np.argsort(self._unseen[kept], kind='stable')[:_CAPACITY - count]]
        self._points = np.concatenate([self._points[kept], seen[fresh]])
        self._descriptors = np.concatenate(
            [self._descriptors[kept], self._seen.descriptors[fresh]])
        self._seen_times = np.concatenate(
            [self._seen_times[kept], np.full(count, 1 if self._started else _OWN)])
        self._unseen = np.concatenate([self._unseen[kept], np.zeros(count)])
        self._uncertainties = np.concatenate(
            [self._uncertainties[kept], np.full(count, self.uncertainty)])
        self._started = True
