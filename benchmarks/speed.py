"""
Time per frame of every tracker, beside OpenCV's CSRT and KCF on the same frames.

`scripts/peers --python benchmarks/speed.py` writes docs/results/speed.json, .md and .svg. All
trackers run in one process on one thread and take turns on short stretches of the same film, so
that other load on the machine affects all alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
import math
from pathlib import Path
import sys
import time
from typing import Any

import cv2
from matplotlib import rc_context
from matplotlib.figure import Figure
import numpy as np
from result_files import facts_text, write_json
from sequences import needed_peers_found

from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.evaluation import parse_tracker, parse_trackers, TrackerSpecification
from vtrack_ros.evaluation.charts import colour, svg
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.runner import one_thread
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box

ROOT = Path(__file__).resolve().parents[1]
BESIDE = ('opencv_csrt', 'opencv_kcf')
SIZES = ((320, 240), (640, 480), (1280, 720), (1920, 1080))
VGA = (640, 480)
TARGET = 64
TARGETS = (16, 32, 64, 128, 256)
#: Films in which the target disappears: (image size, target's side), [px].
SEARCHED = ((VGA, TARGET), (VGA, 16), ((1920, 1080), 16), ((1920, 1080), 512))
PARTICLES = (25, 50, 100, 150, 200, 400, 800)
TURN = 8
#: Number of frames after the first one in which trackers with two models update both in each; and
#: number of frames with the target in the films in which it disappears.
START = 30


@dataclass(frozen=True)
class Film:
    """Frames of a textured target that moves over a textured ground, and its true boxes."""

    frames: list[Frame]
    truth: list[Box]


def film(size: tuple[int, int], target: int, frames: int, seed: int,
         seen: int | None = None) -> Film:
    """
    Render a film.

    Parameters
    ----------
    size : tuple of int, [px]
        Width and height.
    target : int, [px]
        The target's side.
    frames : int
        Number of frames.
    seed : int
        Seed of textures and noise.
    seen : int, optional
        Number of first frames with the target; by default all.

    """
    rng = np.random.default_rng(seed)
    width, height = size
    ground = _texture(rng, height, width, (100, 115, 105), 40)
    patch = _texture(rng, target, target, (70, 90, 190), 50)
    reach = min(40.0, (width - target) / 2 - 2, (height - target) / 2 - 2)
    pictures, truth = [], []
    for index in range(frames):
        x = round((width - target) / 2 + reach * math.sin(index / 13))
        y = round((height - target) / 2 + reach * math.sin(index / 9 + 1) - reach * math.sin(1))
        y = min(max(y, 0), height - target)
        frame = ground.copy()
        if seen is None or index < seen:
            frame[y:y + target, x:x + target] = patch
        noise = rng.integers(-6, 7, (height, width, 1), dtype=np.int16)
        pictures.append(np.clip(frame + noise, 0, 255).astype(np.uint8))
        truth.append(Box(x, y, target, target))
    return Film(pictures, truth)


def timed(
        chosen: Iterable[TrackerSpecification], made: Film,
        seed: int) -> dict[str, dict[str, float]]:
    """
    Return the median processor and clock times of an update of each tracker, and its mean IoU.

    The first `START` updates have a median of their own; the 99th percentile is of all.

    Parameters
    ----------
    chosen : iterable of TrackerSpecification
        They take turns of `TURN` frames.
    made : Film
        The film that all are run on.
    seed : int
        The trackers' seed.

    """
    trackers = {one.label: one.create(seed) for one in chosen}
    cpu: dict[str, list[float]] = {label: [] for label in trackers}
    wall: dict[str, list[float]] = {label: [] for label in trackers}
    overlap: dict[str, list[float]] = {label: [] for label in trackers}
    for tracker in trackers.values():
        tracker.start(made.frames[0], made.truth[0])
    labels, rng = list(trackers), np.random.default_rng(seed)
    for begin in range(1, len(made.frames), TURN):
        # in random order: none always runs after the one that leaves the coldest caches
        for label in rng.permutation(labels).tolist():
            tracker = trackers[label]
            for index in range(begin, min(begin + TURN, len(made.frames))):
                cpu_began, began = time.process_time(), time.perf_counter()
                estimate = tracker.update(made.frames[index])
                ended, cpu_ended = time.perf_counter(), time.process_time()
                cpu[label].append(1e3 * (cpu_ended - cpu_began))
                wall[label].append(1e3 * (ended - began))
                overlap[label].append(estimate.box.iou(made.truth[index]))
    return {label: {'cpu_ms': float(np.median(cpu[label][START:])),
                    'cpu_start_ms': float(np.median(cpu[label][:START])),
                    'wall_ms': float(np.median(wall[label][START:])),
                    'wall_ms_p99': float(np.percentile(wall[label], 99)),
                    'iou': float(np.mean(overlap[label]))} for label in trackers}


def measure(chosen: list[TrackerSpecification], frames: int, seeds: int) -> dict[str, Any]:
    """Return all measurements: by image size, target size, particles, and without a target."""
    swarms = [tracker for tracker in chosen
              if 'particles' in tracker.tracker_class.PARAMETERS and not tracker.parameters]
    total = len(SIZES) + len(TARGETS) + len(SEARCHED) + 1
    bar, done = ProgressBar('films'), 0
    bar(done, total)
    images, targets, searches = {}, {}, {}
    for size in SIZES:
        images[f'{size[0]}x{size[1]}'] = _over_seeds(chosen, size, TARGET, frames, seeds)
        bar(done := done + 1, total)
    for target in TARGETS:
        targets[str(target)] = _over_seeds(chosen, VGA, target, frames, seeds)
        bar(done := done + 1, total)
    for size, target in SEARCHED:
        searches[f'{size[0]}x{size[1]}, {target} px'] = _over_seeds(
            chosen, size, target, frames, seeds, seen=START)
        bar(done := done + 1, total)
    counts: dict[str, dict[str, dict[str, float]]] = {}
    for count in PARTICLES:
        sized = [parse_tracker(f'{tracker.name}:particles={count}') for tracker in swarms
                 if _allows(tracker, count)]
        row = _over_seeds(sized, VGA, TARGET, frames, seeds)
        counts[str(count)] = {label.partition(':')[0]: cells for label, cells in row.items()}
    bar(total, total)
    return {'image': images, 'target': targets, 'particles': counts, 'search': searches}


def main(argv: list[str] | None = None) -> int:
    """Measure and write the results."""
    arguments = _arguments(argv)
    if not needed_peers_found('speed.py'):
        return 2
    chosen = parse_trackers(f'{arguments.trackers},{",".join(BESIDE)}')
    measured = measure(chosen, arguments.frames, arguments.seeds)
    content = {'environment': environment(), 'threads': 1, 'frames': arguments.frames,
               'seeds': list(range(arguments.seeds)), 'target_px': TARGET, **measured}
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_json(arguments.out / 'speed.json', _shown(content))
    page = _page(content)
    (arguments.out / 'speed.md').write_text(page, encoding='utf-8')
    _draw(content, arguments.out)
    print(page)
    return 0


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--trackers', default='all')
    parser.add_argument('--frames', type=int, default=150)
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    arguments = parser.parse_args(argv)
    if arguments.frames < START + 2:
        parser.error(f'--frames must be at least {START + 2}')
    return arguments


def _texture(
        rng: np.random.Generator, height: int, width: int, mean: tuple[int, int, int],
        contrast: float) -> Frame:
    """Return noise of several grain sizes about a colour."""
    total = np.zeros((height, width, 3), np.float32)
    for grain in (3, 8, 24):
        small = rng.standard_normal(
            (height // grain + 2, width // grain + 2, 3)).astype(np.float32)
        total += cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    picture = np.array(mean) + contrast * total / 3 ** 0.5
    result: Frame = np.clip(picture, 0, 255).astype(np.uint8)
    return result


def _over_seeds(
        chosen: list[TrackerSpecification], size: tuple[int, int], target: int, frames: int,
        seeds: int, seen: int | None = None) -> dict[str, dict[str, float]]:
    """Return the mean of each figure over seeds, and the standard deviation of the time."""
    if not chosen:
        return {}
    rounds = [timed(chosen, film(size, target, frames, seed, seen), seed)
              for seed in range(seeds)]
    result = {}
    for label in rounds[0]:
        row = {key: float(np.mean([one[label][key] for one in rounds]))
               for key in rounds[0][label]}
        spread = [one[label]['cpu_ms'] for one in rounds]
        row['cpu_ms_std'] = float(np.std(spread, ddof=1)) if seeds > 1 else 0.0
        result[label] = row
    return result


def _allows(tracker: TrackerSpecification, count: int) -> bool:
    try:
        tracker.tracker_class.PARAMETERS.checked({'particles': count})
    except ValueError:
        return False
    return True


def _shown(content: dict[str, Any]) -> dict[str, Any]:
    """Return what the page shows: all figures at VGA, elsewhere the processor time alone."""
    times = {kind: {key: {label: row['cpu_ms'] for label, row in rows.items()}
                    for key, rows in content[kind].items()}
             for kind in ('image', 'target', 'particles')}
    searches = {film: {label: {key: row[key] for key in ('cpu_ms', 'wall_ms_p99')}
                       for label, row in rows.items()}
                for film, rows in content['search'].items()}
    return {**content, **times, 'search': searches,
            'vga': content['image'][f'{VGA[0]}x{VGA[1]}']}


def _draw(content: dict[str, Any], folder: Path) -> None:
    """Write the charts speed_NAME.svg."""
    titles = {'image': ('megapixels of the image', f'time by image size, target {TARGET} px'),
              'target': ('side of the target [px]', 'time by target size, 640x480'),
              'particles': ('particles', f'time by particles, 640x480, target {TARGET} px')}
    labels = list(content['image'][f'{VGA[0]}x{VGA[1]}'])
    for name, (x_label, title) in titles.items():
        rows = content[name]
        with rc_context({'svg.hashsalt': 'vtrack', 'svg.fonttype': 'none'}):
            figure = Figure((8, 5), layout='constrained')
            axes = figure.add_subplot(xlabel=x_label, ylabel='ms per frame', title=title,
                                      yscale='log')
            for label in labels:
                points = [(_abscissa(key), row[label]['cpu_ms'])
                          for key, row in rows.items() if label in row]
                if points:
                    axes.plot(*zip(*points), label=label, color=colour(labels.index(label)))
            axes.grid(axis='y')
            figure.legend(loc='outside right upper')
            (folder / f'speed_{name}.svg').write_text(svg(figure) + '\n', encoding='utf-8')


def _abscissa(key: str) -> float:
    if 'x' in key:
        width, height = key.split('x')
        return int(width) * int(height) / 1e6
    return float(key)


def _page(content: dict[str, Any]) -> str:
    vga = content['image'][f'{VGA[0]}x{VGA[1]}']
    csrt, kcf = (vga[peer]['cpu_ms'] for peer in BESIDE)
    ratios = [['tracker', 'cpu ms', 'at start', 'ms', 'ms p99', 'fps', 'times CSRT', 'times KCF',
               'mean IoU', 'target 16 to 256 px', 'VGA to full HD']]
    small, large = (content['target'][str(target)] for target in (TARGETS[0], TARGETS[-1]))
    full, gone = content['image']['1920x1080'], content['search']
    first = next(iter(gone.values()))
    for label, row in sorted(vga.items(), key=lambda item: item[1]['cpu_ms']):
        ms = row['cpu_ms']
        ratios.append([
            label, f'{ms:.2f} ± {row["cpu_ms_std"]:.2f}', f'{row["cpu_start_ms"]:.2f}',
            f'{row["wall_ms"]:.2f}', f'{row["wall_ms_p99"]:.2f}', f'{1e3 / ms:.0f}',
            f'{csrt / ms:.1f}', f'{kcf / ms:.1f}', f'{row["iou"]:.2f}',
            f'{large[label]["cpu_ms"] / small[label]["cpu_ms"]:.2f}',
            f'{full[label]["cpu_ms"] / ms:.2f}'])
    parts = [
        '# Speed', '',
        f'Processor time of an update, median over {content["frames"] - 1 - START} frames after '
        f'the first {START}, which have a column of their own (*at start*); mean and '
        f'standard deviation over seeds {", ".join(map(str, content["seeds"]))}. One thread; all '
        'trackers run in one process and take turns on the same frames. Made by '
        f'`scripts/peers --python benchmarks/speed.py --seeds {len(content["seeds"])}`. '
        f'{facts_text(content["environment"])}.',
        '',
        f'## 640x480, target {TARGET} px', '',
        '"times CSRT" and "times KCF": frame rate divided by theirs. The last two columns are the '
        'time at the larger size divided by that at the smaller.', '',
        markdown(ratios), '',
        f'## The target gone after {START} frames', '',
        'By image size and side of the target: median processor time over the frames without the '
        'target, in which it is searched for, and 99th percentile of the wall-clock time over all '
        'frames.', '',
        markdown([['tracker', *(f'{film}: {figure}' for film in gone
                                for figure in ('cpu ms', 'ms p99'))],
                  *([label, *(f'{rows[label][key]:.2f}' for rows in gone.values()
                              for key in ('cpu_ms', 'wall_ms_p99'))]
                    for label in sorted(first, key=lambda each: first[each]['cpu_ms']))]), '']
    titles = {'image': 'Image size', 'target': 'Target size, 640x480',
              'particles': 'Particles, 640x480'}
    for name, title in titles.items():
        rows = content[name]
        labels = [label for label in vga if any(label in row for row in rows.values())]
        if not labels:
            continue
        parts += [f'## {title} [cpu ms]', '', markdown([
            ['tracker', *rows],
            *([label, *(f'{row[label]["cpu_ms"]:.2f}' if label in row else '-'
                        for row in rows.values())] for label in labels)]), '',
            f'![{title}](speed_{name}.svg)', '']
    return '\n'.join(parts)


if __name__ == '__main__':
    with one_thread():
        sys.exit(main())
