"""
The four papers' methods and the baselines they compare with, on the papers' own cues.

By default each has what was found wrong in print mended; the parameter `as_printed`, where
something had to be mended, has it run to the letter. They're there to put the papers' claims to
the test: for tracking use `vtrack_ros.trackers`.
"""

from vtrack_ros.replicas.affine_filters import (
    AffineKeypointParticleFilter, AffineParticleFilter, SubspaceParticleFilter)
from vtrack_ros.replicas.box_filter import ColourParticleFilter
from vtrack_ros.replicas.ellipse_tracker import AdaptiveBandwidthMeanShift, MeanShiftParticleFilter
from vtrack_ros.replicas.grey_filter import GreyParticleFilter
from vtrack_ros.replicas.measured_filters import (
    KalmanParticleFilter, PrunedQuadratureParticleFilter, QuadratureParticleFilter,
    UnscentedParticleFilter)
from vtrack_ros.tracker import Tracker

#: The replicas: the four papers' methods first, then their baselines.
REPLICAS: tuple[type[Tracker], ...] = (
    GreyParticleFilter,
    PrunedQuadratureParticleFilter,
    MeanShiftParticleFilter,
    AffineKeypointParticleFilter,
    ColourParticleFilter,
    KalmanParticleFilter,
    UnscentedParticleFilter,
    QuadratureParticleFilter,
    AdaptiveBandwidthMeanShift,
    AffineParticleFilter,
    SubspaceParticleFilter,
)

__all__ = ['REPLICAS']
