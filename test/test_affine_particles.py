"""Particles on the affine group, and of geometric parameters: how they move."""

import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.estimation.affine_particles import GroupParticles, VectorParticles
from vtrack_ros.geometry import affine

_LIMIT = np.array([1e6, 1e6])
_SIGMAS = np.array([0.02, 0.01, 0.03, 0.01, 0.05, 0.05])


def _state(scale=30.0, turn=0.0, center=(0.0, 0.0)):
    return affine.from_vector(np.array([np.log(scale), 0, turn, 0, *center]))


@pytest.mark.parametrize('kind', [GroupParticles, VectorParticles])
def test_the_same_noise_moves_particles_alike_wherever_they_are(kind):
    # the dynamics are left-invariant: seen from the target they don't depend on its pose
    steps = []
    for first in (_state(30.0), _state(75.0, 0.0, (200.0, 50.0))):
        particles = kind(first, 200, _LIMIT, np.random.default_rng(4))
        particles.propose(1.0, _SIGMAS, 0.5)
        steps.append(affine.inverse(first) @ particles.states)
    assert_allclose(steps[0], steps[1], atol=1e-9)


def test_group_dynamics_are_invariant_to_rotation_too():
    motion = _state(2.0, 0.9, (5.0, -3.0))
    sets = []
    for first in (_state(30.0, 0.2), motion @ _state(30.0, 0.2)):
        particles = GroupParticles(first, 100, _LIMIT, np.random.default_rng(4))
        for _ in range(3):
            particles.propose(1.0, _SIGMAS, 0.5)
        sets.append(particles.states)
    assert_allclose(motion @ sets[0], sets[1], atol=1e-7)


def test_without_noise_the_process_repeats_a_share_of_the_last_step():
    particles = GroupParticles(_state(), 3, _LIMIT, np.random.default_rng(0))
    step = affine.from_coordinates(np.array([0.02, 0.01, 0.1, 0.0, 0.2, -0.1]))
    particles.velocities[:] = step
    particles.propose(1.0, np.zeros(6), 0.5)
    assert_allclose(particles.states[1], _state() @ affine.exponential(0.5 * step), atol=1e-9)
    assert_allclose(particles.velocities[1], 0.5 * step, atol=1e-9)


def test_two_frames_at_once_are_one_step_of_twice_the_length():
    particles = GroupParticles(_state(), 3, _LIMIT, np.random.default_rng(0))
    step = affine.from_coordinates(np.array([0.02, 0.01, 0.1, 0.0, 0.2, -0.1]))
    particles.velocities[:] = step
    particles.propose(2.0, np.zeros(6), 1.0)
    assert_allclose(particles.states[0], _state() @ affine.exponential(2 * step), atol=1e-9)
    assert_allclose(particles.velocities[0], step, atol=1e-9)  # still per frame


@pytest.mark.parametrize('kind', [GroupParticles, VectorParticles])
def test_the_variance_of_the_noise_grows_with_the_time_step(kind):
    spreads = []
    for dt in (1.0, 4.0):
        particles = kind(_state(), 4000, _LIMIT, np.random.default_rng(1))
        particles.propose(dt, _SIGMAS, 0.0)
        spreads.append(particles.states[:, :2, 2].std(0))
    assert_allclose(spreads[0], 30 * _SIGMAS[4:], rtol=0.06)
    assert_allclose(spreads[1] / spreads[0], 2, rtol=0.05)


def test_a_share_of_the_particles_follows_a_measured_movement():
    particles = GroupParticles(_state(), 10, _LIMIT, np.random.default_rng(0))
    move = _state(1.0, 0.3, (7.0, 0.0))
    particles.propose(1.0, np.zeros(6), 0.5, move, 0.4)
    followed = np.isclose(particles.states, move @ _state()).all((1, 2))
    stayed = np.isclose(particles.states, _state()).all((1, 2))
    assert followed.sum() == 4
    assert stayed.sum() == 6


def test_particles_turn_about_their_own_centres():
    first = _state(30.0, 0.2, (40.0, 50.0))
    particles = GroupParticles(first, 20, _LIMIT, np.random.default_rng(3))
    particles.propose(1.0, _SIGMAS, 0.5)
    before = particles.states.copy()
    particles.turn(0.7)
    assert_allclose(particles.states[:, :2, 2], before[:, :2, 2])
    assert_allclose(affine.angle(particles.states), affine.angle(before) + 0.7)
    assert_allclose(affine.stretch(particles.states), affine.stretch(before))


@pytest.mark.parametrize('kind', [GroupParticles, VectorParticles])
def test_size_shape_and_place_stay_bounded(kind):
    particles = kind(_state(30.0, 0, (50.0, 50.0)), 50, np.array([100, 100]),
                     np.random.default_rng(0))
    for _ in range(60):
        particles.propose(1.0, np.array([0.4, 0.3, 0.3, 0.3, 0.5, 0.5]), 0.9)
        scales = affine.scale(particles.states)
        assert (scales > 6).all() and (scales < 150).all()
        assert (affine.stretch(particles.states) < 2.5).all()
        assert (np.abs(particles.states[:, :2, 2] - 50) < 50 + scales[:, None]).all()


def test_gathered_and_grown_particles_are_still_so_after_the_next_step():
    particles = GroupParticles(_state(), 8, _LIMIT, np.random.default_rng(0))
    particles.gather(np.array([9.0, 4.0]), 0.5)
    particles.grow(2.0)
    particles.propose(1.0, np.zeros(6), 0.0)
    assert_allclose(affine.scale(particles.states), 60)
    at_place = np.isclose(particles.states[:, :2, 2], (9, 4)).all(1)
    assert at_place.sum() == 4
