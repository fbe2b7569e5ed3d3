"""Results as one self-contained HTML page."""

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from itertools import chain, zip_longest
import math
from typing import Any

import cv2
from jinja2 import Environment, StrictUndefined
import numpy as np

from vtrack_ros.evaluation import metrics
from vtrack_ros.evaluation.charts import bar_chart, colour, Curve, line_chart
from vtrack_ros.evaluation.results import Results, Scores
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.runner import Run
from vtrack_ros.evaluation.scoring import FIGURES
from vtrack_ros.evaluation.sequences import Sequence
from vtrack_ros.evaluation.stress_report import stress_section
from vtrack_ros.evaluation.stress_results import StressResults
from vtrack_ros.evaluation.table import fewer_targets, number_text, ranked
from vtrack_ros.frame import Array, Frame

#: Whether a figure's largest or its smallest value is the best; no best for figures not listed.
_BEST: dict[str, Callable[[list[float]], float]] = {
    **dict.fromkeys(('auc', 'precision20', 'normalised_precision', 'auroc', 'losses_reported',
                     'found15'), max),
    **dict.fromkeys(('rmse_mean', 'rmse_var', 'failures', 'recovery_frames', 'report_frames',
                     'false_alarms', 'wrong_tracking', 'ms_median', 'ms_p99', 'cpu_ms_median',
                     'cei'), min)}

_QUESTIONS = {
    'Accuracy': ('auc', 'precision20', 'normalised_precision', 'rmse_mean', 'rmse_var',
                 'failures', 'recovery_frames'),
    'Detection of losses': ('auroc', 'losses', 'losses_reported', 'report_frames', 'false_alarms',
                            'wrong_tracking', 'returns', 'found15', 'coverage50', 'coverage90'),
    'Computing time': ('ms_median', 'ms_p99', 'cpu_ms_median', 'cei'),
}
_FOR_SEQUENCE = ('auc', 'precision20', 'rmse_mean', 'failures', 'auroc', 'report_frames',
                 'false_alarms', 'wrong_tracking', 'found15', 'coverage90', 'ms_median')
#: The width of a picture on the page, in CSS pixels.
_PICTURE = 306


@dataclass(frozen=True)
class WorstFrame:
    """A frame's index, the tracker that it was chosen for, and its overlap (NaN: no target)."""

    index: int
    tracker: str
    overlap: float


def worst_frames(runs: Mapping[str, Run], truth: Array, limit: int = 3,
                 apart: int = 8) -> list[WorstFrame]:
    """
    Return the worst frames of a sequence's runs, at most `limit`, in the order of time.

    A tracker's candidates are the first frames of its stretches off the target, the longest
    stretch first, and then all frames by increasing overlap. The trackers take turns, the one with
    the lowest mean overlap first; a frame closer than `apart` to a chosen one is skipped.
    """
    overlaps = {label: metrics.overlaps(run.boxes, truth) for label, run in runs.items()}
    worst_first = sorted(overlaps, key=lambda label: float(np.nanmean(overlaps[label])))
    turns = zip_longest(*(
        [(label, index) for index in _candidates(overlaps[label])] for label in worst_first))
    chosen: list[WorstFrame] = []
    for candidate in chain.from_iterable(turns):
        if candidate is None or len(chosen) == limit:
            continue
        label, index = candidate
        if all(abs(index - other.index) >= apart for other in chosen):
            chosen.append(WorstFrame(index, label, float(overlaps[label][index])))
    return sorted(chosen, key=lambda frame: frame.index)


def _candidates(overlap: Array) -> list[int]:
    known = np.nan_to_num(overlap, nan=1.0)
    losses = sorted(metrics.true_runs(known < metrics.OFF_TARGET),
                    key=lambda stretch: stretch[0] - stretch[1])
    least = np.argsort(known, kind='stable')
    return [begin for begin, _ in losses] + [int(index) for index in least]


def html_page(results: Results, stress: StressResults | None = None) -> str:
    """Return the page, which needs no other file; with the results under stress, if given."""
    rows = ranked(results)
    colors = {label: colour(index) for index, label in enumerate(rows)}
    template = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True,
                           undefined=StrictUndefined).from_string(
        files(__package__).joinpath('report.html.jinja').read_text(encoding='utf-8'))
    charts = {} if not rows else {
        'success': line_chart(
            _mean_curves(results, colors, metrics.OVERLAP_THRESHOLDS, lambda boxes, truth:
                         metrics.success_curve(metrics.overlaps(boxes, truth))),
            'overlap threshold', 'share of frames above', y_top=1.0),
        'precision': line_chart(
            _mean_curves(results, colors, metrics.PRECISION_THRESHOLDS, lambda boxes, truth:
                         metrics.precision_curve(metrics.center_errors(boxes, truth))),
            'centre error threshold [px]', 'share of frames within', y_top=1.0),
        'bars': bar_chart({
            name: {label: (_value(row[label], 'auc'), _value(row[label], 'auc_std'))
                   for label in colors if label in row}
            for name, row in results.by_sequence.items() if row}, colors)}
    return template.render(
        results=results, environment=environment(), colors=colors, figures=FIGURES, charts=charts,
        stress=None if stress is None else stress_section(stress, colors),
        tables={question: _table(rows, keys) for question, keys in _QUESTIONS.items()},
        fewer=fewer_targets(results),
        auc={label: number_text(_value(row, 'auc'), 'auc') for label, row in rows.items()},
        sequences=[_sequence(results, sequence, colors) for sequence in results.sequences.values()
                   if colors.keys() & results.by_sequence[sequence.name].keys()])


