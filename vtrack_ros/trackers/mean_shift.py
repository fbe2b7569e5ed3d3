"""Adaptive-bandwidth mean shift with few particles (ABMSPF), and without (ABMS)."""

from __future__ import annotations

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate, Tracker
from vtrack_ros.trackers.mean_shift_colour import ColourMeanShift
from vtrack_ros.trackers.mean_shift_evidence import EvidenceMeanShift
from vtrack_ros.trackers.mean_shift_fusion import Settings

_SHARED = ParameterTable([
    Parameter('preset', 'default', 'What to climb on: the evidence of a discriminative model '
              '(default), or colours as printed (paper); in force at the next start.',
              choices=('default', 'paper')),
    Parameter('rejected', 0.5, 'Likeness r below which the target counts as hidden.', 0.0, 1.0),
    Parameter('growth', 0.1, 'Largest relative change of an axis in one frame (paper preset).',
              0.0, 0.5),
    Parameter('levels', 16, 'Levels of each colour channel (paper preset); in force at the next '
              'start.', choices=(8, 16)),
    Parameter('background', True, 'Whether colours count less that the first surroundings share '
              '(paper preset); in force at the next start.'),
    Parameter('learning', 0.0, 'How fast the colours follow a target that is seen well '
              '(paper preset).', 0.0, 1.0),
])
_PARTICLES = ParameterTable([
    Parameter('particles', 20, 'Number of particles.', 1, 2000),
    Parameter('accepted', 0.8, 'Likeness th from which mean shift is trusted.', 0.0, 1.0),
    Parameter('region', 0.5, 'Reach of the redrawn particles, in semi-axes of the target.',
              0.0, 5.0),
    Parameter('inertia', 0.5, 'Share of the last step that the motion model expects again.',
              0.0, 1.0),
])


class AdaptiveBandwidthMeanShift(Tracker):
    """
    Mean shift with an adaptive bandwidth, the baseline of [Yin2013, sec. 1.1]: no particles.

    It's ABMSPF without them, and without the search near the last place: when it's lost, it
    searches the whole frame for blobs of the target's colours at once (paper preset).
    """

    NAME = 'abms'
    SUMMARY = 'adaptive-bandwidth mean shift (ABMS)'
    PARAMETERS = _SHARED
    _engine: ColourMeanShift | EvidenceMeanShift

    def _configure(self) -> None:
        values = self._parameters
        self._settings = Settings(
            particles=int(values.get('particles', 0)),
            accepted=float(values.get('accepted', 0.8)),
            rejected=float(values['rejected']), region=float(values.get('region', 0.0)),
            inertia=float(values.get('inertia', 0.0)), growth=float(values['growth']),
            levels=int(values['levels']), background=bool(values['background']),
            learning=float(values['learning']))
        if self._frame_shape is not None:
            self._engine.settings = self._settings

    def _start(self, frame: Frame, box: Box) -> Estimate:
        as_printed = self._parameters['preset'] == 'paper'
        kind = ColourMeanShift if as_printed else EvidenceMeanShift
        self._engine = kind(self._rng, self._settings)
        return self._engine.start(frame, box)

    def _update(self, frame: Frame, dt: float) -> Estimate:
        return self._engine.update(frame, dt)


class MeanShiftParticleFilter(AdaptiveBandwidthMeanShift):
    """
    ABMSPF, adaptive-bandwidth mean shift fused with few particles [Yin2013].

    Mean shift gives one place, the best of a few particles another; they are fused by their
    distance and the likeness (eqs 13-15), the particles converge on the result and are redrawn
    about it, and a search in three stages begins where the two contradict each other or nothing is
    like the target. The preset says what is climbed: `ColourMeanShift` and `EvidenceMeanShift`.

    Printed otherwise, and mended: eq. 2's denominator lacks the weights; eq. 10 has `h11 - h12`
    for `h11 - h22`; eq. 11 lets an unchanged target grow by sigma^2 / 4 each time.
    """

    NAME = 'abmspf'
    SUMMARY = 'adaptive-bandwidth mean shift with particles (ABMSPF)'
    PARAMETERS = _SHARED + _PARTICLES
