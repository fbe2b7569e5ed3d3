"""The keypoints of a target, in its own coordinates, that have moved with it so far."""

import numpy as np

from vtrack_ros.frame import Array
from vtrack_ros.geometry import affine
from vtrack_ros.replicas.keypoints import Keypoints, nearest, pose_change, PoseChange

#: Frames that show a keypoint after which it is taken for the target's own.
_OWN = 3
#: Frames for which a candidate is kept that isn't seen.
_PATIENCE = 2
#: Most keypoints kept.
_CAPACITY = 400
#: A keypoint's place is the mean of the latest ones, about this many.
_MEAN_OF = 30
#: What a frame with a measured pose adds to the uncertainty of places, and one without.
_MEASURED_UNCERTAINTY, _UNMEASURED_UNCERTAINTY = 0.02, 0.5
#: Points agree within this share of the target's mean side, and one pixel at least.
_TOLERANCE = 0.04


class KeypointMemory:
    """
    Remembers where on the target its keypoints are, and what they look like.

    Poses that are measured between consecutive frames accumulate their errors, and a keypoint of
    the background or of an occluder within the box is as good as one of the target's. Here a new
    keypoint is a candidate at first: only when it has been seen at the same place of the target in
    several frames does it count as the target's own. Keypoints of what the target moves across
    never do, and the pose is measured against places that stay, on the rectangle of a (width,
    height) that affine frames map onto the target.

    A place is as uncertain as the pose was when the keypoint was first seen there, and a pose is
    as uncertain as the places that it was measured from. Without keypoints the uncertainty grows,
    so that those known before a time without them outvote those that came after it.
    """

    def __init__(self, size: tuple[float, float]) -> None:
        self._half = np.array(size) / 2
        self._points = np.zeros((0, 2))
        self._descriptors = np.zeros((0, 128), np.float32)
        #: Times seen, frames since the last one, and uncertainty.
        self._seen_times = np.zeros(0)
        self._unseen = np.zeros(0)
        self._uncertainties = np.zeros(0)
        self._started = False
        self.uncertainty = 0.0

    def measure(self, seen: Keypoints, state: Array,
                rng: np.random.Generator) -> PoseChange | None:
        """Return how the target moved from where an affine frame, shape (3, 3), has it."""
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
            # weights are 1 / (1 + uncertainty)
            mean = len(change.weights) / float(change.weights.sum())
            self.uncertainty = _MEASURED_UNCERTAINTY + mean - 1
        return change

    def learn(self, state: Array) -> None:
        """Learn which of the frame's keypoints agree with the target's affine frame in it."""
        inverse = affine.inverse(state)
        seen = self._seen.points @ inverse[:2, :2].T + inverse[:2, 2]
        off = seen[self._as] - self._points[self._which]
        agrees = np.square(off).sum(1) < max(_TOLERANCE, 1 / float(affine.scale(state)))**2
        which, seen_as = self._which[agrees], self._as[agrees]
        self._unseen += 1
        self._unseen[which] = 0
        self._seen_times[which] += 1
        if self._measured:
            # what is seen elsewhere isn't the target's: in the first frame all are taken for that
            self._seen_times[self._which[~agrees]] -= 1
        share = 1 / np.minimum(self._seen_times[which], _MEAN_OF)
        self._points[which] += share[:, None] * off[agrees]
        self._uncertainties[which] += share * (self.uncertainty - self._uncertainties[which])
        self._descriptors[which] = self._seen.descriptors[seen_as]
        # of keypoints that have become the same one the least uncertain stays
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
            # those seen lately stay
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
