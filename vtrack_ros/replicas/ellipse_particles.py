"""ABMSPF: mean shift on an ellipse's colours, with a few particles."""

import numpy as np

from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry.ellipse import axes_of_bandwidth, SIGMA
from vtrack_ros.localisation.filter_parameters import MEAN_SHIFT_PARTICLES
from vtrack_ros.localisation.mean_shift import fuse
from vtrack_ros.replicas.ellipse_tracker import as_point, Match, MeanShiftReplica

#: After more frames of search in vain than this the whole frame is searched [Yin2013, step 9].
_LOCAL_FRAMES = 10
#: Number of candidates of a local search.
_CANDIDATES = 20


class MeanShiftParticleReplica(MeanShiftReplica):
    """
    ABMSPF, adaptive-bandwidth mean shift fused with few particles [Yin2013].

    Mean shift gives one place, the best of a few particles another; they are fused by their
    distance and the similarity (eqs 13-15). The particles converge on the result and are redrawn
    about it (sec. 2.2). If the two contradict each other, or neither is similar to the target, a
    search in three stages begins (sec. 2.4): one step ahead, near it, and after more than ten
    frames in vain in the whole frame. While it fails, the particles' mean about the forecast is
    reported: the best one would be the most similar piece of background.

    Otherwise than in the paper, besides what `MeanShiftReplica` says:

    - y_pf is the best particle, however similar; the paper takes it of those above th (sec. 2.2).
    - Below th, the similarity that decides on a search is the best particle's if that's higher;
      in step 7 it's mean shift's.
    - Particles are candidates of the local search too, and what a search finds isn't fused with
      y_pf (step 11).

    `as_printed` undoes these too. Readings: the particles' window is that of the frame before,
    which is the current one until step 12; without a particle above th, y_ms counts from the
    similarity th on, as where the two are apart (eq. 13), and below it nothing does (eq. 14);
    where the fusion after a search gives nothing, the place found counts, since step 11 ends the
    search in any case; A and B of eq. 6, by which step 13 moves the particles, aren't given, and
    `inertia` stands for them; a tenth is added to the weights of eq. 12, which may all be zero.
    """

    NAME = 'abmspf_paper'
    SUMMARY = 'adaptive-bandwidth mean shift with particles (ABMSPF) of Yin et al. 2013'
    PARAMETERS = MeanShiftReplica.PARAMETERS + MEAN_SHIFT_PARTICLES

    def _drawn(self, dt: float) -> Array:
        values = self._parameters
        forecast = self._center + dt * float(values['inertia']) * self._velocity
        uniform = self._rng.uniform(-1.0, 1.0, (int(values['particles']), 2))
        return forecast + float(values['region']) * uniform * self._half_sides

    def _tracked(self, frame: Frame, points: Array) -> Match | None:
        climbed = self._climbed(frame)
        scores = self._score(frame, np.concatenate([climbed[None], points]))
        zeta, scores = float(scores[0]), scores[1:]
        if self._as_printed:
            self._matrix = self._iterated(frame, climbed)
        match = self._fused(Match(climbed, zeta), points, scores)
        if match is None or self._as_printed or zeta >= self._accepted:
            return match
        return Match(match.place, max(zeta, float(scores.max())))

    def _fused(self, found: Match, points: Array, scores: Array) -> Match | None:
        """Fuse mean shift's match with the particles, shape (N, 2), scored (N,) [eqs 13-15]."""
        best = int(scores.argmax())
        if self._as_printed and scores[best] <= self._accepted:
            return found if found.zeta >= self._accepted else None
        far = axes_of_bandwidth(self._bandwidth)[0]
        place = fuse(found.zeta, as_point(found.place), as_point(points[best]), SIGMA, far,
                     self._accepted, self._rejected)
        return None if place is None else Match(np.array(place), found.zeta)

    def _search(self, frame: Frame, dt: float, points: Array) -> tuple[Match | None, Array]:
        match, expected = self._extended_search(frame, dt, points)
        if match is None or not self._as_printed:
            return match, expected
        return self._fused(match, points, self._score(frame, points)) or match, expected

    def _extended_search(self, frame: Frame, dt: float,
                         points: Array) -> tuple[Match | None, Array]:
        self.stage = 'ahead'
        ahead = self._center + dt * self._velocity
        match = self._best_match(frame, ahead[None])
        if match is not None:
            return match, ahead
        self.stage = 'near'
        searched = self._searched_frames
        reach = float(self._parameters['region']) * (1 + 0.2 * min(searched, 2 * _LOCAL_FRAMES))
        spread = self._rng.uniform(-1.0, 1.0, (_CANDIDATES, 2)) * self._half_sides
        candidates = np.concatenate([ahead + reach * spread, points])
        scores = self._score(frame, candidates)
        count = _CANDIDATES if self._as_printed else len(candidates)
        match = self._matched(frame, candidates[:count], scores[:count])
        if match is None and searched > _LOCAL_FRAMES:
            self.stage = 'everywhere'
            match = self._best_match(frame, self._blobs(frame))
        # the particles' mean, weighted with their similarity [Yin2013, eq. 12]; a tenth more, for
        # all may be zero
        weights = scores[_CANDIDATES:] + 0.1
        return match, weights @ points / weights.sum()
