"""The figures of merit of one run, and of a tracker's runs over sequences and seeds."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vtrack_ros.evaluation import calibration, metrics
from vtrack_ros.evaluation.runner import Run
from vtrack_ros.frame import Array


@dataclass(frozen=True)
class Figure:
    """A figure of merit: name in JSON, and in tables; a timed one differs from run to run."""

    key: str
    title: str
    description: str
    timed: bool = False


FIGURES = (
    Figure('auc', 'AUC', 'area under the success curve: share of frames with an overlap above a '
           'threshold, mean over 21 thresholds from 0 to 1'),
    Figure('precision20', 'P@20', 'share of frames with a centre error of at most 20 px'),
    Figure('normalised_precision', 'NP', 'share of frames with a centre error within a threshold, '
           'mean over thresholds from 0 to 0.5 target sizes'),
    Figure('rmse_mean', 'RMSE', 'centre error, mean over frames [px]'),
    Figure('rmse_var', 'RMSE var', 'centre error, variance over frames [px^2]'),
    Figure('failures', 'fail', 'number of failures: the overlap fell to 0'),
    Figure('recovery_frames', 'recov', 'frames from a failure until the overlap is above 0.1, '
           'mean over failures that ended'),
    Figure('auroc', 'AUROC', 'probability that the confidence is higher in a frame on the target '
           '(IoU > 0.5) than in one off it (IoU < 0.1, or target absent)'),
    Figure('losses', 'losses', 'number of losses: after being on the target, the box is off it or '
           'the target absent'),
    Figure('losses_reported', 'said', 'share of losses that the state reported (not TRACKING)'),
    Figure('report_frames', 'delay', 'frames from a loss to its report, mean over the reported '
           'losses'),
    Figure('false_alarms', 'alarm', 'false alarms: share of frames on the target in which the '
           'state was not TRACKING'),
    Figure('wrong_tracking', 'wrong', 'share of frames in which the state was TRACKING although '
           'the box was off the target or the target absent'),
    Figure('returns', 'returns', 'number of returns of an absent target'),
    Figure('found15', 'found', 'share of returns after which the box was on the target within 15 '
           'frames'),
    Figure('coverage50', 'in 50%', 'share of true centres inside the 50 % ellipse of the '
           'covariance, over frames in state TRACKING'),
    Figure('coverage90', 'in 90%', 'share of true centres inside the 90 % ellipse of the '
           'covariance, over frames in state TRACKING'),
    Figure('ms_median', 'ms', 'wall-clock time of an update, median [ms]', True),
    Figure('ms_p99', 'ms p99', 'wall-clock time of an update, 99th percentile [ms]', True),
    Figure('cpu_ms_median', 'cpu ms',
           'processor time of an update, all threads together, median [ms]', True),
    Figure('cei', 'CEI', 'composite evaluation index, smaller is better: weighted sum of median '
           'processor time (0.5), RMSE (0.3) and RMSE variance (0.2), each divided by that of the '
           'worst tracker', True),
)

#: Weights in the composite index: time, mean of the RMSE, its variance [Zhu2012, section 5].
_INDEX_WEIGHTS = np.array([0.5, 0.3, 0.2])


@dataclass(frozen=True)
class Confidences:
    """A run's confidences in frames on the target and off it, for the AUROC."""

    on: Array
    off: Array


def confidences(run: Run, truth: Array) -> Confidences:
    """Return the confidences on and off the target, without the first frame (its box is given)."""
    overlap = metrics.overlaps(run.boxes, truth)[1:]
    confidence = run.confidences[1:]
    return Confidences(confidence[metrics.on_target(overlap)],
                       confidence[metrics.off_target(overlap)])


