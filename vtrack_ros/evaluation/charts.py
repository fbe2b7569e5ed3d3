"""Charts as inline SVG, coloured by the page's style sheet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence as Ordered
from dataclasses import dataclass
from html import escape
import math

import numpy as np
from numpy.typing import NDArray

_PALETTE = (
    '#1f77b4', '#e6762b', '#2ca02c', '#d62728', '#9467bd', '#a0715e', '#e377c2', '#7f8c8d',
    '#b5b521', '#17becf')

_STYLE = (
    'text{fill:#4a5560;font:12px sans-serif}.title{fill:#1c2128;font:600 14px sans-serif}'
    '.small{font-size:10px}.grid{stroke:#dfe3e8;fill:none}.axis{stroke:#66707c;fill:none}'
    '.line{fill:none;stroke-width:1.8}.whisker{stroke:#1c2128;fill:none}.shade{fill:#9aa4b033}')


def colour(index: int) -> str:
    """Return the colour of the index-th tracker; beyond ten by the golden angle."""
    if index < len(_PALETTE):
        return _PALETTE[index]
    return f'hsl({index * 137.5 % 360:.0f} 60% 50%)'


@dataclass(frozen=True)
class Curve:
    """
    A line of a chart.

    Parameters
    ----------
    label : str
    color : str
    x, y : ndarray, shape (n,)
        NaN in y breaks the line.

    """

    label: str
    color: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]


def line_chart(
        curves: Ordered[Curve], x_label: str, y_label: str, *, width: int = 460,
        height: int = 300, y_top: float | None = None, logarithmic: bool = False,
        shaded: Ordered[tuple[float, float]] = ()) -> str:
    """
    Return a chart of curves.

    Parameters
    ----------
    curves : sequence of Curve
        At least one.
    x_label, y_label : str
        What the axes are.
    width, height : int, [px]
        The size of the picture.
    y_top : float, optional
        Where the y axis ends; by default at the highest value.
    logarithmic : bool
        Whether the y axis is, beginning at the power of ten below the lowest value; else it
        begins at 0.
    shaded : sequence of (float, float)
        Ranges of x to be shaded.

    """
    left, right, top, bottom = 46, 10, 8, 36
    x_low = min(float(curve.x[0]) for curve in curves)
    x_high = max(float(curve.x[-1]) for curve in curves)
    values = np.concatenate([curve.y[np.isfinite(curve.y)] for curve in curves])
    y_high = y_top or float(values.max(initial=0.0)) or 1.0
    x_scale = (width - left - right) / ((x_high - x_low) or 1.0)
    if logarithmic:
        floor = math.floor(math.log10(values[values > 0].min(initial=y_high)))
        y_high = y_top or 10.0 ** math.ceil(math.log10(y_high))
        levels = [10.0 ** power for power in range(floor, math.ceil(math.log10(y_high)) + 1)]
        y_scale = (height - top - bottom) / max(1e-9, math.log10(y_high) - floor)
    else:
        levels = ticks(0, y_high)
        y_scale = (height - top - bottom) / y_high

    def at(x: float, y: float) -> tuple[float, float]:
        y = min(y, y_high)
        rise = math.log10(max(y, 10.0 ** floor)) - floor if logarithmic else y
        return left + (x - x_low) * x_scale, height - bottom - rise * y_scale

    parts = [_open(width, height, f'{y_label} by {x_label}')]
    for begin, end in shaded:
        x0, x1 = at(begin, 0)[0], at(end, 0)[0]
        parts.append(f'<rect class="shade" x="{x0:.1f}" y="{top}" '
                     f'width="{max(1.0, x1 - x0):.1f}" height="{height - top - bottom}"/>')
    for value in levels:
        y = at(x_low, value)[1]
        parts.append(f'<path class="grid" d="M{left} {y:.1f}H{width - right}"/>'
                     f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    for value in ticks(x_low, x_high):
        x = at(value, 0)[0]
        parts.append(f'<text x="{x:.1f}" y="{height - bottom + 16}" text-anchor="middle">'
                     f'{value:g}</text>')
    parts.append(f'<path class="axis" d="M{left} {top}V{height - bottom}H{width - right}"/>')
    middle = (left + width - right) / 2
    parts.append(f'<text x="{middle:.0f}" y="{height - 4}" text-anchor="middle">'
                 f'{escape(x_label)}</text>')
    parts.append(f'<text transform="translate(12 {(top + height - bottom) / 2:.0f}) rotate(-90)" '
                 f'text-anchor="middle">{escape(y_label)}</text>')
    for curve in curves:
        parts.append(f'<path class="line" stroke="{curve.color}" d="{_path(curve, at)}">'
                     f'<title>{escape(curve.label)}</title></path>')
    return ''.join(parts) + '</svg>'


def bar_chart(
        rows: Mapping[str, Mapping[str, tuple[float, float]]],
        colors: Mapping[str, str], *, width: int = 940) -> str:
    """
    Return groups of horizontal bars from 0 to 1.

    Parameters
    ----------
    rows : mapping
        Group -> label -> (value, standard deviation).
    colors : mapping
        Label -> colour.
    width : int, [px]
        The width of the picture.

    """
    left, right, thick, gap = 120, 60, 11, 12
    scale = width - left - right
    parts = []
    y = 4.0
    for group, bars in rows.items():
        center = y + thick * len(bars) / 2 + 4
        parts.append(f'<text x="{left - 8}" y="{center:.1f}" text-anchor="end">'
                     f'{escape(group)}</text>')
        for label, (value, deviation) in bars.items():
            if math.isnan(value):
                y += thick
                continue
            end = left + scale * value
            spread = scale * (0.0 if math.isnan(deviation) else deviation)
            parts.append(
                f'<rect fill="{colors[label]}" x="{left}" y="{y:.1f}" '
                f'width="{max(1.0, scale * value):.1f}" height="{thick - 2}">'
                f'<title>{escape(group)}, {escape(label)}: {value:.3f}</title></rect>')
            if spread:
                parts.append(f'<path class="whisker" d="M{end - spread:.1f} '
                             f'{y + thick / 2 - 1:.1f}H{end + spread:.1f}"/>')
            parts.append(f'<text class="small" x="{end + spread + 4:.1f}" '
                         f'y="{y + thick - 3:.1f}">{value:.2f}</text>')
            y += thick
        y += gap
    height = round(y)
    frame = [_open(width, height + 16, 'bars by sequence')]
    for value in ticks(0, 1):
        x = left + scale * value
        frame.append(f'<path class="grid" d="M{x:.1f} 0V{height - gap / 2:.0f}"/>'
                     f'<text x="{x:.1f}" y="{height + 10}" text-anchor="middle">{value:g}</text>')
    return ''.join(frame + parts) + '</svg>'


def standalone(chart: str, legend: Mapping[str, str], title: str) -> str:
    """
    Return a chart as an SVG file of its own.

    Parameters
    ----------
    chart : str
        As one of the functions above returned it.
    legend : mapping
        Label -> colour.
    title : str
        What stands above.

    """
    opening, _, content = chart.partition('>')
    size = opening.split('viewBox="')[1].split('"')[0].split()
    width, height = int(size[2]), int(size[3])
    columns = max(1, width // 150)
    lines = -(-len(legend) // columns)
    entries = ''.join(
        f'<g transform="translate({12 + 150 * (index % columns)} '
        f'{height + 40 + 18 * (index // columns)})"><rect width="11" height="11" rx="3" '
        f'fill="{color}"/><text x="17" y="10">{escape(label)}</text></g>'
        for index, (label, color) in enumerate(legend.items()))
    total = height + 50 + 18 * lines
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {total}" '
            f'width="{width}" height="{total}"><style>{_STYLE}</style>'
            f'<rect width="{width}" height="{total}" fill="#fff"/>'
            f'<text x="12" y="18" class="title">{escape(title)}</text>'
            f'<g transform="translate(0 26)">{content.removesuffix("</svg>")}</g>'
            f'{entries}</svg>\n')


def ticks(low: float, high: float) -> list[float]:
    """Return about five round numbers between two."""
    span = high - low
    if not (math.isfinite(span) and span > 0):
        return [low]
    power = 10.0 ** math.floor(math.log10(span / 5))
    step = next((power * factor for factor in (1, 2, 5) if span / (power * factor) <= 6),
                power * 10)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(number * step, 10) for number in range(first, last + 1)]


def thinned(
        x: NDArray[np.float64], y: NDArray[np.float64],
        points: int = 300) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a curve in fewer points: of each run of neighbours the highest one stays."""
    if len(x) <= points:
        return x, y
    kept = []
    for chunk in np.array_split(np.arange(len(x)), points):
        values = y[chunk]
        kept.append(chunk[0] if np.isnan(values).all() else chunk[int(np.nanargmax(values))])
    return x[kept], y[kept]


def _open(width: int, height: int, title: str) -> str:
    return (f'<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" '
            f'aria-label="{escape(title)}">')


def _path(curve: Curve, at: Callable[[float, float], tuple[float, float]]) -> str:
    steps = []
    drawing = False
    for x, y in zip(curve.x, curve.y):
        if not math.isfinite(y):
            drawing = False
            continue
        px, py = at(float(x), float(y))
        steps.append(f'{"L" if drawing else "M"}{px:.1f} {py:.1f}')
        drawing = True
    return ''.join(steps)
