"""The page of results: tables between its marks, and the charts that it shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
import re
from typing import Any

from paper_experiments import charts, zhu

from vtrack_ros.evaluation.table import markdown

#: Figure -> (header of its column, format).
COLUMNS = {
    'error': ('error, px', '.2f'), 'variance': ('variance, px²', '.1f'),
    'auc': ('mean AUC', '.3f'), 'size_error': ('size error', '.0%'),
    'followed': ('followed', '.0%'), 'finished': ('finished', '.0%'),
    'before': ('on it before', '.0%'), 'hidden': ('error while hidden, px', '.1f'),
    'overlap': ('overlap while hidden', '.2f'), 'after': ('on it afterwards', '.0%'),
    'shown': ('error at the turns, px', '.1f'),
    'error_on': ('error while on it, px', '.2f'), 'kept': ('frames on it', '.0%'),
    'jerk': ('change of the error, px', '.2f'), 'frames': ('frames per run', '.1f'),
    'hit_share': ('share of search frames', '.0%'), 'ms': ('ms', '.2f'), 'cei': ('CEI', '.3f')}


def claims(result: Mapping[str, Any]) -> str:
    """Return what the paper says, what was measured, and the verdict, as a table."""
    rows = [['the paper says', 'measured', 'verdict'], ['---'] * 3, *result['claims']]
    return '\n'.join('| ' + ' | '.join(row) + ' |' for row in rows)


def tables(result: Mapping[str, Any]) -> str:
    """Return all tables of a paper, and what they were measured on."""
    parts = []
    for title, table in result['tables'].items():
        keys = [key for key in COLUMNS if any(row.get(key) is not None for row in table.values())]
        rows = [['', *(COLUMNS[key][0] for key in keys)]]
        for label, row in table.items():
            rows.append([label, *(_cell(row, key) for key in keys)])
        parts.append(f'**{title}**\n\n{markdown(rows)}\n')
    facts = ', '.join(f'{key} {value}' for key, value in result['environment'].items())
    if 'timings' in result:
        # cached times keep those of the machine that they were measured on
        facts += f", times {result['timings']}"
    return '\n'.join([*parts, f"{result['seeds']} runs, unless a table has others; {facts}.\n"])


def filled(page: str, results: Mapping[str, Any]) -> str:
    """Put tables between the page's marks, such as <!-- paper1 claims --> ... <!-- end -->."""
    makers = {'claims': claims, 'tables': tables}

    def table(match: re.Match[str]) -> str:
        paper, kind = match[1], match[2]
        if paper not in results:
            return match[0]
        text = makers[kind](results[paper]).strip()
        return f'<!-- {paper} {kind} -->\n\n{text}\n\n<!-- end -->'

    return re.sub(r'<!-- (paper\d) (claims|tables) -->.*?<!-- end -->', table, page,
                  flags=re.DOTALL)


def draw(results: Mapping[str, Any], folder: Path) -> None:
    """Write the charts papers_NAME.svg of the results that there are."""
    curves = {name: result['curves'] for name, result in results.items()}
    for scene in ('face_fast', 'football'):
        if scene in curves.get('paper1', {}):
            charts.sweep(folder / f'papers_{scene}.svg', curves['paper1'][scene],
                         'noise, in sides of the target', 'mean error, px', zhu.SWEPT)
    for scene, covered in (('similar_occlusion', (99, 135)), ('pose_change', (53, 84))):
        if scene in curves.get('paper2', {}):
            axes = curves['paper2'][scene]
            charts.by_frame(folder / f'papers_{scene}.svg', {
                f'error in {axis}, px': lines for axis, lines in axes.items()}, 'px', covered)
    for paper, scene in (('paper3', 'full_occlusion'), ('paper4', 'helicopter')):
        if scene in curves.get(paper, {}):
            covered = curves[paper].get('hidden') if paper == 'paper3' else (280, 283)
            charts.by_frame(folder / f'papers_{scene}.svg', {scene: curves[paper][scene]},
                            'mean error, px', covered)


def _cell(row: Mapping[str, Any], key: str) -> str:
    value = row.get(key)
    if value is None:
        return '-'
    spread = row.get('error_se') if key == 'error' else None
    return format(value, COLUMNS[key][1]) + ('' if spread is None else f' ± {spread:.2f}')
