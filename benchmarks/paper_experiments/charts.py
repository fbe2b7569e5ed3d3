"""Charts beside each other, as small SVG files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter
import numpy as np

from vtrack_ros.evaluation.charts import colour, svg

#: [x, y, standard error of y or None, ...]
Points = Sequence[Sequence[float | None]]
_STYLE = {'svg.hashsalt': 'vtrack', 'svg.fonttype': 'none', 'font.size': 9,
          'axes.spines.top': False, 'axes.spines.right': False, 'path.simplify_threshold': 0.3}


def sweep(path: Path, panels: Mapping[str, Mapping[str, Points]], x_label: str, y_label: str,
          order: Sequence[str]) -> None:
    """Draw lines with standard errors on logarithmic axes; `order` of labels gives colours."""
    with rc_context(_STYLE):
        figure, all_axes = _figure(len(panels), 2.9)
        for axes, (title, lines) in zip(all_axes, panels.items()):
            for label, points in lines.items():
                x, y, spread = (np.array([np.nan if point[i] is None else point[i]
                                          for point in points], float) for i in range(3))
                axes.errorbar(x, y, np.nan_to_num(spread), label=label,
                              color=colour(order.index(label)), marker='o',
                              markersize=3, linewidth=1.3, elinewidth=0.8)
            axes.set(title=title.replace('_', ' '), xlabel=x_label, xscale='log',
                     yscale='log')
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter(ScalarFormatter())
                axis.set_minor_formatter(NullFormatter())
            ticks = sorted({float(point[0] or 0) for points in lines.values()
                            for point in points})
            axes.set_xticks(ticks, [f'{tick:g}' for tick in ticks])
            low, high = axes.get_ylim()
            heights = [height for height in (2, 3, 5, 10, 20, 30, 40, 60) if low <= height <= high]
            axes.set_yticks(heights, [f'{height}' for height in heights])
            axes.grid(axis='y', alpha=0.4)
        _finish(path, figure, all_axes, y_label)


def by_frame(path: Path, panels: Mapping[str, Mapping[str, Sequence[Sequence[float | None]]]],
             y_label: str, shaded: tuple[float, float] | None = None) -> None:
    """Draw values by frame; panels are title -> lines, a range of frames is shaded."""
    with rc_context(_STYLE):
        figure, all_axes = _figure(len(panels), 3.4)
        for axes, (title, lines) in zip(all_axes, panels.items()):
            if shaded is not None:
                axes.axvspan(*shaded, color='#9aa4b0', alpha=0.25, linewidth=0)
            for number, (label, rows) in enumerate(lines.items()):
                y = np.array([np.nan if value is None else value
                              for row in rows for value in row], float)
                axes.plot(np.arange(len(y)), y, label=label, color=colour(number), linewidth=1.2)
            axes.set(title=title, xlabel='frame', ylim=(0, None))
            axes.grid(axis='y', alpha=0.4)
        _finish(path, figure, all_axes, y_label)


def _figure(count: int, width: float) -> tuple[Figure, list]:
    figure = Figure((max(4.6, width * count), 3.2), layout='constrained', facecolor='white')
    axes = figure.subplots(1, count, sharey=True, squeeze=False)[0]
    return figure, list(axes)


def _finish(path: Path, figure: Figure, all_axes: list, y_label: str) -> None:
    all_axes[0].set_ylabel(y_label)
    handles, labels = all_axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', frameon=False,
                  ncols=len(labels) if len(all_axes) > 1 else 2)
    path.write_text(svg(figure) + '\n', encoding='utf-8')
