"""Bayesian filters on any state-space model; they know no pixels and no ROS."""

from vtrack_ros.estimation.belief import Belief, spread_about
from vtrack_ros.estimation.gaussian import Gaussian, GaussianNoise
from vtrack_ros.estimation.gaussian_proposal import GaussianFilterProposal
from vtrack_ros.estimation.indices import composite_index
from vtrack_ros.estimation.kalman import ExtendedKalmanFilter, GaussianFilter, KalmanFilter
from vtrack_ros.estimation.linear_models import (
    ConstantVelocity, FirstOrderAutoregressive, SecondOrderAutoregressive)
from vtrack_ros.estimation.model import LinearModel, StateSpaceModel
from vtrack_ros.estimation.nonlinear_models import (
    BearingRange, UnivariateNonstationaryGrowth, VanDerMerweModel)
from vtrack_ros.estimation.particle_filter import FilterStep, ParticleFilter
from vtrack_ros.estimation.proposals import GreyProposal, PriorProposal, Proposal, Proposed
from vtrack_ros.estimation.resampling import resampler, RESAMPLERS
from vtrack_ros.estimation.sigma_point_filter import SigmaPointFilter
from vtrack_ros.estimation.sigma_points import (
    cubature, gauss_hermite, pruned_gauss_hermite, SigmaPointRule, unscented)
from vtrack_ros.estimation.weights import Weights

__all__ = [
    'BearingRange', 'Belief', 'composite_index', 'ConstantVelocity', 'cubature',
    'ExtendedKalmanFilter', 'FilterStep', 'FirstOrderAutoregressive', 'gauss_hermite', 'Gaussian',
    'GaussianFilter', 'GaussianFilterProposal', 'GaussianNoise', 'GreyProposal', 'KalmanFilter',
    'LinearModel', 'ParticleFilter', 'PriorProposal', 'Proposal', 'Proposed',
    'pruned_gauss_hermite', 'resampler', 'RESAMPLERS', 'SecondOrderAutoregressive',
    'SigmaPointFilter', 'SigmaPointRule', 'spread_about', 'StateSpaceModel',
    'UnivariateNonstationaryGrowth', 'unscented', 'VanDerMerweModel', 'Weights',
]
