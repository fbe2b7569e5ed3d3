"""Indices that compare algorithms on several criteria."""

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.model import checked_array, FloatArray

#: For time per frame, mean and variance of the RMSE [Zhu2012, section 5].
PAPER_WEIGHTS = (0.5, 0.3, 0.2)


def composite_index(criteria: ArrayLike, weights: ArrayLike = PAPER_WEIGHTS) -> FloatArray:
    """
    Return the composite evaluation index of each algorithm, shape (algorithms,) [Zhu2012, eq. 21].

    `CEI(X_k) = sum_i w_i C_i(X_k) / max_j C_i(X_j)`: from 0 to 1, smaller is better. It is
    relative to the worst of those compared: adding an algorithm changes the others' index.

    Criteria, shape (algorithms, criteria), are zero or more, the smaller the better; one that is
    zero for all counts zero. Weights, shape (criteria,), are zero or more, with sum one.
    """
    weights = checked_array('weights', weights, (None,))
    criteria = checked_array('criteria', criteria, (None, len(weights)))
    if not len(criteria) or (criteria < 0).any():
        raise ValueError('criteria must be zero or more, of at least one algorithm')
    if (weights < 0).any() or abs(weights.sum() - 1) > 1e-9:
        raise ValueError('weights must be zero or more, with sum one')
    largest = criteria.max(axis=0)
    largest[largest == 0] = 1.0
    return np.asarray(criteria / largest @ weights)
