"""
The four papers' methods and the baselines they compare with, on the papers' own cues.

By default each has the errors found in the papers corrected; the parameter `as_printed`, where
something had to be corrected, runs it exactly as printed. They're for testing the papers' claims:
for tracking use `vtrack_ros.trackers`.
"""

from vtrack_ros.replicas.affine_filters import (
    AffineKeypointReplica, AffineReplica, SubspaceReplica)
from vtrack_ros.replicas.box_filter import CondensationReplica
from vtrack_ros.replicas.ellipse_particles import MeanShiftParticleReplica
from vtrack_ros.replicas.ellipse_tracker import MeanShiftReplica
from vtrack_ros.replicas.grey_filter import GreyReplica
from vtrack_ros.replicas.measured_filters import (
    KalmanReplica, PrunedQuadratureReplica, QuadratureReplica, UnscentedReplica)
from vtrack_ros.tracker import Tracker

#: The replicas: the four papers' methods first, then their baselines.
REPLICAS: tuple[type[Tracker], ...] = (
    GreyReplica,
    PrunedQuadratureReplica,
    MeanShiftParticleReplica,
    AffineKeypointReplica,
    CondensationReplica,
    KalmanReplica,
    UnscentedReplica,
    QuadratureReplica,
    MeanShiftReplica,
    AffineReplica,
    SubspaceReplica,
)

__all__ = ['REPLICAS']
