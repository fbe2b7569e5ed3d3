"""
Scalar models: the second paper's Table 1 and van der Merwe's figures, done again.

PF, EPF, UPF, QKPF and P-QKPF run on the same simulated trajectories, so that differences are
paired. Controls run on them too: QKPF with an inflated proposal, P-QKPF regrouped as printed, and
a particle filter with so many particles that it approximates the exact posterior.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import datetime
from pathlib import Path
import platform
from typing import Any

from nonlinear_models import UnivariateNonstationaryGrowth, VanDerMerweModel
import numpy as np
from result_files import write_json
from scalar_filters import Demonstration, filters, paired, rmse, Runs, STEPS, summary

from vtrack_ros.estimation import StateSpaceModel
from vtrack_ros.frame import Array

PARTICLES = 100
REFERENCE_PARTICLES = 10_000
DEMONSTRATION_PARTICLES = 200
STARTS = {'ung': 0.1, 'vandermerwe': 1.0}
#: RMSE mean and variance, seconds per run: Table 1 of Qi and Li (2012), N = 100; and Table 1 of
#: van der Merwe et al. (2000), N = 200, without times.
PUBLISHED: dict[str, dict[str, tuple[float, ...]]] = {
    'ung': {'pf': (0.37736, 0.08731, 3.2716), 'epf': (0.31313, 0.08089, 6.7992),
            'upf': (0.09647, 0.00760, 17.2189), 'qkpf': (0.08771, 0.00623, 17.3321),
            'pqkpf': (0.04128, 0.00461, 16.8174)},
    'vandermerwe': {'pf': (0.424, 0.053), 'epf': (0.310, 0.016), 'upf': (0.070, 0.006)},
}
VARIANCES = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
SWEPT = ('pf', 'epf', 'upf', 'qkpf', 'pqkpf_regrouped', 'reference')


def main(argv: list[str] | None = None) -> int:
    """Run the chosen experiments, print tables in Markdown, write JSON and the figures."""
    arguments = _arguments(argv)
    models: dict[str, StateSpaceModel] = {
        'ung': UnivariateNonstationaryGrowth(), 'vandermerwe': VanDerMerweModel()}
    results: dict[str, Any] = {'about': _about(arguments)}
    for name, model in models.items():
        runs = Runs(model, STARTS[name], arguments.runs, arguments.seed)
        errors, results[name] = {}, {}
        for label, make in filters(arguments.covariance).items():
            count = REFERENCE_PARTICLES if label == 'reference' else arguments.particles
            errors[label], seconds = runs.run(make, count)
            results[name][label] = {**summary(errors[label], runs.states, seconds),
                                    'particles': count}
        for label, entry in results[name].items():
            entry.update(_published(name, label))
            for other in ('pf', 'qkpf'):
                entry[f'difference_to_{other}'] = paired(
                    rmse(errors[label]), rmse(errors[other]))
        print(_table(name, results[name]), '\n')
        if arguments.figures is not None:
            _figure(arguments.figures / f'{name}.png', name, runs, errors)
    results['vandermerwe_demonstration'] = demonstration(runs)
    print(_table('vandermerwe, as demonstrated', results['vandermerwe_demonstration']), '\n')
    if arguments.sweep:
        results['sweep'] = sweep(arguments)
    if arguments.json is not None:
        write_json(arguments.json, results)
    return 0


def demonstration(runs: Runs) -> dict[str, dict[str, Any]]:
    """Run PF, EPF and UPF with the demonstration's model, with and without its floor."""
    entries: dict[str, dict[str, Any]] = {}
    for label, inflation in (('pf', 1.0), ('epf', 10.0), ('upf', 2.0)):
        make = filters('kept')[label]
        for name, floor in ((label, Demonstration.FLOOR), (f'{label}_without_floor', 0.0)):
            errors, seconds = runs.run(
                make, DEMONSTRATION_PARTICLES, Demonstration(inflation), floor)
            entries[name] = {**summary(errors, runs.states, seconds),
                             **_published('vandermerwe', name),
                             'particles': DEMONSTRATION_PARTICLES}
    return entries


def sweep(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run UNG over noise levels, and van der Merwe's model with both readings of Gamma(3, 2)."""
    settings: dict[str, tuple[StateSpaceModel, float, int]] = {
        f'ung q={q:g} r={r:g}': (UnivariateNonstationaryGrowth(q, r), STARTS['ung'], PARTICLES)
        for q in VARIANCES for r in VARIANCES}
    for rate, reading in ((2.0, 'rate 2'), (0.5, 'scale 2')):
        settings[f'vandermerwe {reading}, {DEMONSTRATION_PARTICLES} particles'] = (
            VanDerMerweModel(rate=rate), STARTS['vandermerwe'], DEMONSTRATION_PARTICLES)
    results: dict[str, Any] = {}
    for setting, (model, start, particles) in settings.items():
        runs = Runs(model, start, arguments.runs, arguments.seed)
        for covariance in ('reset', 'kept'):
            entries, values = {}, {}
            for label, make in filters(covariance).items():
                if label not in SWEPT or (label == 'reference' and covariance == 'kept'):
                    continue
                count = REFERENCE_PARTICLES if label == 'reference' else particles
                errors, seconds = runs.run(make, count)
                values[label] = rmse(errors)
                figures = summary(errors, runs.states, seconds)
                entries[label] = {key: figures[key] for key in ('rmse_mean', 'rmse_median')}
            gaps = [paired(values[worse], values[better]) for worse, better in (
                ('pf', 'epf'), ('epf', 'upf'), ('upf', 'qkpf'))]
            results[f'{setting}, {covariance}'] = {
                # Where UPF and QKPF are the same integral, they differ by rounding alone.
                **entries, 'order_as_published': all(gap['mean'] > -1e-9 for gap in gaps),
                'all_gaps_significant': all(gap['low'] > 0 for gap in gaps),
                'qkpf_to_pf': paired(values['qkpf'], values['pf'])}
    print(_sweep_table(results), '\n')
    return results


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--runs', type=_positive, default=100, metavar='R',
                        help='trajectories on which each filter runs (default: 100)')
    parser.add_argument('--particles', type=_positive, default=PARTICLES, metavar='N',
                        help=f'particles of each filter (default: {PARTICLES})')
    parser.add_argument('--covariance', choices=('reset', 'kept'), default='reset',
                        help='what the filter of each particle starts a step with: zero '
                             'covariance, or that of its last step (default: reset)')
    parser.add_argument('--seed', type=int, default=1, metavar='S', help='(default: 1)')
    parser.add_argument('--sweep', action='store_true',
                        help='also run 25 noise levels of UNG and two readings of van der '
                             "Merwe's model, with both covariances (many minutes)")
    parser.add_argument('--json', type=Path, metavar='FILE',
                        help='write the results: model -> filter -> rmse_mean, rmse_median, '
                             'rmse_var, seconds_per_run and more')
    parser.add_argument('--figures', type=Path, metavar='FOLDER',
                        help='draw ung.png and vandermerwe.png there; needs Matplotlib')
    return parser.parse_args(argv)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError('must be at least 1')
    return value


