"""Results as text for a terminal."""

from collections.abc import Sequence as Ordered
import math

import numpy as np

from vtrack_ros.evaluation.results import Results, Scores
from vtrack_ros.evaluation.scoring import FIGURES

_SUMMARY = ('auc', 'precision20', 'normalised_precision', 'rmse_mean', 'failures', 'auroc',
            'losses_reported', 'report_frames', 'false_alarms', 'wrong_tracking', 'found15',
            'coverage50', 'coverage90', 'ms_median', 'ms_p99', 'cpu_ms_median', 'cei')
#: The names of the figures in tables.
TITLES = {figure.key: figure.title for figure in FIGURES}
_FRACTIONS = frozenset({
    'auc', 'precision20', 'normalised_precision', 'auroc', 'losses_reported', 'false_alarms',
    'wrong_tracking', 'coverage50', 'coverage90', 'found15', 'cei'})


def ranked(results: Results) -> dict[str, Scores]:
    """Return the summary by tracker: the best AUC first, those without one last."""
    return dict(sorted(results.summary.items(), reverse=True, key=lambda row: float(
        np.nan_to_num(row[1]['auc'], nan=-math.inf))))


def summary_table(results: Results) -> str:
    """Return the summary: one line per tracker, the best AUC first."""
    order = ranked(results)
    many = len(results.seeds) > 1
    keys = [key for key in _SUMMARY
            if any(not math.isnan(scores.get(key, math.nan)) for scores in order.values())]
    rows = [['tracker', *(TITLES[key] for key in keys)]]
    for tracker, scores in order.items():
        rows.append([tracker, *(_cell(scores, key, many and key == 'auc') for key in keys)])
    return aligned(rows)


def fewer_targets(results: Results) -> list[str]:
    """Return a line for each tracker that failed on a target where another one didn't."""
    usable = [name for name, row in results.by_sequence.items() if row]
    lines = []
    for tracker in results.summary:
        failed = [name for name in usable if not results.runs(name, tracker)]
        if failed:
            lines.append(f'{tracker}: means over {len(usable) - len(failed)} of {len(usable)} '
                         f'targets; it failed on {", ".join(failed)}')
    return lines


def sequence_table(results: Results) -> str:
    """Return the AUC of each tracker on each sequence; the last row is the mean."""
    trackers = list(results.summary)
    rows = [['AUC by sequence', *trackers]]
    for sequence, row in results.by_sequence.items():
        rows.append([sequence, *(_cell(row.get(tracker, {}), 'auc') for tracker in trackers)])
    rows.append(['mean', *(_cell(results.summary[tracker], 'auc') for tracker in trackers)])
    return aligned(rows)


def aligned(rows: Ordered[Ordered[str]]) -> str:
    """Return rows with columns aligned, the first left, others right; a rule below the header."""
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = ['  '.join(cell.ljust(width) if index == 0 else cell.rjust(width)
                       for index, (cell, width) in enumerate(zip(row, widths))).rstrip()
             for row in rows]
    lines.insert(1, '  '.join('-' * width for width in widths))
    return '\n'.join(lines)


def markdown(rows: Ordered[Ordered[str]]) -> str:
    """Return rows as a Markdown table: the first row is the header."""
    rule = ['---', *['---:'] * (len(rows[0]) - 1)]
    return '\n'.join('| ' + ' | '.join(row) + ' |' for row in [rows[0], rule, *rows[1:]])


def number_text(value: float, key: str) -> str:
    """Return a figure as text: three decimals for a share, else three digits, `-` for NaN."""
    if math.isnan(value):
        return '-'
    if key in _FRACTIONS:
        return f'{value:.3f}'
    return f'{value:.0f}' if abs(value) >= 100 else f'{value:.3g}'


def _cell(scores: Scores, key: str, spread: bool = False) -> str:
    text = number_text(scores.get(key, math.nan), key)
    return f'{text} ±{scores[key + "_std"]:.3f}' if spread and text != '-' else text
