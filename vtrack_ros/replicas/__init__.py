"""
The four papers' methods and the baselines they compare with, on the papers' own cues.

By default each has what was found wrong in print mended; the parameter `as_printed`, where
something had to be mended, has it run to the letter. They're there to put the papers' claims to
the test: for tracking use `vtrack_ros.trackers`.
"""

from vtrack_ros.replicas.affine_filters import (
    AffineKeypointReplica, AffineReplica, SubspaceReplica)
from vtrack_ros.replicas.box_filter import CondensationReplica
from vtrack_ros.replicas.ellipse_tracker import MeanShiftParticleReplica, MeanShiftReplica
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