def _about(arguments: argparse.Namespace) -> dict[str, Any]:
    return {'date': datetime.date.today().isoformat(), 'python': platform.python_version(),
            'numpy': np.__version__, 'machine': platform.machine(), 'runs': arguments.runs,
            'particles': arguments.particles, 'steps': STEPS, 'seed': arguments.seed,
            'covariance': arguments.covariance}


def _published(model: str, label: str) -> dict[str, float]:
    names = ('published_rmse_mean', 'published_rmse_var', 'published_seconds')
    return dict(zip(names, PUBLISHED[model].get(label, ())))


def _table(name: str, entries: dict[str, dict[str, Any]]) -> str:
    """Return a Markdown table of one model's filters."""
    rows = [['filter', 'RMSE mean', 'median', 'variance', 'wrong mode', 'locked on', 'ms per run',
             'minus PF [95 %]', 'minus QKPF [95 %]', 'published mean / variance']]
    for label, entry in entries.items():
        published = (f"{entry['published_rmse_mean']:.3g} / {entry['published_rmse_var']:.3g}"
                     if 'published_rmse_mean' in entry else '')
        rows.append([
            label, *(format(entry[key], '.3g') for key in (
                'rmse_mean', 'rmse_median', 'rmse_var')),
            f"{entry['wrong_mode_rate']:.1%}", f"{entry['lock_on_rate']:.0%}",
            f"{1e3 * entry['seconds_per_run']:.1f}",
            *(_interval(entry.get(f'difference_to_{other}')) for other in ('pf', 'qkpf')),
            published])
    return _markdown(name, rows)


def _sweep_table(results: dict[str, Any]) -> str:
    """Return a Markdown table of medians and means over all settings."""
    rows = [['setting', *(f'{label} mean (median)' for label in SWEPT), 'published order',
             'gaps significant']]
    for setting, entry in results.items():
        cells = [f"{entry[label]['rmse_mean']:.3g} ({entry[label]['rmse_median']:.3g})"
                 if label in entry else '' for label in SWEPT]
        rows.append([setting, *cells, *('yes' if entry[key] else 'no' for key in (
            'order_as_published', 'all_gaps_significant'))])
    return _markdown('sweep', rows)


def _interval(difference: dict[str, float] | None) -> str:
    if difference is None:
        return ''
    mean, low, high = (difference[key] for key in ('mean', 'low', 'high'))
    if max(abs(low), abs(high)) < 1e-9:
        return '0'
    return f'{mean:+.3g} [{low:+.3g}, {high:+.3g}]'


def _markdown(title: str, rows: Iterable[list[str]]) -> str:
    head, *body = rows
    lines = [head, ['---'] * len(head), *body]
    return '\n'.join([f'### {title}', '', *('| ' + ' | '.join(line) + ' |' for line in lines)])


def _figure(path: Path, name: str, runs: Runs, errors: dict[str, Array]) -> None:
    """Draw the first run's estimates, and the error of all runs over time [Qi2012, figs 1, 2]."""
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
    # UPF and QKPF coincide: a dashed line shows both.
    drawn = {'pf': '-', 'epf': '-', 'upf': '-', 'qkpf': '--', 'pqkpf_regrouped': '-'}
    figure, (above, below) = pyplot.subplots(2, 1, figsize=(9, 7), sharex=True)
    times = np.arange(1, STEPS + 1)
    above.plot(times, runs.states[0], 'k', linewidth=2, label='true state')
    for label, style in drawn.items():
        above.plot(times, runs.states[0] + errors[label][0], style, linewidth=1, label=label)
        below.plot(times, np.median(np.abs(errors[label]), axis=0), style, linewidth=1,
                   label=label)
    below.plot(times, np.median(np.abs(errors['reference']), axis=0), 'k:',
               label=f'pf, {REFERENCE_PARTICLES} particles')
    above.set_ylabel('state')
    above.set_title(f'{name}: estimates of one run')
    below.set_ylabel('median absolute error')
    below.set_yscale('log')
    below.set_title(f'median over {len(runs.states)} runs (P-QKPF as printed is QKPF)')
    below.set_xlabel('step')
    for axes in (above, below):
        axes.legend(fontsize='small', ncols=3)
        axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


if __name__ == '__main__':
    raise SystemExit(main())
