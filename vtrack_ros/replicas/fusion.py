"""Fusion of several cues' likelihoods of many hypotheses."""

from collections.abc import Callable

import numpy as np

from vtrack_ros.frame import Array

#: From likelihoods (cues, N) and reliabilities (cues,) to the log of the fused one, shape (N,).
FusionRule = Callable[[Array, Array], Array]

#: Lower bound of a fused weight, so that no hypothesis is impossible.
_LEAST = 1e-12


def reliability(likelihoods: Array) -> Array:
    """
    Return each cue's reliability, shape (cues,), of likelihoods (cues, N) in [0, 1].

    It's the contrast over the hypotheses, 1 - mean / maximum: a cue that gives all the same
    likelihood carries no information. 0 for one that abstains (NaN), or finds all impossible.
    """
    highest = likelihoods.max(axis=1)
    contrast = np.where(highest > 0, 1 - likelihoods.mean(axis=1) / np.maximum(highest, _LEAST), 0)
    return np.nan_to_num(contrast, nan=0.0)


def product(likelihoods: Array, reliabilities: Array) -> Array:
    """Return the log of the product, shape (N,); a cue of reliability 0 is left out."""
    heard = likelihoods[reliabilities > 0]
    return np.log(np.maximum(heard, _LEAST)).sum(axis=0)


def weighted_sum(likelihoods: Array, reliabilities: Array) -> Array:
    """Return the log of the mean weighted by the reliabilities, shape (N,)."""
    heard = reliabilities > 0
    total = reliabilities[heard] @ likelihoods[heard]
    return np.log(np.maximum(total / max(reliabilities[heard].sum(), _LEAST), _LEAST))


def dempster_shafer(likelihoods: Array, reliabilities: Array) -> Array:
    """
    Combine the cues by Dempster's rule, hypothesis by hypothesis.

    For each hypothesis the frame of discernment is {target, other}. A cue of likelihood p and
    reliability r has the masses r p for target, r (1 - p) for other and 1 - r for unknown
    (Shafer's discounting). [Qi2012, eq. 18] prints a denominator with which the second cue
    cancels; for r = 1 this gives the correct `p q / (p q + (1 - p)(1 - q))`.

    Returns the log of the pignistic probability of target, shape (N,): its mass and half of the
    unknown.
    """
    target = np.zeros(likelihoods.shape[1])
    other = np.zeros(likelihoods.shape[1])
    unknown = np.ones(likelihoods.shape[1])
    for likelihood, trust in zip(likelihoods, reliabilities):
        if trust <= 0:
            continue
        # below 1, or two certain cues that contradict each other would divide by zero
        trust = min(trust, 0.99)
        for_target, for_other = trust * likelihood, trust * (1 - likelihood)
        for_unknown = 1 - trust
        target, other, unknown = (
            target * (for_target + for_unknown) + unknown * for_target,
            other * (for_other + for_unknown) + unknown * for_other,
            unknown * for_unknown)
        agreement = target + other + unknown
        target, other, unknown = target / agreement, other / agreement, unknown / agreement
    return np.log(np.maximum(target + unknown / 2, _LEAST))


def normalised_masses(likelihoods: Array, _: Array) -> Array:
    """
    Fuse cues by the theory of evidence as printed in [Qi2012, eqs 16-19].

    Each cue's likelihoods are divided by their sum over the particles; the result is the cue's
    basic probability of "this particle is the target" (eqs 16, 17). Two cues are combined by
    Dempster's rule,

        w = w_d w_D / (w_d w_D + (1 - w_d) (1 - w_D)),

    and divided by their sum again (eq. 19). Eq. 18 prints `(1 - w_d) w_D` in the denominator, by
    which the second cue cancels and w = w_d: the colour alone, which `cues=colour` runs.

    A cue that abstains is the same for all particles: eqs 16 and 17 give each 1/N. The previous
    weight, a factor in both eq. 8 and eq. 15, isn't applied here: the filter's step d does, once.

    Takes likelihoods, shape (cues, N), a row of NaN for a cue that abstains, and reliabilities,
    which are ignored: the paper has none. Returns the log of weights that sum to one, shape (N,).
    """
    heard = np.where(np.isnan(likelihoods), 1.0, likelihoods)
    masses = heard / heard.sum(axis=1, keepdims=True)
    target, other = masses.prod(axis=0), (1 - masses).prod(axis=0)
    with np.errstate(divide='ignore'):
        # two cues that are certain of different particles would give 0 / 0
        fused = target / np.maximum(target + other, np.finfo(np.float64).tiny)
        result: Array = np.log(fused / max(fused.sum(), np.finfo(np.float64).tiny))
    return result


#: Rules of fusion by name: our interpretations, and the second paper's equations as printed.
FUSIONS: dict[str, FusionRule] = {
    'dempster_shafer': dempster_shafer, 'product': product, 'sum': weighted_sum,
    'normalised': normalised_masses}
