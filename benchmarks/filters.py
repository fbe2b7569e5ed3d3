"""
Speed of the filters, and what sigma-point rules cost and give in four and six dimensions.

Times are medians of processor time over many steps, in one thread. They are also given as a ratio
to NumPy's product of a (150, 81, 4) array with (150, 4, 4) matrices, timed in alternation with
them: the operation that places the 81 points of the third-order product rule for 150 particles.
Set OPENBLAS_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import datetime
from pathlib import Path
import platform
import time
from typing import Any

from nonlinear_models import BearingRange, simulate
import numpy as np
from result_files import write_json
from scalar_filters import paired

from vtrack_ros.estimation import (
    ConstantVelocity, cubature, ExtendedKalmanFilter, gauss_hermite, Gaussian, GaussianFilter,
    GaussianFilterProposal, GreyProposal, KalmanFilter, ParticleFilter, PriorProposal, Proposal,
    pruned_gauss_hermite, SigmaPointFilter, unscented)
from vtrack_ros.frame import Array

PARTICLES = 150
STEPS = 60
#: Standard deviations of range and angles: nearly linear, and strongly curved.
NOISES = {'1 m, 0.01 rad': (1.0, 0.01), '0.1 m, 0.1 rad': (0.1, 0.1)}
STARTS = {2: [30.0, 20.0, 0.3, 0.2], 3: [30.0, 20.0, 10.0, 0.3, 0.2, 0.1]}
RULES: dict[str, Callable[[BearingRange], GaussianFilter]] = {
    'full product': lambda m: SigmaPointFilter(m, gauss_hermite, measured_only=False),
    'pruned': lambda m: SigmaPointFilter(m, pruned_gauss_hermite, measured_only=False),
    'position only': lambda m: SigmaPointFilter(m, gauss_hermite),
    'position only, pruned': lambda m: SigmaPointFilter(m, pruned_gauss_hermite),
    'unscented': lambda m: SigmaPointFilter(m, unscented, measured_only=False),
    'cubature': lambda m: SigmaPointFilter(m, cubature, measured_only=False),
    'cubature, position only': lambda m: SigmaPointFilter(m, cubature),
    'none (EKF)': ExtendedKalmanFilter,
}
GREY_STEPS = 200
#: Variants of the grey proposal: (proposal, weighting).
GREY: dict[str, tuple[Proposal, str]] = {
    'PF': (PriorProposal(), 'full'),
    'as printed, full': (GreyProposal(margin=None), 'full'),
    'as printed, simplified': (GreyProposal(margin=None), 'simplified'),
    'equivariant, simplified': (GreyProposal(), 'simplified'),
    'velocities from positions, simplified': (
        GreyProposal(velocities={2: 0, 3: 1}), 'simplified'),
    'and predicted spread, simplified': (
        GreyProposal(spread='predicted', velocities={2: 0, 3: 1}), 'simplified'),
    'and 30 % prior particles, simplified': (
        GreyProposal(spread='predicted', velocities={2: 0, 3: 1}, prior_share=0.3),
        'simplified'),
    'and 30 % prior particles, full': (
        GreyProposal(spread='predicted', velocities={2: 0, 3: 1}, prior_share=0.3), 'full'),
    'particles moved, simplified': (
        GreyProposal(spread='moved', velocities={2: 0, 3: 1}, prior_share=0.3), 'simplified'),
    'particles moved, full': (
        GreyProposal(spread='moved', velocities={2: 0, 3: 1}, prior_share=0.3), 'full'),
}
#: Goals for the time of a step, [ms].
BUDGETS = {'GMPF, n = 6': 0.3, 'P-QKPF, n = 4, third order': 3.0}


def main(argv: list[str] | None = None) -> int:
    """Measure, print tables in Markdown, write JSON."""
    arguments = _arguments(argv)
    results = {
        'about': {'date': datetime.date.today().isoformat(), 'python': platform.python_version(),
                  'numpy': np.__version__, 'machine': platform.machine(),
                  'runs': arguments.runs, 'seed': arguments.seed, 'steps': STEPS},
        'speed': speed(arguments.repeats), 'rules': rules(arguments),
        'grey': grey(arguments)}
    if arguments.json is not None:
        write_json(arguments.json, results)
    return 0


def speed(repeats: int) -> dict[str, dict[str, float]]:
    """Return milliseconds of a step, without likelihood, and ratios to the matrix product."""
    flat, radar = ConstantVelocity(2, 2), BearingRange(2)
    points, factors = np.ones((PARTICLES, 81, 4)), np.ones((PARTICLES, 4, 4))
    proposals: dict[str, Proposal] = {
        'PF, n = 6': PriorProposal(),
        'GMPF, n = 6': GreyProposal(),
        'GMPF with a share of prior particles, n = 6': GreyProposal(
            prior_share=0.3, spread='predicted', velocities={2: 0, 3: 1}),
        'GMPF, particles moved, n = 6': GreyProposal(
            prior_share=0.3, spread='moved', velocities={2: 0, 3: 1}),
        'KPF, n = 6': GaussianFilterProposal(KalmanFilter(flat)),
        'EPF, n = 4': GaussianFilterProposal(ExtendedKalmanFilter(radar)),
        'UPF, n = 4': GaussianFilterProposal(SigmaPointFilter(radar, unscented)),
        'QKPF, n = 4, third order, 81 points': GaussianFilterProposal(
            SigmaPointFilter(radar, gauss_hermite, measured_only=False)),
        'P-QKPF, n = 4, third order': GaussianFilterProposal(
            SigmaPointFilter(radar, pruned_gauss_hermite, measured_only=False)),
        'P-QKPF, n = 4, third order, position only': GaussianFilterProposal(
            SigmaPointFilter(radar, pruned_gauss_hermite)),
    }
    rows, entries = [['step, N = 150', 'ms', 'x matrix product', 'goal, ms']], {}
    for name, proposal in proposals.items():
        milliseconds, product = _step_time(
            flat if 'n = 6' in name else radar, proposal, lambda: points @ factors, repeats)
        entries[name] = {'milliseconds': milliseconds, 'product_milliseconds': product,
                         'ratio': milliseconds / product}
        rows.append([name, f'{milliseconds:.3f}', f'{milliseconds / product:.1f}',
                     f'{BUDGETS[name]:g}' if name in BUDGETS else ''])
    _print('speed', rows)
    return entries


def rules(arguments: argparse.Namespace) -> dict[str, dict[str, dict[str, Any]]]:
    """Return points, times and RMSE of each rule in a Kalman filter without particles."""
    results: dict[str, dict[str, dict[str, Any]]] = {}
    for positions in (2, 3):
        for noise, (metres, radians) in NOISES.items():
            covariance = np.diag([metres ** 2, radians ** 2, radians ** 2][:positions])
            model = BearingRange(positions, 0.05, covariance)
            title = f'{2 * positions}-D, {noise}'
            start = np.array(STARTS[positions])
            paths = [simulate(model, start, STEPS, np.random.default_rng([arguments.seed, i]))
                     for i in range(arguments.runs)]
            values, entries = {}, {}
            for name, make in RULES.items():
                gaussian_filter = make(model)
                values[name] = np.array([
                    _rmse(gaussian_filter, start, states, seen) for states, seen in paths])
                many = Gaussian.from_moments(
                    np.tile(start, (PARTICLES, 1)), np.eye(2 * positions))
                entries[name] = {
                    'points': len(gaussian_filter.update_rule) if isinstance(
                        gaussian_filter, SigmaPointFilter) else 0,
                    'milliseconds_of_150': _kalman_time(
                        gaussian_filter, many, paths[0][1][0], arguments.repeats),
                    'rmse_mean': float(values[name].mean()),
                    'rmse_median': float(np.median(values[name])),
                    'difference_to_full': paired(values[name], values['full product'])}
            results[title] = entries
            _print(title, _rule_rows(entries))
    return results


def grey(arguments: argparse.Namespace) -> dict[str, dict[str, float]]:
    """
    Return the errors of the grey proposal's options on the state of a video tracker.

    The state moves at nearly constant velocity; positions and sizes are measured, velocities
    aren't, as with a likelihood of pixels.
    """
    model = ConstantVelocity(2, 2, 1.0, 1.0, 4.0 * np.eye(4))
    start = np.array([300.0, 200.0, 3.0, 1.0, 40.0, 60.0])
    spread = np.diag([4.0, 4.0, 1.0, 1.0, 4.0, 4.0])
    paths = [simulate(model, start, GREY_STEPS, np.random.default_rng([arguments.seed, i]))
             for i in range(arguments.runs)]
    rows = [['proposal and weights', 'RMSE median, px', 'mean ESS', 'minus PF [95 %]']]
    entries, values = {}, {}
    for name, (proposal, weighting) in GREY.items():
        errors, samples = [], []
        for i, (states, measurements) in enumerate(paths):
            particle_filter = ParticleFilter(
                model, proposal, particles=PARTICLES, weighting=weighting, threshold=1.0,
                rng=np.random.default_rng([arguments.seed, i, 1]))
            particle_filter.start(start, spread)
            steps = [particle_filter.step(z) for z in measurements]
            means = np.array([step.mean for step in steps])
            errors.append(np.sqrt(((means - states)[:, [0, 1, 4, 5]] ** 2).mean()))
            samples.append(np.mean([step.weights.effective_sample_size for step in steps]))
        values[name] = np.array(errors)
        difference = paired(values[name], values['PF'])
        entries[name] = {'rmse_median': float(np.median(errors)),
                         'rmse_mean': float(np.mean(errors)),
                         'effective_sample_size': float(np.mean(samples)),
                         **{f'difference_to_pf_{key}': value
                            for key, value in difference.items()}}
        rows.append([name, f'{np.median(errors):.3g}', f'{np.mean(samples):.1f}',
                     f"{difference['mean']:+.2g} "
                     f"[{difference['low']:+.2g}, {difference['high']:+.2g}]"])
    _print('grey proposals on the state of a video tracker', rows)
    return entries


def _rmse(
        gaussian_filter: GaussianFilter, start: Array, states: Array,
        measurements: Array) -> float:
    """Return the root mean squared position error of one run, [m]."""
    positions = len(start) // 2
    belief = Gaussian.from_moments(start, np.eye(len(start)))
    errors = []
    for state, measurement in zip(states, measurements):
        belief = gaussian_filter.predict(belief, 1.0)
        belief = gaussian_filter.update(belief, measurement).posterior
        errors.append(((belief.mean[0] - state)[:positions] ** 2).sum())
    return float(np.sqrt(np.mean(errors)))


def _kalman_time(
        gaussian_filter: GaussianFilter, beliefs: Gaussian, measurement: Array,
        repeats: int) -> float:
    """Return the median milliseconds of prediction and update."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        gaussian_filter.update(gaussian_filter.predict(beliefs, 1.0), measurement)
        times.append(time.process_time() - began)
    return 1e3 * float(np.median(times))


