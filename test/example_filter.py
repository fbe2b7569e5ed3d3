"""A particle filter that has been started, for tests."""

import numpy as np

from vtrack_ros.estimation import ConstantVelocity, ParticleFilter


def make(model=None, proposal=None, **options):
    """Return a filter about the origin; a constant velocity in the plane by default."""
    options.setdefault('particles', 200)
    options.setdefault('rng', np.random.default_rng(1))
    particle_filter = ParticleFilter(model or ConstantVelocity(2, 2), proposal, **options)
    dimension = particle_filter.model.state_dimension
    particle_filter.start(np.zeros(dimension), np.eye(dimension))
    return particle_filter
