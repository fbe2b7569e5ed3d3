"""
What the filter's velocity is worth, against two boxes' difference and against staying.

`python benchmarks/velocity.py` tracks the targets of the shared sequences and of the scenes, and
writes docs/results/velocity.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from joblib import delayed, Parallel
import numpy as np
from shared_sequences import folder_sequences, half_of, HALVES, options

from vtrack_ros.evaluation.calibration import inside_ellipse
from vtrack_ros.evaluation.metrics import on_target, overlaps
from vtrack_ros.evaluation.runner import one_thread
from vtrack_ros.evaluation.sequences import scene_sequence, Sequence
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.frame import Array
from vtrack_ros.scenes import scene_names
from vtrack_ros.session.motion_filter import MotionFilter
from vtrack_ros.trackers import create_tracker

ROOT = Path(__file__).resolve().parents[1]
#: Assumed frame rate, [Hz]: the videos don't state theirs.
RATE = 30
#: Number of frames on either side in the line fit whose slope is the true velocity.
WINDOW = 2
#: Horizons of the forecast, [frames].
AHEAD = (1, 2, 3)
FILMS = {**HALVES, 'scenes': 'rendered scenes'}


@dataclass(frozen=True)
class Record:
    """
    Mean squared errors and coverage of a run, over `frames` frames on the target, in mean sides.

    `velocity` is source -> error, [sides^2/s^2]; `growth` is that of the rate of the height as a
    share of the height, [1/s^2]. `inside` is the share of true velocities in the 90 % ellipse,
    `growth_inside` that of true rates in the 90 % interval. `forecast` and `hold` are frames ahead
    -> error of the centre, [sides^2], `inside_ahead` is the share of true centres in the ellipse.
    """

    half: str
    frames: int
    velocity: dict[str, float]
    inside: float
    growth: dict[str, float]
    growth_inside: float
    forecast: dict[int, float]
    hold: dict[int, float]
    inside_ahead: dict[int, float]


def slopes(values: Array) -> Array:
    """Return the slope of values (n, m) by least squares, per second; NaN near the ends."""
    velocity = np.full_like(values, np.nan)
    steps = np.arange(-WINDOW, WINDOW + 1)
    for index in range(WINDOW, len(values) - WINDOW):
        near = values[index - WINDOW:index + WINDOW + 1]
        velocity[index] = RATE * steps @ near / (steps @ steps)
    return velocity


def follow(tracker: str, seed: int, half: str, sequence: Sequence, frames: int) -> Record | None:
    """Track a target; None if fewer than 10 frames count."""
    truth = sequence.truth[:frames]
    count = len(truth)
    boxes, velocity = np.empty((count, 4)), np.full((count, 2), np.nan)
    rate, doubt = np.full((count, 1), np.nan), np.full((count, 1), np.nan)
    spread = np.full((count, 2, 2), np.nan)
    ahead = {step: np.full((count, 4), np.nan) for step in AHEAD}
    ahead_spread = {step: np.full((count, 2, 2), np.nan) for step in AHEAD}
    measured = np.zeros(count, bool)
    subject, motion_filter = create_tracker(tracker, seed=seed), MotionFilter()
    with one_thread():
        for index, frame in enumerate(islice(sequence.frames(), frames)):
            estimate = subject.update(frame) if index else subject.start(frame, sequence.first_box)
            motion_filter.add(estimate, round((index + 1) * 1e9 / RATE))
            boxes[index], measured[index] = estimate.box.as_array(), estimate.measured
            motion = motion_filter.motion()
            if motion is None:
                continue
            velocity[index], spread[index] = motion.velocity[:2], motion.covariance[4:6, 4:6]
            rate[index], doubt[index] = motion.velocity[3], np.sqrt(motion.covariance[7, 7])
            for step in AHEAD:
                later = motion_filter.motion(step / RATE)
                assert later is not None
                ahead[step][index] = later.box.as_array()
                ahead_spread[step][index] = later.covariance[:2, :2]
    side = np.sqrt(truth[:, 2] * truth[:, 3])
    true = slopes(truth[:, :2] + truth[:, 2:] / 2)
    true_rate, height = slopes(truth[:, 3:]), truth[:, 3]
    centers = boxes[:, :2] + boxes[:, 2:] / 2
    good = measured & on_target(overlaps(boxes, truth)) & np.isfinite(true[:, 0])
    # the filter's warm-up counts, but a difference needs two measured boxes
    good[1:] &= measured[:-1]
    good[0] = False
    if good.sum() < 10:
        return None

    def errors(filtered: Array, values: Array, wanted: Array, unit: Array) -> dict[str, float]:
        difference = np.vstack([0 * values[:1], RATE * np.diff(values, axis=0)])
        said = {'filter': filtered, 'two boxes': difference, 'zero': 0 * difference}
        return {name: float((((value - wanted)[good].T / unit[good]) ** 2).sum(axis=0).mean())
                for name, value in said.items()}

    forecast, hold, inside_ahead = {}, {}, {}
    for step in AHEAD:
        both = good[:-step] & np.isfinite(truth[step:, 0])
        later = truth[step:][both]
        sides = np.sqrt(later[:, 2] * later[:, 3])[:, np.newaxis]
        true_center = later[:, :2] + later[:, 2:] / 2
        guess = ahead[step][:-step][both]
        forecast[step], hold[step] = (
            float((((place - true_center) / sides) ** 2).sum(axis=1).mean())
            for place in (guess[:, :2] + guess[:, 2:] / 2, centers[:-step][both]))
        inside_ahead[step] = float(np.mean(inside_ellipse(
            guess, ahead_spread[step][:-step][both], later, 0.9)))
    ellipse = inside_ellipse(_points(velocity[good]), spread[good], _points(true[good]), 0.9)
    within = np.abs(rate - true_rate)[good] < 1.645 * doubt[good]
    return Record(
        half, int(good.sum()), errors(velocity, centers, true, side), float(np.mean(ellipse)),
        errors(rate, boxes[:, 3:], true_rate, height), float(np.mean(within)),
        forecast, hold, inside_ahead)


def _points(values: Array) -> Array:
    """Return boxes (n, 4) whose centres are the values (n, 2)."""
    return np.hstack([values - 0.5, np.ones_like(values)])


def root(values: list[float]) -> str:
    """Return the root of the mean of mean squares."""
    return f'{np.sqrt(np.mean(values)):.3f}'


def velocity_rows(records: list[Record]) -> list[list[str]]:
    """Return a row for each half of the videos."""
    rows = [['', 'targets', 'frames', 'filter', 'two boxes', 'zero', 'better than two boxes',
             'in the 90 % ellipse']]
    for half, title in FILMS.items():
        runs = [one for one in records if one.half == half]
        nearer = sum(one.velocity['filter'] < one.velocity['two boxes'] for one in runs)
        rows.append([title, str(len(runs)), str(sum(one.frames for one in runs)), *(
            root([one.velocity[name] for one in runs]) for name in ('filter', 'two boxes', 'zero')
        ), f'{nearer} of {len(runs)}', f'{np.mean([one.inside for one in runs]):.2f}'])
    return rows


def growth_rows(records: list[Record]) -> list[list[str]]:
    """Return a row for each half of the videos."""
    rows = [['', 'filter', 'two boxes', 'zero', 'in the 90 % interval']]
    for half, title in FILMS.items():
        runs = [one for one in records if one.half == half]
        rows.append([title, *(root([one.growth[name] for one in runs])
                              for name in ('filter', 'two boxes', 'zero')),
                     f'{np.mean([one.growth_inside for one in runs]):.2f}'])
    return rows


def forecast_rows(records: list[Record]) -> list[list[str]]:
    """Return a row for each half of the videos and number of frames."""
    rows = [['', 'frames ahead', 'forecast', 'hold', 'better than hold', 'in the 90 % ellipse']]
    for half, title in FILMS.items():
        runs = [one for one in records if one.half == half]
        for step in AHEAD:
            nearer = sum(one.forecast[step] < one.hold[step] for one in runs)
            rows.append([
                title, str(step), root([one.forecast[step] for one in runs]),
                root([one.hold[step] for one in runs]), f'{nearer} of {len(runs)}',
                f'{np.mean([one.inside_ahead[step] for one in runs]):.2f}'])
    return rows


def main() -> None:
    """Measure and write the page."""
    parser = options(__doc__)
    parser.add_argument('--tracker', default='gmpf')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results' / 'velocity.md')
    arguments = parser.parse_args()
    found, _ = folder_sequences(arguments.sequences, arguments.frames)
    targets: list[tuple[str, Sequence]] = [(half_of(one.name), one) for one in found]
    targets += [('scenes', scene_sequence(name)) for name in scene_names()]
    results = Parallel(arguments.jobs)(
        delayed(follow)(arguments.tracker, arguments.seed, half, one, arguments.frames)
        for half, one in targets)
    records = [one for one in results if one is not None]
    text = f"""# What the velocity is worth

