"""The incremental subspace against principal components of everything at once."""

import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.appearance.subspace import Subspace


def _patches(count, seed=0, dimension=60, rank=6):
    rng = np.random.default_rng(seed)
    spread = rng.standard_normal((rank, dimension)) * np.geomspace(3, 0.5, rank)[:, None]
    return rng.standard_normal((count, rank)) @ spread + rng.standard_normal(dimension)


@pytest.mark.parametrize('batch', [1, 5, 7])
def test_without_forgetting_it_equals_batch_principal_components(batch):
    patches = _patches(36)
    subspace = Subspace.create(patches[0], 16)
    for first in range(1, 36, batch):
        subspace = subspace.updated(patches[first:first + batch], forgetting=1.0)
    _, values, rows = np.linalg.svd(patches - patches.mean(0), full_matrices=False)
    assert_allclose(subspace.mean, patches.mean(0), atol=1e-4)
    assert subspace.count == 36
    assert_allclose(subspace.singular_values[:6], values[:6], rtol=1e-4)
    projector = subspace.components[:, :6] @ subspace.components[:, :6].T
    assert_allclose(projector, rows[:6].T @ rows[:6], atol=1e-3)


def test_components_are_orthonormal_and_bounded_in_number():
    subspace = Subspace.create(_patches(1)[0], 4).updated(_patches(20, 1)).updated(_patches(20, 2))
    assert subspace.components.shape == (60, 4)
    assert_allclose(subspace.components.T @ subspace.components, np.eye(4), atol=1e-5)
    assert (np.diff(subspace.singular_values) <= 0).all()


def test_what_lies_in_the_subspace_has_no_error():
    patches = _patches(30)
    subspace = Subspace.create(patches[0]).updated(patches[1:], 1.0)
    assert_allclose(subspace.residuals(patches.astype(np.float32)), 0, atol=1e-3)
    stranger = np.random.default_rng(9).standard_normal((1, 60)).astype(np.float32) * 5
    assert np.linalg.norm(subspace.residuals(stranger)) > 5


def test_forgetting_follows_a_change():
    old, new = _patches(40, 1), _patches(40, 2) + 5
    keeping = forgetful = Subspace.create(old[0])
    for patches in (old, new):
        for first in range(0, 40, 5):
            keeping = keeping.updated(patches[first:first + 5], 1.0)
            forgetful = forgetful.updated(patches[first:first + 5], 0.8)
    target = new.mean(0)
    assert (np.linalg.norm(forgetful.mean - target)
            < 0.7 * np.linalg.norm(keeping.mean - target))
    # the number of patches that count converges to batch / (1 - forgetting)
    assert forgetful.count == pytest.approx(25, rel=0.1)


def test_learning_leaves_the_former_subspace_alone():
    subspace = Subspace.create(_patches(1)[0])
    before = subspace.mean.copy()
    subspace.updated(_patches(5, 3))
    assert_allclose(subspace.mean, before)
    assert subspace.components.shape[1] == 0


def test_the_robust_error_is_bounded_and_an_outlier_counts_for_one_pixel():
    subspace = Subspace.create(np.zeros(50, np.float32))
    patches = np.zeros((3, 50), np.float32)
    patches[1, 7] = 1e6
    patches[2] = 1e6
    errors = subspace.robust_error(patches, 0.1)
    assert errors[0] == 0
    assert errors[1] == pytest.approx(1 / 50)
    assert 0.99 < errors[2] <= 1
    half = subspace.robust_error(np.full((1, 50), 0.1, np.float32), 0.1)
    assert half[0] == pytest.approx(0.5)


def test_many_patches_give_the_same_errors_as_one_by_one():
    patches = _patches(150, 4).astype(np.float32)
    subspace = Subspace.create(patches[0], 3).updated(patches[:20])
    together = subspace.robust_error(patches, 0.3)
    assert_allclose(together, [subspace.robust_error(patch[None], 0.3)[0] for patch in patches],
                    rtol=1e-4)


def test_identical_patches_give_a_point():
    patch = np.ones(20, np.float32)
    subspace = Subspace.create(patch).updated(np.ones((5, 20), np.float32))
    assert subspace.components.shape[1] <= 1
    assert_allclose(subspace.residuals(patch[None]), 0, atol=1e-6)
