"""No step allocates more than it returns plus one array of sigma points."""

import tracemalloc

from nonlinear_models import BearingRange, UnivariateNonstationaryGrowth
import numpy as np
import pytest

from vtrack_ros.estimation import (
    ConstantVelocity, cubature, ExtendedKalmanFilter, gauss_hermite, Gaussian,
    GaussianFilterProposal, GreyProposal, KalmanFilter, ParticleFilter, PriorProposal,
    pruned_gauss_hermite, SigmaPointFilter, unscented)

COUNT = 8000
SMALL_CHANGE = 64 * 1024
"""What the interpreter, index arrays of one block and cached factors may take, in bytes."""


def array_bytes(*arrays):
    return sum(array.nbytes for array in arrays if array is not None)


def belief_bytes(belief):
    return array_bytes(belief.states, belief.weights.values, belief.weights.logarithms,
                       belief.covariances)


def peak_of(call):
    """Return a call's result, and the peak of the memory allocated during it, in bytes."""
    call()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        result = call()
        return result, tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


def points_of(gaussian_filter):
    """Return the number of sigma points of a filter; the unscented rule's where it has none."""
    if isinstance(gaussian_filter, SigmaPointFilter):
        return len(gaussian_filter.update_rule)
    return 2 * gaussian_filter.model.state_dimension + 1


FILTERS = [
    KalmanFilter(ConstantVelocity(2, 2)), ExtendedKalmanFilter(BearingRange(2)),
    ExtendedKalmanFilter(UnivariateNonstationaryGrowth()),
    *(SigmaPointFilter(model, rule, measured_only) for rule in (
        unscented, cubature, gauss_hermite, pruned_gauss_hermite)
      for model, measured_only in (
          (BearingRange(2), True), (BearingRange(2), False),
          (UnivariateNonstationaryGrowth(), True))),
]


@pytest.mark.parametrize('gaussian_filter', FILTERS, ids=lambda f: (
    f'{type(f).__name__}-{type(f.model).__name__}-{points_of(f)}'))
def test_gaussian_filters(gaussian_filter):
    model, count = gaussian_filter.model, COUNT
    n = model.state_dimension
    beliefs = Gaussian(np.full((count, n), 20.0), np.tile(np.eye(n), (count, 1, 1)))
    one_array = count * points_of(gaussian_filter) * n * 8
    predicted, peak = peak_of(lambda: gaussian_filter.predict(beliefs, 1.0))
    returned = array_bytes(predicted.mean, predicted.covariance)
    assert peak <= returned + one_array + SMALL_CHANGE
    measurement = model.measure(predicted.mean[:1])[0]
    correction, peak = peak_of(lambda: gaussian_filter.update(predicted, measurement))
    returned = array_bytes(correction.posterior.mean, correction.posterior.covariance,
                           correction.log_evidence)
    assert peak <= returned + one_array + SMALL_CHANGE


PROPOSALS = {
    'prior': lambda model: PriorProposal(),
    'grey': lambda model: GreyProposal(),
    'grey, mixed': lambda model: GreyProposal(prior_share=0.3, spread='predicted'),
    **{f'{rule.__name__}, {covariance}': (
        lambda model, rule=rule, covariance=covariance: GaussianFilterProposal(
            SigmaPointFilter(model, rule), covariance, inflation=0.1))
       for rule in (unscented, cubature, gauss_hermite, pruned_gauss_hermite)
       for covariance in ('reset', 'kept')},
    'ekf, kept': lambda model: GaussianFilterProposal(ExtendedKalmanFilter(model), 'kept'),
}


@pytest.mark.parametrize('name', sorted(PROPOSALS))
@pytest.mark.parametrize('model', [BearingRange(2), UnivariateNonstationaryGrowth()],
                         ids=['4-D', '1-D'])
def test_steps_of_particle_filters(name, model):
    proposal = PROPOSALS[name](model)
    n = model.state_dimension
    particle_filter = ParticleFilter(
        model, proposal, particles=COUNT, threshold=1.0, rng=np.random.default_rng(1))
    start = np.full(n, 20.0)
    particle_filter.start(start, np.eye(n))
    measurement = model.measure(start[np.newaxis])[0]
    for _ in range(max(proposal.window - 1, 1)):
        particle_filter.step(measurement)
    step, peak = peak_of(lambda: particle_filter.step(measurement))
    after = particle_filter.belief
    returned = belief_bytes(step) + (belief_bytes(after) if after is not step else 0)
    gaussian_filter = getattr(proposal, 'gaussian_filter', None)
    points = points_of(gaussian_filter) if gaussian_filter else 2 * n + 1
    assert peak <= returned + COUNT * points * n * 8 + SMALL_CHANGE
