"""The incremental subspace against principal components of everything at once."""

import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.appearance.subspace import Subspace


def _looks(count, seed=0, dimension=60, rank=6):
    rng = np.random.default_rng(seed)
    spread = rng.standard_normal((rank, dimension)) * np.geomspace(3, 0.5, rank)[:, None]
    return rng.standard_normal((count, rank)) @ spread + rng.standard_normal(dimension)


@pytest.mark.parametrize('batch', [1, 5, 7])
def test_without_forgetting_it_equals_batch_principal_components(batch):
    looks = _looks(36)
    subspace = Subspace.create(looks[0], 16)
    for first in range(1, 36, batch):
        subspace = subspace.updated(looks[first:first + batch], forgetting=1.0)
    _, values, rows = np.linalg.svd(looks - looks.mean(0), full_matrices=False)
    assert_allclose(subspace.mean, looks.mean(0), atol=1e-4)
    assert subspace.count == 36
    assert_allclose(subspace.singular_values[:6], values[:6], rtol=1e-4)
    projector = subspace.components[:, :6] @ subspace.components[:, :6].T
    assert_allclose(projector, rows[:6].T @ rows[:6], atol=1e-3)


def test_components_are_orthonormal_and_bounded_in_number():
    subspace = Subspace.create(_looks(1)[0], 4).updated(_looks(20, 1)).updated(_looks(20, 2))
    assert subspace.components.shape == (60, 4)
    assert_allclose(subspace.components.T @ subspace.components, np.eye(4), atol=1e-5)
    assert (np.diff(subspace.singular_values) <= 0).all()


def test_what_lies_in_the_subspace_has_no_error():
    looks = _looks(30)
    subspace = Subspace.create(looks[0]).updated(looks[1:], 1.0)
    assert_allclose(subspace.distance(looks.astype(np.float32)), 0, atol=1e-3)
    stranger = np.random.default_rng(9).standard_normal((1, 60)).astype(np.float32) * 5
    assert subspace.distance(stranger)[0] > 5


def test_forgetting_follows_a_change():
    old, new = _looks(40, 1), _looks(40, 2) + 5
    keeping = forgetful = Subspace.create(old[0])
    for looks in (old, new):
        for first in range(0, 40, 5):
            keeping = keeping.updated(looks[first:first + 5], 1.0)
            forgetful = forgetful.updated(looks[first:first + 5], 0.8)
    target = new.mean(0)
    assert (np.linalg.norm(forgetful.mean - target)
            < 0.7 * np.linalg.norm(keeping.mean - target))
    # the number of looks that count converges to batch / (1 - forgetting)
    assert forgetful.count == pytest.approx(25, rel=0.1)


def test_learning_leaves_the_former_subspace_alone():
    subspace = Subspace.create(_looks(1)[0])
    before = subspace.mean.copy()
    subspace.updated(_looks(5, 3))
    assert_allclose(subspace.mean, before)
    assert subspace.components.shape[1] == 0


def test_the_robust_error_is_bounded_and_an_outlier_counts_for_one_pixel():
    subspace = Subspace.create(np.zeros(50, np.float32))
    looks = np.zeros((3, 50), np.float32)
    looks[1, 7] = 1e6
    looks[2] = 1e6
    errors = subspace.robust_error(looks, 0.1)
    assert errors[0] == 0
    assert errors[1] == pytest.approx(1 / 50)
    assert 0.99 < errors[2] <= 1
    half = subspace.robust_error(np.full((1, 50), 0.1, np.float32), 0.1)
    assert half[0] == pytest.approx(0.5)


def test_many_looks_give_the_same_errors_as_one_by_one():
    looks = _looks(150, 4).astype(np.float32)
    subspace = Subspace.create(looks[0], 3).updated(looks[:20])
    together = subspace.robust_error(looks, 0.3)
    assert_allclose(together, [subspace.robust_error(look[None], 0.3)[0] for look in looks],
                    rtol=1e-4)


def test_identical_looks_give_a_point():
    look = np.ones(20, np.float32)
    subspace = Subspace.create(look).updated(np.ones((5, 20), np.float32))
    assert subspace.components.shape[1] <= 1
    assert_allclose(subspace.distance(look[None]), 0, atol=1e-6)
