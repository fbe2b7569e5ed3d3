"""Results as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.evaluation import metrics
from vtrack_ros.evaluation.charts import bar_chart, colour, Curve, line_chart, thinned
from vtrack_ros.evaluation.environment import environment
from vtrack_ros.evaluation.moments import moment_figure, worst_moments
from vtrack_ros.evaluation.report_style import STYLE
from vtrack_ros.evaluation.results import Results, Scores
from vtrack_ros.evaluation.running import Run
from vtrack_ros.evaluation.scoring import FIGURES
from vtrack_ros.evaluation.sequences import Sequence
from vtrack_ros.evaluation.table import number_text, ranked

#: What is better for a figure: its largest value or its smallest; the others aren't compared.
_BEST = {'auc': max, 'precision20': max, 'normalised_precision': max, 'auroc': max,
         'losses_reported': max, 'found15': max, 'rmse_mean': min, 'rmse_var': min,
         'failures': min, 'recovery_frames': min, 'report_frames': min, 'false_alarms': min,
         'wrong_tracking': min, 'ms_median': min, 'ms_p99': min, 'cpu_ms_median': min, 'cei': min}

_QUESTIONS = {
    'Where is it?': ('auc', 'precision20', 'normalised_precision', 'rmse_mean', 'rmse_var',
                     'failures', 'recovery_frames'),
    'Does it know?': ('auroc', 'losses', 'losses_reported', 'report_frames', 'false_alarms',
                      'wrong_tracking', 'returns', 'found15', 'coverage50', 'coverage90'),
    'What does it cost?': ('ms_median', 'ms_p99', 'cpu_ms_median', 'cei'),
}
_FOR_SEQUENCE = ('auc', 'precision20', 'rmse_mean', 'failures', 'auroc', 'report_frames',
                 'false_alarms', 'wrong_tracking', 'found15', 'coverage90', 'ms_median')


def write_html(results: Results, path: Path) -> None:
    """Write the page to a file."""
    path.write_text(html_page(results), encoding='utf-8')


def html_page(results: Results) -> str:
    """Return the page; it refers to nothing outside itself."""
    rows = ranked(results)
    colors = {label: colour(index) for index, label in enumerate(rows)}
    body = [_head(results)]
    if results.problems:
        lines = ''.join(f'<li>{escape(str(problem))}</li>' for problem in results.problems)
        body.append(f'<section class="problems"><h2>Skipped</h2><ul>{lines}</ul></section>')
    if rows:
        tables = (f'<h3>{escape(question)}</h3>' + _figures_table(rows, colors, keys)
                  for question, keys in _QUESTIONS.items())
        body += [
            '<section><h2>Summary</h2>', *tables, '</section>',
            _plots(results, colors), _bars(results, colors),
            '<section><h2>Sequence by sequence</h2>',
            *(_sequence_part(results, sequence, colors)
              for sequence in results.sequences.values()), '</section>']
    body.append(_legend_of_figures())
    return ('<!doctype html><html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<title>Tracker evaluation</title><style>{STYLE}</style></head><body><main>'
            + '\n'.join(body) + '</main></body></html>\n')


def _head(results: Results) -> str:
    facts = environment()
    seeds = ', '.join(map(str, results.seeds))
    return (
        '<header><h1>Tracker evaluation</h1><p>'
        f'{len(results.sequences)} targets, {len(results.variants)} trackers, seeds {seeds}; '
        f'one pass, one thread; times {escape(results.timings)}.</p><p class="quiet">'
        + ' · '.join(f'{escape(key)} {escape(str(value))}' for key, value in facts.items())
        + '</p></header>')


def _figures_table(
        rows: dict[str, Scores], colors: dict[str, str], keys: tuple[str, ...]) -> str:
    shown = [figure for figure in FIGURES if figure.key in keys
             and any(not math.isnan(_value(row, figure.key)) for row in rows.values())]
    head = ''.join(f'<th title="{escape(figure.description)}">{escape(figure.title)}</th>'
                   for figure in shown)
    best = {}
    for figure in shown:
        values = [_value(row, figure.key) for row in rows.values()]
        values = [value for value in values if not math.isnan(value)]
        if figure.key in _BEST and len(set(values)) > 1:
            best[figure.key] = _BEST[figure.key](values)
    lines = []
    for label, row in rows.items():
        cells = []
        for figure in shown:
            value, deviation = _value(row, figure.key), _value(row, f'{figure.key}_std')
            text = number_text(value, figure.key)
            if deviation > 0:
                text += f'<small> ±{number_text(deviation, figure.key)}</small>'
            mark = ' class="best"' if best.get(figure.key) == value else ''
            cells.append(f'<td{mark}>{text}</td>')
        lines.append(f'<tr><th>{_swatch(colors[label])}{escape(label)}</th>{"".join(cells)}</tr>')
    return (f'<div class="wide"><table><thead><tr><th>tracker</th>{head}</tr></thead>'
            f'<tbody>{"".join(lines)}</tbody></table></div>')


def _plots(results: Results, colors: dict[str, str]) -> str:
    success = _mean_curves(results, colors, metrics.OVERLAP_THRESHOLDS, _success)
    precision = _mean_curves(results, colors, metrics.PRECISION_THRESHOLDS, _precision)
    return (
        '<section><h2>Success and precision</h2>' + _legend(results, colors, 'auc')
        + '<div class="row"><figure>'
        + line_chart(success, 'overlap threshold', 'share of frames above it', y_top=1.0)
        + '<figcaption>success, mean over targets and seeds</figcaption></figure><figure>'
        + line_chart(precision, 'centre error threshold [px]', 'share of frames within it',
                     y_top=1.0)
        + '<figcaption>precision, mean over targets and seeds</figcaption></figure></div>'
        '</section>')


def _mean_curves(
        results: Results, colors: dict[str, str], thresholds: NDArray[np.float64],
        curve: Callable[[Run, Sequence], NDArray[np.float64]]) -> list[Curve]:
    curves = []
    for label, color in colors.items():
        rows = [np.mean([curve(run, sequence) for run in runs.values()], axis=0)
                for sequence in results.sequences.values()
                if (runs := results.runs(sequence.name, label))]
        curves.append(Curve(label, color, thresholds, np.mean(rows, axis=0)))
    return curves


def _success(run: Run, sequence: Sequence) -> NDArray[np.float64]:
    return metrics.success_curve(metrics.overlaps(run.boxes, sequence.truth))


def _precision(run: Run, sequence: Sequence) -> NDArray[np.float64]:
    return metrics.precision_curve(metrics.center_errors(run.boxes, sequence.truth))


def _bars(results: Results, colors: dict[str, str]) -> str:
    rows = {name: {label: (_value(row[label], 'auc'), _value(row[label], 'auc_std'))
                   for label in colors if label in row}
            for name, row in results.by_sequence.items()}
    return ('<section><h2>AUC by sequence</h2>' + _legend(results, colors, 'auc')
            + bar_chart({name: row for name, row in rows.items() if row}, colors) + '</section>')


def _sequence_part(results: Results, sequence: Sequence, colors: dict[str, str]) -> str:
    by_label = {label: runs for label in colors if (runs := results.runs(sequence.name, label))}
    if not by_label:
        return ''
    first = {label: next(iter(runs.values())) for label, runs in by_label.items()}
    frames = np.arange(len(sequence), dtype=np.float64)
    curves = []
    for label, runs in by_label.items():
        errors = np.array([metrics.center_errors(run.boxes, sequence.truth)
                           for run in runs.values()])
        curves.append(Curve(label, colors[label], *thinned(frames, np.median(errors, axis=0))))
    moments = worst_moments(first, sequence.truth)
    pictures = sequence.pick(moment.index for moment in moments)
    figures = ''.join(
        moment_figure(moment, pictures[moment.index], sequence, first, colors)
        for moment in moments)
    scores = {label: results.by_sequence[sequence.name][label] for label in by_label}
    absent = metrics.stretches(~metrics.present(sequence.truth))
    note = '; shaded where the target is absent' if absent else ''
    return (
        f'<details open><summary>{escape(sequence.name)} <span class="quiet">'
        f'{len(sequence)} frames</span></summary>'
        '<figure>' + line_chart(curves, 'frame', 'centre error [px]', width=940, height=200,
                                shaded=absent)
        + f'<figcaption>centre error, median over seeds{note}</figcaption></figure>'
        f'<div class="row">{figures}</div>'
        '<p class="quiet">The worst moments, with the boxes of the first seed; '
        'white and dashed: the truth.</p>'
        + _figures_table(scores, colors, _FOR_SEQUENCE) + '</details>')


def _legend(results: Results, colors: dict[str, str], key: str) -> str:
    return '<p class="legend">' + ''.join(
        f'<span>{_swatch(color)}{escape(label)} '
        f'<b>{number_text(_value(results.summary[label], key), key)}</b></span>'
        for label, color in colors.items()) + '</p>'


def _legend_of_figures() -> str:
    rows = ''.join(f'<dt>{escape(figure.title)}</dt><dd>{escape(figure.description)}</dd>'
                   for figure in FIGURES)
    return (f'<section><h2>What the figures say</h2><dl>{rows}</dl><p>Every figure is a mean over '
            'seeds, ± their standard deviation; in the summary a mean over the targets too, but '
            'for AUROC: it is of all frames together.</p></section>')


def _swatch(color: str) -> str:
    return f'<i style="background:{color}"></i>'


def _value(scores: Scores, key: str) -> float:
    return scores.get(key, math.nan)
