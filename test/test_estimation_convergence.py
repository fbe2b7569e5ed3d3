"""Every particle filter converges to the Kalman filter where that one is exact."""

from functools import partial
import math

from nonlinear_models import simulate, VanDerMerweModel
import numpy as np
import pytest
from random_walk import RandomWalk

from vtrack_ros.estimation import (
    ConstantVelocity, cubature, ExtendedKalmanFilter, gauss_hermite, Gaussian,
    GaussianFilterProposal, GreyProposal, KalmanFilter, ParticleFilter, PriorProposal,
    pruned_gauss_hermite, SigmaPointFilter, unscented)

STEPS = 8
RUNS = 30
MODELS = {
    'walk': RandomWalk(0.95, 1.0, 0.5),
    'velocity': ConstantVelocity(1, 0, 0.5, 1.0, [[1.0]]),
}


def per_particle(factory, **options):
    return lambda model: GaussianFilterProposal(factory(model), **options)


def sigma(rule, **options):
    return per_particle(partial(SigmaPointFilter, rule=rule), **options)


PROPOSALS = {
    'pf': lambda model: PriorProposal(),
    'gmpf': lambda model: GreyProposal(floor=2.0),
    'gmpf, prior share': lambda model: GreyProposal(prior_share=0.3, spread='predicted'),
    'gmpf, moved': lambda model: GreyProposal(prior_share=0.3, spread='moved'),
    'kpf': per_particle(KalmanFilter),
    'kpf, kept': per_particle(KalmanFilter, covariance='kept'),
    'kpf, inflated': per_particle(KalmanFilter, inflation=0.5),
    'epf': per_particle(ExtendedKalmanFilter),
    'upf': sigma(unscented),
    'qkpf': sigma(gauss_hermite),
    'pqkpf': sigma(pruned_gauss_hermite),
    'pqkpf, regrouped': sigma(partial(pruned_gauss_hermite, regroup=True)),
    'ckpf': sigma(cubature),
}


def exact(model):
    """Return measurements, and the Kalman filter's last mean, covariance and log-evidence."""
    n = model.state_dimension
    _, measurements = simulate(model, np.zeros(n), STEPS, np.random.default_rng(11))
    kalman = KalmanFilter(model)
    belief, log_evidence = Gaussian.from_moments(np.zeros(n), np.eye(n)), 0.0
    for measurement in measurements:
        correction = kalman.update(kalman.predict(belief, 1.0), measurement)
        belief, log_evidence = correction.posterior, log_evidence + correction.log_evidence[0]
    return measurements, belief.mean[0], belief.covariance[0], log_evidence


def run(model, proposal, measurements, particles, seed, **options):
    """Return the particle filter's last mean and covariance, and its log-evidence."""
    n = model.state_dimension
    particle_filter = ParticleFilter(
        model, proposal, particles=particles, rng=np.random.default_rng(seed), **options)
    particle_filter.start(np.zeros(n), np.eye(n))
    log_evidence = 0.0
    for measurement in measurements:
        step = particle_filter.step(measurement)
        log_evidence += step.weights.log_evidence
    assert particle_filter.recoveries == 0
    return step.mean, step.covariance, log_evidence


@pytest.mark.parametrize('name, model_name', [
    # The forecast of a velocity that isn't measured feeds on itself: without a share of prior
    # particles the weights of the grey proposal have no bound there.
    ('gmpf', 'walk'), ('pf', 'walk'),
    *((name, 'velocity') for name in sorted(PROPOSALS) if name != 'gmpf')])
def test_convergence_to_the_kalman_filter(name, model_name):
    """
    Mean and covariance within Monte Carlo error, which falls as one over the root of N.

    Over independent runs, the average error of the mean must be zero within five of its standard
    errors; the bias of a self-normalised estimate, of order variance / N, is allowed for. From N
    to 9 N the error falls by three; 1.65 to 5.45 is a four-sigma band for the ratio of standard
    deviations of 30 runs each.
    """
    model = MODELS[model_name]
    measurements, mean, covariance, _ = exact(model)
    spread = np.sqrt(covariance.diagonal())
    errors = {}
    for particles in (100, 900):
        results = [run(model, PROPOSALS[name](model), measurements, particles, seed)
                   for seed in range(RUNS)]
        errors[particles] = np.array([(result[0] - mean) / spread for result in results])
    large = errors[900]
    deviation = large.std(axis=0)
    bias = deviation ** 2
    assert (np.abs(large.mean(axis=0)) < 5 * deviation / math.sqrt(RUNS) + bias).all()
    # An effective sample of 900 / 34 at least: the error is a small part of the posterior's.
    assert (deviation < math.sqrt(34 / 900)).all()
    covariances = np.array([result[1] for result in results]) / np.outer(spread, spread)
    error = covariances.std(axis=0)
    difference = np.abs(covariances.mean(axis=0) - covariance / np.outer(spread, spread))
    assert (difference < 5 * error / math.sqrt(RUNS) + error ** 2).all()
    ratio = np.sqrt((errors[100] ** 2).mean()) / np.sqrt((large ** 2).mean())
    assert 1.65 < ratio < 5.45


