"""
What a click is worth: the extent found about a point, and a tracker started on it.

`python benchmarks/clicks.py` clicks on the first frame of each shared sequence and on six later
ones, at the true box's centre and beside it, and writes docs/results/clicks.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path
import time

import numpy as np
from shared_sequences import FOLDER, is_tuned

from vtrack_ros.appearance.extent import find_extent, next_extent
from vtrack_ros.evaluation import find_sequences, Sequence
from vtrack_ros.evaluation.metrics import overlaps, success_auc
from vtrack_ros.evaluation.runner import one_thread, run_tracker
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import create_tracker

ROOT = Path(__file__).resolve().parents[1]
#: Number of first frames that `dcf` is run on.
FRAMES = 100
#: Later frames that are clicked on.
LATER = (10, 25, 40, 60, 80, 120)
#: Clicks beside the centre: offsets as shares of the true box's (width, height).
OFFSETS = ((-0.15, -0.1), (0.15, 0.1), (0.1, -0.15), (-0.1, 0.15))


#: What makes a box of a frame and a point (x, y) in it; the true box is what a user sees there.
Method = Callable[[Frame, float, float, Box], Box]


def square(side: float) -> Method:
    """Return a method that takes a square about the point; `side` is in pixels."""
    return lambda frame, x, y, truth: Box.from_center(x, y, side, side)


def stepwise(steps: int) -> Method:
    """Return the best box after at most `steps` steps to the next larger, or smaller, extent."""
    def find(frame: Frame, x: float, y: float, truth: Box) -> Box:
        first = find_extent(frame, x, y)
        boxes = [first]
        for larger in (True, False):
            box = first
            for _ in range(steps):
                try:
                    box = next_extent(frame, box, larger)
                except ValueError:
                    break
                boxes.append(box)
        return max(boxes, key=truth.iou)
    return find


METHODS: dict[str, Method] = {
    'found extent': stepwise(0),
    'and at most one step': stepwise(1),
    'and at most two steps': stepwise(2),
    '10 % of the height': lambda frame, *place: square(0.1 * frame.shape[0])(frame, *place),
    '48 px': square(48)}


def clicked(find: Method, frame: Frame, truth: Box,
            places: Iterable[tuple[float, float]]) -> float:
    """Return the mean overlap from clicks at `places`, offsets from the centre in sides."""
    x, y = truth.center
    return float(np.mean([truth.iou(find(
        frame, min(max(x + dx * truth.width, 0.0), frame.shape[1]),
        min(max(y + dy * truth.height, 0.0), frame.shape[0]), truth)) for dx, dy in places]))


def scores(sequence: Sequence, find: Method | None) -> list[float]:
    """
    Return four mean overlaps, the AUC of `dcf`, and the time to find the extent, [ms].

    Overlaps of clicks at the centre and beside it, in the first frame, then in later ones. `dcf`
    starts on the box of the click at the centre; where `find` is None, on the true box.
    """
    frames = list(islice(sequence.frames(), max(LATER) + 1))
    truth = sequence.first_box
    first, seconds, mean = truth, 0.0, [1.0] * 4
    if find is not None:
        began = time.process_time()
        first = find(frames[0], *truth.center, truth)
        seconds = time.process_time() - began
        later = [(frames[index], Box(*sequence.truth[index])) for index in LATER
                 if index < len(frames) and np.isfinite(sequence.truth[index]).all()]
        mean = [float(np.mean([clicked(find, frame, box, places) for frame, box in clicks]))
                for clicks in ([(frames[0], truth)], later) for places in (((0, 0),), OFFSETS)]
    run = run_tracker(create_tracker('dcf', seed=0), frames[:FRAMES], first)
    auc = success_auc(overlaps(run.boxes, sequence.truth[:FRAMES]))
    return [truth.iou(first), *mean[1:], auc, 1e3 * seconds]


def main() -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sequences', type=Path, default=FOLDER)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results' / 'clicks.md')
    arguments = parser.parse_args()
    sequences, _ = find_sequences(arguments.sequences)
    halves = {True: 'tuned', False: 'others'}
    rows = [['videos', 'box', 'overlap', 'median', 'above 0.5', 'click beside', 'later frames',
             'beside, later', 'AUC of `dcf`']]
    of_each = [['target', 'tuned', *METHODS]]
    found: dict[str, dict[str, list[float]]] = {one.name: {} for one in sequences}
    with one_thread():
        for one in sequences:
            for name, find in (*METHODS.items(), ('true box', None)):
                found[one.name][name] = scores(one, find)
            tuned = is_tuned(one.name)
            of_each.append([one.name, 'yes' if tuned else '', *(
                f'{found[one.name][name][0]:.2f}' for name in METHODS)])
    for half, title in halves.items():
        names = [name for name in found if is_tuned(name) is half]
        for method in (*METHODS, 'true box'):
            table = np.array([found[name][method] for name in names])
            mean = table.mean(axis=0)
            rows.append([f'{len(names)} {title}', method, f'{mean[0]:.3f}',
                         f'{np.median(table[:, 0]):.3f}', f'{np.mean(table[:, 0] > 0.5):.2f}',
                         *(f'{value:.3f}' if method in METHODS else '-' for value in mean[1:4]),
                         f'{mean[4]:.3f}'])
    times = [found[name]['found extent'][5] for name in found]
    text = (
        '# A click instead of a box\n\n'
        'Made by `python benchmarks/clicks.py` on each target of the shared sequences. '
        '*overlap*: IoU of the true box with the one from a click at its centre, in the first '
        'frame. *click beside*: mean overlap from four clicks up to 0.15 sides beside the centre. '
        '*later frames* and *beside, later*: the same in frames '
        f'{", ".join(map(str, LATER))}. Last column: AUC of `dcf` over the first {FRAMES} '
        'frames, started on the box from the click at the centre in the first frame; one seed. '
        'The weights in `appearance/extent.py` were fitted on the tuned videos.\n\n'
        f'{markdown(rows)}\n\n'
        f'Finding an extent takes {np.median(times):.0f} ms on one core (median; maximum '
        f'{np.max(times):.0f} ms), once per click.\n\n'
        '## Overlap by target, from a click at the centre\n\n'
        f'{markdown(of_each)}\n\n'
        'A click beside the centre gives a worse box: the candidates are centred at the click, '
        'and the result moves only half-way from the best one to the region segmented about it. '
        'The box of a small target among others (`UAVDT_S0601`, `UAV_building5`) covers its '
        'surroundings too; that of a target with large distinct parts covers only one of them. '
        'There, take steps to a larger or a smaller extent (`~/larger`, `~/smaller`; *and at most '
        'one step* and *two steps* are the best of the boxes that the user sees then), set '
        '`click_size` or draw a box.\n')
    arguments.out.write_text(text, encoding='utf-8')
    print(text)


if __name__ == '__main__':
    main()
