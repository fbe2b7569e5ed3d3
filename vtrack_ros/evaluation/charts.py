"""Charts as SVG elements for an HTML page, which may style their text."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from io import StringIO
import math
import re
from typing import Any
import warnings

from matplotlib import rc_context
from matplotlib.colors import hsv_to_rgb, TABLEAU_COLORS, to_hex
from matplotlib.figure import Figure

from vtrack_ros.frame import Array

_STYLE: Any = {
    'svg.fonttype': 'none', 'svg.hashsalt': 'vtrack', 'font.size': 11, 'axes.facecolor': 'none',
    # a name with two $ isn't mathematics
    'text.parse_math': False,
    'axes.spines.top': False, 'axes.spines.right': False, 'axes.edgecolor': '#808a96',
    'xtick.color': '#808a96', 'ytick.color': '#808a96', 'axes.labelcolor': '#808a96',
    'text.color': '#808a96', 'grid.color': '#9aa4b055', 'axes.axisbelow': True,
    'lines.linewidth': 1.8, 'lines.solid_joinstyle': 'round'}
#: Width of a character, [px]: a digit's in the widest usual font.
_CHARACTER = 7
#: Longest name in a chart of bars, in characters; the middle of a longer one is left out.
_LONGEST_NAME = 44


@dataclass(frozen=True)
class Curve:
    """A line of a chart; x and y have shape (n,), and a NaN in y interrupts the line."""

    label: str
    color: str
    x: Array
    y: Array


def colour(index: int) -> str:
    """Return the colour of the index-th tracker; beyond ten, hues at steps of the golden angle."""
    palette = list(TABLEAU_COLORS.values())
    if index < len(palette):
        return to_hex(palette[index])
    return to_hex(tuple(hsv_to_rgb((index * 0.382 % 1, 0.6, 0.8)).tolist()))


def line_chart(curves: Iterable[Curve], x_label: str, y_label: str, *, width: int = 460,
               height: int = 300, y_top: float | None = None,
               shaded: Iterable[tuple[float, float]] = (),
               x_ticks: Mapping[float, str] | None = None, legend: bool = False) -> str:
    """
    Return a chart of curves, `width` by `height` pixels large.

    The y axis begins at 0 and ends at `y_top`, by default above the highest value; `shaded` are
    ranges of x; `x_ticks` is x -> label of the tick. `legend` adds a legend to the chart itself.
    """
    with rc_context(_STYLE):
        figure, axes = _axes(width, height, (52, 40, 10, 8))
        for begin, end in shaded:
            axes.axvspan(begin, end, color='#9aa4b0', alpha=0.25, linewidth=1)
        for curve in curves:
            axes.plot(curve.x, curve.y, color=curve.color, clip_on=False, label=curve.label,
                      gid=f'tip:{curve.label}')
        axes.margins(x=0)
        axes.set_ylim(0, y_top)
        if x_ticks is not None:
            axes.set_xticks(list(x_ticks), list(x_ticks.values()))
        if legend:
            axes.legend(frameon=False, fontsize=9, loc='lower left')
        axes.grid(axis='y')
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        return svg(figure)


def bar_chart(rows: Mapping[str, Mapping[str, tuple[float, float]]],
              colors: Mapping[str, str], *, width: int = 940) -> str:
    """
    Return groups of horizontal bars from 0 to 1.

    `rows` is group -> label -> (value, standard deviation), `colors` label -> colour; a bar
    without a value is left out.
    """
    with rc_context(_STYLE):
        gap = 1.1
        length = sum(map(len, rows.values())) + gap * len(rows)
        names = [name if len(name) <= _LONGEST_NAME else f'{name[:21]}…{name[-22:]}'
                 for name in rows]
        left = max(120, 8 + _CHARACTER * max(map(len, names), default=0))
        figure, axes = _axes(width, round(11 * length) + 30, (left, 24, 50, 4))
        y, places = 0.0, []
        for group, bars in rows.items():
            places.append(y + (len(bars) - 1) / 2)
            for label, (value, deviation) in bars.items():
                if math.isfinite(value):
                    spread = deviation if deviation > 0 else 0.0
                    [bar] = axes.barh(y, value, 0.8, color=colors[label])
                    bar.set_gid(f'tip:{group}, {label}: {value:.3f}')
                    if spread:
                        axes.plot([value - spread, value + spread], [y, y], color='#808a96',
                                  linewidth=1.2)
                    axes.text(value + spread + 0.005, y, f'{value:.2f}', fontsize=9, va='center')
                y += 1
            y += gap
        axes.set_yticks(places, names)
        axes.tick_params(axis='y', length=0)
        axes.set_xlim(0, 1)
        axes.set_ylim(length - 0.5, -0.6)
        axes.grid(axis='x')
        return svg(figure)


def _axes(width: int, height: int, margins: tuple[int, int, int, int]) -> tuple[Figure, Any]:
    """Return a figure and its axes; `margins` are (left, below, right, above) in pixels."""
    left, below, right, above = margins
    figure = Figure((width / 72, height / 72), facecolor='none')
    axes = figure.add_axes((left / width, below / height, (width - left - right) / width,
                            (height - below - above) / height))
    return figure, axes


def svg(figure: Figure) -> str:
    """Return a figure as an SVG element; a group with the gid `tip:TEXT` has TEXT as tooltip."""
    file = StringIO()
    with warnings.catch_warnings():
        # the page's font draws the text, not the one that lacks a letter
        warnings.filterwarnings('ignore', 'Glyph .* missing from')
        figure.savefig(file, format='svg', metadata={'Date': None})
    text = file.getvalue()
    text = re.sub(r'<metadata>.*?</metadata>', '', text[text.index('<svg'):], flags=re.S)
    text = re.sub(r'(\d)pt"', r'\1"', text, count=2)
    # Tooltips are made of the `tip:` ids; all other ids of groups are removed, since those of
    # several charts in one page would not be unique.
    text = re.sub(r'<g id="tip:([^"]*)">', r'<g><title>\1</title>', text)
    return re.sub(r'\s*\n\s*', ' ', re.sub(r'<g id="[^"]*"', '<g', text))