@pytest.mark.parametrize('name', sorted(PROPOSALS))
def test_the_evidence_is_unbiased(name):
    """
    E[exp(sum log-evidence)] is the exact evidence for any N, with any proposal.

    This holds for full weights alone, and fails if a density, a weight or the resampling is wrong
    by any factor.
    """
    model = MODELS['walk']
    measurements, _, _, log_evidence = exact(model)
    ratios = np.array([
        math.exp(run(model, PROPOSALS[name](model), measurements, 600, seed)[2] - log_evidence)
        for seed in range(40)])
    assert abs(ratios.mean() - 1) < 5 * ratios.std() / math.sqrt(len(ratios))
    assert ratios.std() < 0.35


@pytest.mark.parametrize('threshold', [0.0, 0.5, 1.0])
def test_the_evidence_is_unbiased_however_often_they_are_resampled(threshold):
    model = MODELS['walk']
    measurements, _, _, log_evidence = exact(model)
    ratios = np.array([
        math.exp(run(model, PriorProposal(), measurements, 1000, seed,
                     threshold=threshold)[2] - log_evidence) for seed in range(40)])
    assert abs(ratios.mean() - 1) < 5 * ratios.std() / math.sqrt(len(ratios))


def test_simplified_weights_take_the_proposal_for_the_prior():
    """With a Kalman proposal they count the measurement twice: the posterior gets too narrow."""
    model = MODELS['walk']
    measurements, _, covariance, _ = exact(model)
    full, simplified = (
        run(model, PROPOSALS['kpf'](model), measurements, 4000, 1, weighting=weighting)[1][0, 0]
        for weighting in ('full', 'simplified'))
    assert full == pytest.approx(covariance[0, 0], rel=0.15)
    assert simplified < 0.8 * covariance[0, 0]


def test_without_a_measurement_every_proposal_predicts():
    """Missing measurements in between: the Kalman filter skips the update, and so do the rest."""
    model = MODELS['velocity']
    _, measurements = simulate(model, [0.0, 0.0], STEPS, np.random.default_rng(12))
    seen = [None if k in (3, 4, 7) else z for k, z in enumerate(measurements)]
    kalman = KalmanFilter(model)
    belief = Gaussian.from_moments(np.zeros(2), np.eye(2))
    for measurement in seen:
        belief = kalman.predict(belief, 1.0)
        if measurement is not None:
            belief = kalman.update(belief, measurement).posterior
    spread = np.sqrt(belief.covariance[0].diagonal())
    for name in ('pf', 'kpf', 'kpf, kept', 'upf', 'pqkpf', 'gmpf, prior share'):
        means = np.array([run(model, PROPOSALS[name](model), seen, 400, seed)[0]
                          for seed in range(RUNS)])
        error = (means - belief.mean[0]) / spread
        deviation = error.std(axis=0)
        assert (np.abs(error.mean(axis=0))
                < 5 * deviation / math.sqrt(RUNS) + deviation ** 2).all(), name


def test_proposals_agree_on_a_noise_that_is_not_gaussian():
    """
    On van der Merwe's model, with less precise measurements, all must find the same posterior.

    The densities of the Gamma noise and of the proposals meet in the weights.
    """
    model = VanDerMerweModel(measurement_variance=0.05)
    _, measurements = simulate(model, [1.0], 36, np.random.default_rng(13))
    results = {}
    for name in ('pf', 'epf', 'upf', 'pqkpf'):
        means = []
        for seed in range(10):
            particle_filter = ParticleFilter(
                model, PROPOSALS[name](model), particles=1000, rng=np.random.default_rng(seed))
            particle_filter.start([1.0], [[0.5]])
            means.append([particle_filter.step(z).mean[0] for z in measurements])
        results[name] = np.array(means)
    reference = results.pop('pf')
    for name, means in results.items():
        error = np.sqrt((means.var(axis=0) + reference.var(axis=0)) / 10)
        difference = np.abs(means.mean(axis=0) - reference.mean(axis=0))
        # A filter that is too narrow for the long tail may miss it for a step or two.
        assert np.mean(difference < 5 * error + 1e-3) > 0.9, name
        assert np.median(difference) < 0.02, name