def _step_time(
        model: BearingRange | ConstantVelocity, proposal: Proposal,
        product: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Return the median milliseconds of a step and of the product beside it."""
    particle_filter = ParticleFilter(
        model, proposal, particles=PARTICLES, threshold=1.0, rng=np.random.default_rng(1))
    start = np.array([30.0, 20.0, 0.3, 0.2, 5.0, 5.0][:model.state_dimension])
    particle_filter.start(start, np.eye(len(start)))
    measurement = model.measure(start[np.newaxis])[0]
    none = np.zeros(PARTICLES)
    steps, products = [], []
    for repeat in range(repeats + 10):
        began = time.process_time()
        particle_filter.weight(particle_filter.propose(measurement), none)
        middle = time.process_time()
        product()
        ended = time.process_time()
        # Without a likelihood the particles drift: reset them in every tenth step.
        if repeat % 10 == 9:
            particle_filter.set_particles(
                start + 0.5 * np.random.default_rng(repeat).standard_normal(
                    (PARTICLES, len(start))))
        if repeat >= 10:
            steps.append(middle - began)
            products.append(ended - middle)
    return 1e3 * float(np.median(steps)), 1e3 * float(np.median(products))


def _rule_rows(entries: dict[str, dict[str, Any]]) -> list[list[str]]:
    rows = [['rule, third order', 'points', 'ms for 150 filters', 'times faster', 'RMSE mean, m',
             'median', 'minus full [95 %], %']]
    full = entries['full product']
    for name, entry in entries.items():
        difference = entry['difference_to_full']
        percent = [100 * difference[key] / full['rmse_mean'] for key in ('mean', 'low', 'high')]
        rows.append([
            name, str(entry['points'] or ''), f"{entry['milliseconds_of_150']:.2f}",
            f"{full['milliseconds_of_150'] / entry['milliseconds_of_150']:.1f}",
            f"{entry['rmse_mean']:.4g}", f"{entry['rmse_median']:.4g}",
            f'{percent[0]:+.2f} [{percent[1]:+.2f}, {percent[2]:+.2f}]'])
    return rows


def _print(title: str, rows: list[list[str]]) -> None:
    head, *body = rows
    print(f'### {title}\n')
    for line in (head, ['---'] * len(head), *body):
        print('| ' + ' | '.join(line) + ' |')
    print()


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--runs', type=_positive, default=100, metavar='R',
                        help='trajectories for each model and rule (default: 100)')
    parser.add_argument('--repeats', type=_positive, default=300, metavar='K',
                        help='steps of which a time is the median (default: 300)')
    parser.add_argument('--seed', type=int, default=1, metavar='S', help='(default: 1)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there')
    return parser.parse_args(argv)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError('must be at least 1')
    return value


if __name__ == '__main__':
    raise SystemExit(main())
