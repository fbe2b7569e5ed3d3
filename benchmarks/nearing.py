"""
What becomes of the box when the camera comes near its target, or goes away from it.

`scripts/peers --python benchmarks/nearing.py` draws films and writes docs/results/nearing.md.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
import sys

import cv2
from joblib import delayed, Parallel
import numpy as np
from result_files import facts_text
from sequences import needed_peers_found

from vtrack_ros.evaluation.metrics import overlaps
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.runner import one_thread, run_tracker
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import create_tracker

ROOT = Path(__file__).resolve().parents[1]
WIDTH, HEIGHT = 640, 480
#: Size of the drawn world, and the target's side in its middle, at full resolution, [px].
WORLD, TARGET = (2560, 1920), 336
#: Films: (target's side in the first frame and in the last one, [px]; number of frames).
FILMS = ((24, 336, 300), (336, 24, 300), (24, 240, 100), (24, 240, 25), (60, 120, 300))
#: Number of last frames whose mean overlap is also given alone.
LAST = 10


@dataclass(frozen=True)
class Film:
    """Frames, and the target's true boxes, shape (n, 4)."""

    frames: list[Frame]
    truth: Array


def film(first: float, last: float, count: int, seed: int) -> Film:
    """Draw a film: the camera approaches or recedes by a constant factor a frame, and sways."""
    rng = np.random.default_rng(seed)
    world = _texture(rng, *WORLD, (100, 115, 105), 40)
    left, top = ((side - TARGET) // 2 for side in WORLD)
    world[top:top + TARGET, left:left + TARGET] = _texture(rng, TARGET, TARGET, (70, 90, 190), 50)
    # OpenCV samples without anti-aliasing: small scales are sampled from a Gaussian pyramid
    levels = [world]
    while len(levels) < 5:
        levels.append(cv2.pyrDown(levels[-1]))
    frames, truth = [], []
    for index, scale in enumerate(np.geomspace(first, last, count) / TARGET):
        level = max(0, int(np.log2(1 / scale)))
        factor = 2**level * scale
        x = WIDTH / 2 + 10 * np.sin(index / 9) - scale * WORLD[0] / 2
        y = HEIGHT / 2 + 8 * np.cos(index / 7) - scale * WORLD[1] / 2
        seen = cv2.warpAffine(levels[level], np.array([[factor, 0, x], [0, factor, y]]),
                              (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
        noise = rng.integers(-6, 7, (HEIGHT, WIDTH, 1), dtype=np.int16)
        frames.append(np.clip(seen + noise, 0, 255).astype(np.uint8))
        # OpenCV maps the centres of pixels: their edges, at which boxes end, are half a pixel off
        edge = (1 - scale) / 2
        truth.append((x + scale * left + edge, y + scale * top + edge,
                      scale * TARGET, scale * TARGET))
    return Film(frames, np.array(truth))


def followed(tracker: str, first: int, last: int, count: int, seed: int) -> Array:
    """Return the overlap in each frame of a film."""
    made = film(first, last, count, seed)
    with one_thread():
        run = run_tracker(create_tracker(tracker, seed=seed), made.frames, Box(*made.truth[0]))
    found: Array = overlaps(run.boxes, made.truth)
    return found


def _texture(rng: np.random.Generator, width: int, height: int, mean: tuple[int, int, int],
             contrast: float) -> Frame:
    """Return noise of several grain sizes about a colour, visible from near and from far."""
    total = np.zeros((height, width, 3), np.float32)
    for grain in (4, 16, 64):
        small = rng.standard_normal((height // grain + 2, width // grain + 2, 3), np.float32)
        total += cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    picture: Frame = np.clip(mean + contrast * total / 3**0.5, 0, 255).astype(np.uint8)
    return picture


def main() -> int:
    """Track the target in all films, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--trackers',
                        default='gmpf,pqkpf,abmspf,appf,pf,dcf,opencv_csrt,opencv_kcf')
    arguments = parser.parse_args()
    trackers = arguments.trackers.split(',')
    if any(one.startswith('opencv') for one in trackers) and not needed_peers_found('nearing.py'):
        return 2
    table = [['tracker', *(f'{first} to {last} px, {count} frames'
                           for first, last, count in FILMS)]]
    for tracker in trackers:
        runs = iter(Parallel(arguments.jobs)(
            delayed(followed)(tracker, *each, seed)
            for each in FILMS for seed in range(arguments.seeds)))
        row = [tracker]
        for _ in FILMS:
            every = np.array([next(runs)[1:] for _ in range(arguments.seeds)])
            row.append(f'{every.mean():.2f}, {every[:, -LAST:].mean():.2f}')
        table.append(row)
        print(*row, flush=True)
    text = f"""# When the target comes near, or goes away

In drawn films of {WIDTH}x{HEIGHT} pixels the camera approaches its target, or moves away from it,
by the same factor in each frame. The header gives the target's side in the first and last frame.
Each cell is the mean overlap of all frames, then that of the last {LAST}; both are means over
{arguments.seeds} films with different textures. The only constants chosen on these films are the
bounds of the size, a twentieth and twenty times the first one. Where the camera sees beyond the
drawn world, that is mirrored: below 46 px of the target, mirrored copies of it are in view.

{facts_text(environment())}

{markdown(table)}
"""
    (ROOT / 'docs' / 'results' / 'nearing.md').write_text(text, encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
