"""Charts of accuracy against stress, for a page."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from vtrack_ros.evaluation.charts import Curve, line_chart
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS
from vtrack_ros.evaluation.stress_results import APART, REFERENCE, StressResults
from vtrack_ros.evaluation.stress_table import fewer_under_stress, influence_rows
from vtrack_ros.evaluation.table import number_text


def stress_chart(stress: StressResults, kind: str, colors: Mapping[str, str], *,
                 width: int = 300, height: int = 230, legend: bool = False) -> str:
    """Return a chart of AUC against the severities of a kind; the first is `plain` (none)."""
    severities = list(stress.of_kind(kind))
    ticks = {float(place): text for place, text in enumerate(
        ['plain', *(f'{severity:g}' for severity in severities)])}
    curves = [Curve(tracker, color, np.array(list(ticks)), np.array(stress.auc(kind, tracker)))
              for tracker, color in colors.items()]
    return line_chart(curves, STRESS_KINDS[kind].unit, 'AUC', width=width, height=height,
                      y_top=1.0, x_ticks=ticks, legend=legend)


def stress_section(stress: StressResults, colors: Mapping[str, str]) -> dict[str, Any]:
    """Return the template's data for the page's section of stress."""
    head, *rows = influence_rows(stress)
    return {
        'seed': stress.seed,
        'charts': [{'name': kind, 'description': STRESS_KINDS[kind].description,
                    'chart': stress_chart(stress, kind, colors)} for kind in stress.kinds],
        'means': {tracker: number_text(stress.means[tracker], 'auc') for tracker in colors},
        'fewer': fewer_under_stress(stress),
        'reference': REFERENCE, 'apart': f'{100 * APART:.0f} %',
        'influence': {'head': head, 'rows': rows}}