The first {arguments.frames} frames of {len(records)} targets, `{arguments.tracker}`, seed
{arguments.seed}, {RATE} frames/s assumed; `python benchmarks/velocity.py` writes this page. Only
frames count in which the box is on the target, and in which it was measured, as in the frame
before. The unit of length is the target's mean side. Errors are root mean squares; all targets
have the same weight.

## Velocity

In sides/s. The true velocity is the slope of a straight line through the true centres of
{2 * WINDOW + 1} frames, two of them later; it has errors, as annotations by hand jitter. Compared
are the filter (topic `twist`), the difference of the two latest boxes, and no motion (*zero*).

{markdown(velocity_rows(records))}

## Growth

The rate of the height as a share of the height, in 1/s, which gives the velocity along z with
`target_height`. (A walker's true width changes with the stride, which no tracker follows.)

{markdown(growth_rows(records))}

The filter is better than the difference of two boxes, but on videos like these zero is as good.
The interval is too narrow for targets that change shape, as trackers keep the first box's aspect.

## Where the target is some frames later

Distance from the true centre, in sides: of the box moved on by the filter, as with
`predict_to_now` (*forecast*), and of the unmoved box (*hold*).

{markdown(forecast_rows(records))}
"""
    arguments.out.write_text(text, encoding='utf-8')
    print(text)


if __name__ == '__main__':
    main()
