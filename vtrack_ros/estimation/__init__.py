"""
Bayesian filters for any state-space model, independent of pixels and of ROS.

- Models say how a state moves and what is measured of it: `ConstantVelocity`, or a subclass of
  `StateSpaceModel` (`LinearModel`) of your own.
- A `GaussianFilter` estimates a `Gaussian`: `KalmanFilter`, `ExtendedKalmanFilter`, or
  `SigmaPointFilter` with a rule of sigma points.
- A `ParticleFilter` estimates a `Belief`, a weighted particle set. Its `Proposal` decides whether
  it is the PF, GMPF (`GreyProposal`), KPF, EPF, UPF, QKPF or P-QKPF (`GaussianFilterProposal`).

>>> import numpy as np
>>> model = ConstantVelocity(positions=1, measurement_noise=[[0.25]])
>>> kalman_filter = SigmaPointFilter(model, unscented)
>>> filters = [ParticleFilter(model, proposal, particles=2000, rng=np.random.default_rng(1))
...            for proposal in (PriorProposal(), GaussianFilterProposal(kalman_filter))]
>>> for particle_filter in filters:
...     _ = particle_filter.start(mean=[0.0, 1.0], covariance=np.eye(2))
...     for position in (1.1, 2.0, 2.9):
...         belief = particle_filter.step([position], dt=1.0)
...     print(belief.mean.round(1))
[2.9 0.9]
[2.9 0.9]

"""

from vtrack_ros.estimation.grey import gm11_forecast, GreyProposal
from vtrack_ros.estimation.interacting import mix, moments, switching, VelocityHypotheses
from vtrack_ros.estimation.kalman import (
    central_differences, covariance_factors, ExtendedKalmanFilter, Gaussian, GaussianFilter,
    KalmanFilter)
from vtrack_ros.estimation.model import (
    ConstantVelocity, GaussianNoise, LinearModel, StateSpaceModel)
from vtrack_ros.estimation.particle_filter import ParticleFilter
from vtrack_ros.estimation.particles import at_least, Belief, spread_about, systematic, Weights
from vtrack_ros.estimation.proposals import (
    GaussianFilterProposal, PriorProposal, Proposal, Proposed)
from vtrack_ros.estimation.sigma_point_filter import SigmaPointFilter
from vtrack_ros.estimation.sigma_points import (
    cubature, gauss_hermite, hermite_nodes, pruned_gauss_hermite, pruning_threshold, RuleFactory,
    SigmaPointRule, unscented)

__all__ = [
    'at_least', 'Belief', 'central_differences', 'ConstantVelocity', 'covariance_factors',
    'cubature', 'ExtendedKalmanFilter', 'gauss_hermite', 'Gaussian', 'GaussianFilter',
    'GaussianFilterProposal', 'GaussianNoise', 'gm11_forecast', 'GreyProposal', 'hermite_nodes',
    'KalmanFilter', 'LinearModel', 'mix', 'moments', 'ParticleFilter', 'PriorProposal',
    'Proposal', 'Proposed', 'pruned_gauss_hermite', 'pruning_threshold', 'RuleFactory',
    'SigmaPointFilter', 'SigmaPointRule', 'spread_about', 'StateSpaceModel', 'switching',
    'systematic', 'unscented', 'VelocityHypotheses', 'Weights',
]
