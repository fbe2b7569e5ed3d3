"""Bayesian filters on any state-space model; they know no pixels and no ROS."""

from vtrack_ros.estimation.belief import Belief
from vtrack_ros.estimation.gaussian import Gaussian, GaussianNoise
from vtrack_ros.estimation.linear_models import (
    ConstantVelocity, FirstOrderAutoregressive, SecondOrderAutoregressive)
from vtrack_ros.estimation.model import LinearModel, StateSpaceModel
from vtrack_ros.estimation.particle_filter import FilterStep, ParticleFilter
from vtrack_ros.estimation.proposals import GreyProposal, PriorProposal, Proposal, Proposed
from vtrack_ros.estimation.resampling import resampler, RESAMPLERS
from vtrack_ros.estimation.weights import Weights

__all__ = [
    'Belief', 'ConstantVelocity', 'FilterStep', 'FirstOrderAutoregressive', 'Gaussian',
    'GaussianNoise', 'GreyProposal', 'LinearModel', 'ParticleFilter', 'PriorProposal',
    'Proposal', 'Proposed', 'resampler', 'RESAMPLERS', 'SecondOrderAutoregressive',
    'StateSpaceModel', 'Weights',
]
