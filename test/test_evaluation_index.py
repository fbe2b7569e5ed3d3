"""CEI against the tables of the paper that defines it."""

import numpy as np
import pytest

from vtrack_ros.evaluation.scoring import composite_index


def test_table_1_of_the_paper():
    """Time per frame, RMSE mean, RMSE variance of PF, KPF, UPF and GMPF [Zhu2012, table 1]."""
    criteria = [[0.0762, 16.9794, 129.6295], [0.0820, 4.2899, 13.3189],
                [0.1113, 3.4410, 7.9485], [0.0777, 3.8462, 19.5733]]
    np.testing.assert_allclose(
        composite_index(criteria), [0.8423, 0.4647, 0.5731, 0.4472], atol=5e-4)


def test_table_2_of_the_paper():
    """With 50, 100, 150 and 200 particles [Zhu2012, table 2]."""
    criteria = [[0.0833, 3.8381, 14.7469], [0.0961, 3.1069, 14.7350],
                [0.1089, 2.7290, 7.5776], [0.1214, 3.0367, 9.4589]]
    np.testing.assert_allclose(
        composite_index(criteria), [0.8431, 0.8385, 0.7646, 0.8656], atol=5e-4)


def test_the_worst_in_everything_is_one_and_an_idle_criterion_counts_nothing():
    index = composite_index([[2.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
    np.testing.assert_allclose(index, [0.7, 0.45])
    assert composite_index([[3.0, 7.0, 2.0]]) == pytest.approx(1.0)