def _table(rows: Mapping[str, Scores], keys: tuple[str, ...]) -> dict[str, Any]:
    """Return the figures that at least one row has, and the contents of the table's cells."""
    shown = [figure for figure in FIGURES if figure.key in keys
             and any(not math.isnan(_value(row, figure.key)) for row in rows.values())]
    best = {}
    for figure in shown:
        values = [value for row in rows.values()
                  if not math.isnan(value := _value(row, figure.key))]
        if figure.key in _BEST and len(set(values)) > 1:
            best[figure.key] = _BEST[figure.key](values)
    cells = {}
    for label, row in rows.items():
        cells[label] = [{
            'text': number_text(_value(row, figure.key), figure.key),
            'deviation': number_text(deviation, figure.key) if (
                deviation := _value(row, f'{figure.key}_std')) > 0 else '',
            'best': best.get(figure.key) == _value(row, figure.key)} for figure in shown]
    return {'figures': shown, 'rows': cells}


def _mean_curves(results: Results, colors: Mapping[str, str], thresholds: Array,
                 curve: Callable[[Array, Array], Array]) -> list[Curve]:
    """Return each tracker's mean of a curve of boxes and truth, over seeds and sequences."""
    curves = []
    for label, color in colors.items():
        rows = [np.mean([curve(run.boxes, sequence.truth) for run in runs.values()], axis=0)
                for sequence in results.sequences.values()
                if (runs := results.runs(sequence.name, label))]
        curves.append(Curve(label, color, thresholds, np.mean(rows, axis=0)))
    return curves


def _sequence(results: Results, sequence: Sequence, colors: Mapping[str, str]) -> dict[str, Any]:
    by_label = {label: runs for label in colors if (runs := results.runs(sequence.name, label))}
    first = {label: next(iter(runs.values())) for label, runs in by_label.items()}
    curves = [
        Curve(label, colors[label], np.arange(len(sequence), dtype=np.float64), np.median(
            [metrics.center_errors(run.boxes, sequence.truth) for run in runs.values()], axis=0))
        for label, runs in by_label.items()]
    absent = metrics.true_runs(~metrics.present(sequence.truth))
    worst = worst_frames(first, sequence.truth)
    frames = sequence.pick(one.index for one in worst)
    return {
        'name': sequence.name, 'frames': len(sequence), 'absent': bool(absent),
        'chart': line_chart(curves, 'frame', 'centre error [px]', width=940, height=200,
                            shaded=absent),
        'worst': [_picture(one, frames[one.index], sequence, first, colors) for one in worst],
        'table': _table({label: results.by_sequence[sequence.name][label] for label in by_label},
                        _FOR_SEQUENCE)}


def _picture(worst: WorstFrame, frame: Frame, sequence: Sequence, runs: Mapping[str, Run],
             colors: Mapping[str, str]) -> dict[str, Any]:
    """Return a frame's picture, the boxes to be drawn over it and the words of its caption."""
    high, wide = frame.shape[:2]
    scale = min(1.0, 2 * _PICTURE / wide)
    small = cv2.resize(frame, (round(scale * wide), max(1, round(scale * high))),
                       interpolation=cv2.INTER_AREA)
    jpeg = cv2.imencode('.jpg', small, (cv2.IMWRITE_JPEG_QUALITY, 75))[1]
    stroke = wide / _PICTURE * 2
    boxes = []
    truth = sequence.truth[worst.index]
    if np.isfinite(truth).all():
        boxes.append({'box': truth, 'label': 'truth', 'color': '#000', 'stroke': 1.8 * stroke})
        boxes.append({'box': truth, 'label': 'truth', 'color': '#fff', 'stroke': stroke,
                      'dashed': True})
    boxes.extend({'box': run.boxes[worst.index], 'label': label, 'color': colors[label],
                  'stroke': stroke} for label, run in runs.items())
    return {'index': worst.index, 'tracker': worst.tracker, 'boxes': boxes,
            'seen': ('the target is absent' if math.isnan(worst.overlap)
                     else f'overlap {worst.overlap:.2f}'),
            'wide': wide, 'high': high, 'width': _PICTURE, 'height': round(_PICTURE * high / wide),
            'jpeg': base64.b64encode(jpeg.tobytes()).decode()}


def _value(scores: Scores, key: str) -> float:
    return scores.get(key, math.nan)