def score(run: Run, truth: Array) -> dict[str, float]:
    """Return the figures of one run by their keys; NaN for an undefined one (such as no loss)."""
    overlap = metrics.overlaps(run.boxes, truth)
    error = metrics.center_errors(run.boxes, truth)
    failed = metrics.failures(overlap)
    lost = calibration.losses(overlap, ~run.measured)
    returned = calibration.return_delays(overlap)
    confidence = confidences(run, truth)
    on = metrics.on_target(overlap)[1:]
    inside = {probability: calibration.inside_ellipse(
        run.boxes, run.covariances, truth, probability)[1:][run.measured[1:]]
        for probability in (0.5, 0.9)}
    return {
        'auc': metrics.success_auc(overlap),
        'precision20': metrics.precision_at(error),
        'normalised_precision': metrics.normalised_precision(
            metrics.normalised_errors(run.boxes, truth)),
        'rmse_mean': mean(error),
        'rmse_var': float(np.nanvar(error)),
        'failures': float(failed.count),
        'recovery_frames': mean(failed.recoveries),
        'auroc': calibration.auroc(confidence.on, confidence.off),
        'losses': float(lost.count),
        'losses_reported': len(lost.delays) / lost.count if lost.count else math.nan,
        'report_frames': mean(lost.delays),
        'false_alarms': mean(~run.measured[1:][on]),
        'wrong_tracking': mean((run.measured & metrics.off_target(overlap))[1:]),
        'returns': float(len(returned)),
        'found15': mean([delay <= 15 for delay in returned]),
        'coverage50': mean(inside[0.5]),
        'coverage90': mean(inside[0.9]),
        'ms_median': float(np.median(run.wall_ms)) if len(run.wall_ms) else math.nan,
        'ms_p99': float(np.percentile(run.wall_ms, 99)) if len(run.wall_ms) else math.nan,
        'cpu_ms_median': float(np.median(run.cpu_ms)) if len(run.cpu_ms) else math.nan,
    }


def over_seeds(scores: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return mean and standard deviation (`KEY_std`, 0 for one seed) of each figure."""
    rows = list(scores)
    result = {}
    for key in rows[0]:
        values = [row[key] for row in rows if not math.isnan(row[key])]
        result[key] = mean(values)
        result[f'{key}_std'] = (
            math.nan if not values else float(np.std(values, ddof=1)) if len(values) > 1 else 0.0)
    return result


def over_sequences(scores: Iterable[Mapping[str, float]],
                   judged: Iterable[Confidences]) -> dict[str, float]:
    """
    Return the summary of one tracker and seed.

    Every figure is the mean over the sequences where it's defined, except the AUROC: it is that of
    all sequences' frames pooled, since one threshold on the confidence has to serve everywhere.
    """
    rows, pooled = list(scores), list(judged)
    result = {key: mean([row[key] for row in rows]) for key in rows[0]}
    result['auroc'] = calibration.auroc(
        np.concatenate([one.on for one in pooled]), np.concatenate([one.off for one in pooled]))
    return result


def with_index(rows: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the figures by tracker with `cei`, the composite index [Zhu2012, eq. 21]."""
    criteria = {label: [row[key] for key in ('cpu_ms_median', 'rmse_mean', 'rmse_var')]
                for label, row in rows.items()}
    known = [label for label, values in criteria.items() if not any(map(math.isnan, values))]
    index = dict.fromkeys(rows, math.nan)
    if known:
        index.update(zip(known, composite_index([criteria[label] for label in known]).tolist()))
    return {label: {**row, 'cei': index[label]} for label, row in rows.items()}


def composite_index(criteria: ArrayLike) -> Array:
    """
    Return the composite evaluation index of each algorithm, shape (algorithms,) [Zhu2012, eq. 21].

    `CEI(X_k) = sum_i w_i C_i(X_k) / max_j C_i(X_j)`: from 0 to 1, smaller is better. It is
    relative to the worst of those compared: adding an algorithm may change the others' index.

    Criteria, shape (algorithms, 3), are time per frame, mean and variance of the RMSE; one that is
    zero for all algorithms contributes zero.
    """
    values = np.asarray(criteria, dtype=np.float64)
    largest = values.max(axis=0)
    return np.asarray(values / np.where(largest > 0, largest, 1.0) @ _INDEX_WEIGHTS)


def mean(values: Iterable[float] | NDArray[np.generic]) -> float:
    """Return the mean of the values that aren't NaN; NaN if there are none."""
    array = np.asarray(values if isinstance(values, np.ndarray) else list(values), dtype=float)
    array = array[~np.isnan(array)]
    return float(array.mean()) if array.size else math.nan
