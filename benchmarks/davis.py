"""
Accuracy on videos that nothing was tuned on: the twenty of the validation set of DAVIS 2016.

`[VTRACK_NANOTRACK=FOLDER] scripts/peers --python benchmarks/davis.py DAVIS` writes
docs/results/davis.md; DAVIS is the folder with JPEGImages/480p and Annotations/480p, as published
[Perazzi et al. 2016]. A true box is the bounding box of a frame's mask. If the network's files are
there (see `localisers.py`), the trackers that need them are compared too.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import sys

from clicks import clicked, OFFSETS, stepwise
import cv2
from localisers import ALONE, by_target, FOLDER, severities, SIAMESE, trackers_with_network
import numpy as np
from result_files import facts_text, interval_text
from sequences import difference, interval, needed_peers_found, ROOT

from vtrack_ros.bags import SequenceError
from vtrack_ros.bags.image_folder import image_files, read_image
from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.evaluation import evaluate, FolderSequence, parse_trackers, Results
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.stress import stressed_sequences
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS
from vtrack_ros.evaluation.table import markdown, number_text, TITLES
from vtrack_ros.frame import Array

#: The validation set of DAVIS 2016; its training set and DAVIS 2017 have other videos.
VIDEOS = (
    'blackswan', 'bmx-trees', 'breakdance', 'camel', 'car-roundabout', 'car-shadow', 'cows',
    'dance-twirl', 'dog', 'drift-chicane', 'drift-straight', 'goat', 'horsejump-high',
    'kite-surf', 'libby', 'motocross-jump', 'paragliding-launch', 'parkour', 'scooter-black',
    'soapbox')
TRACKERS = 'gmpf,pqkpf,abmspf,appf,pf,dcf,opencv_csrt,opencv_kcf'
#: Trackers that are run under stress; each is compared with the last one.
STRESSED = ('gmpf', 'pqkpf', 'abmspf', 'appf', 'pf', 'dcf')
#: Classes of target size for the table of clicks: root of the area, [image heights].
SIZES = ((0.0, 0.3), (0.3, 0.55), (0.55, 1.0))
COLUMNS = ('auc', 'precision20', 'normalised_precision', 'failures', 'auroc', 'false_alarms',
           'wrong_tracking', 'coverage90')


def main(argv: list[str] | None = None) -> int:
    """Evaluate, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('davis', type=Path, metavar='DAVIS')
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--jobs', type=int)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    arguments = parser.parse_args(argv)
    if not needed_peers_found('davis.py DAVIS'):
        return 2
    trackers = parse_trackers(TRACKERS)
    if FOLDER in os.environ:
        trackers = [*trackers, *(one for one in trackers_with_network(Path(os.environ[FOLDER]))
                                 if one.label in (SIAMESE, ALONE))]
    try:
        videos = [masked_sequence(arguments.davis, name) for name in VIDEOS]
    except SequenceError as error:
        print(error, file=sys.stderr)
        return 2
    cache = RunCache(default_folder())
    results = evaluate(
        trackers, videos, arguments.seeds, arguments.jobs, ProgressBar('runs'), cache)
    kinds = [kind for kind in STRESS_KINDS if STRESS_KINDS[kind].plan is not None]
    under = evaluate(
        parse_trackers(','.join(STRESSED)),
        stressed_sequences(videos, kinds, 0, with_content=True), [0], arguments.jobs,
        ProgressBar('stress'), cache)
    problems = [*results.problems, *under.problems]
    for problem in problems:
        print(f'failed: {problem}', file=sys.stderr)
    page = _page(results) + _stress(under, kinds) + _clicks(videos)
    (arguments.out / 'davis.md').write_text(page, encoding='utf-8')
    print(page)
    return 1 if problems else 0


def masked_sequence(davis: Path, name: str) -> FolderSequence:
    """Return a video of DAVIS whose true boxes are the bounding boxes of its masks."""
    truth = np.array([bound(read_image(path))
                      for path in image_files(davis / 'Annotations' / '480p' / name)])
    return FolderSequence(name, truth, image_files(davis / 'JPEGImages' / '480p' / name))


def bound(mask: Array) -> tuple[float, float, float, float]:
    """Return x, y, width and height of the pixels that aren't black; NaN if all are."""
    x, y, width, height = cv2.boundingRect(mask.max(axis=2))
    return (x, y, width, height) if width else (np.nan,) * 4


def _page(results: Results) -> str:
    ranked = sorted(results.summary, key=lambda label: -results.summary[label]['auc'])
    references = [label for label in ('opencv_csrt', ALONE) if label in results.summary]
    rows = [['tracker', *(TITLES[key] for key in COLUMNS),
             *(f'AUC minus {label} [95 %]' for label in references)]]
    for label in ranked:
        scores = results.summary[label]
        rows.append([label, *(number_text(scores[key], key) for key in COLUMNS),
                     *('-' if label == other else interval_text(difference(results, label, other))
                       for other in references)])
    by_video = [['video', *ranked]]
    by_video += [[name, *(f'{row[label]["auc"]:.3f}' for label in ranked)]
                 for name, row in results.by_sequence.items()]
    frames = [len(one.truth) for one in results.sequences.values()]
    return (
        '# Videos that nothing was tuned on\n\n'
        f'The validation set of DAVIS 2016 [Perazzi et al. 2016]: {len(frames)} videos of '
        f'{min(frames)} to {max(frames)} frames, 480 lines. Their targets approach, turn and '
        'change shape more than those of tracking benchmarks. A true box is the bounding box of '
        "the frame's mask, so it's wider where a person stretches out an arm. No constant of a "
        'tracker was chosen on these videos, and no decision was based on them. All frames, '
        f'{len(results.seeds)} seeds, one pass from the first true box. Made by `{FOLDER}=FOLDER '
        'scripts/peers --python benchmarks/davis.py DAVIS`; the figures are explained in '
        '[evaluate.md](../evaluate.md).'
        f'\n\n{facts_text(environment())}.\n\n'
        f'## Means over the videos\n\n{markdown(rows)}\n\nIntervals are from a bootstrap '
        "over the videos. OpenCV's trackers give no covariance.\n\n"
        f'## AUC by video\n\n{markdown(by_video)}\n')


def _stress(under: Results, kinds: list[str]) -> str:
    """Return the section on stress: the trackers' AUC, and how far it's above that of `dcf`."""
    *filters, model = STRESSED
    auc = {kind: {label: by_target([under], kind, label) for label in STRESSED} for kind in kinds}
    auc['mean'] = {label: np.mean([auc[kind][label] for kind in kinds], axis=0)
                   for label in STRESSED}
    rows = [['', *STRESSED, *(f'{label} minus {model} [95 %]' for label in filters)]]
    for kind, of_kind in auc.items():
        title = '**mean**' if kind == 'mean' else f'{kind} {severities(kind)}'
        rows.append([title, *(f'{of_kind[label].mean():.3f}' for label in STRESSED),
                     *(interval_text(interval(of_kind[label] - of_kind[model]))
                       for label in filters)])
    return (f'\n## Under stress\n\n{markdown(rows)}\n\nAUC: mean over the severities of each '
            'kind of stress (see [evaluate.md](../evaluate.md)), one seed. Intervals are from a '
            'bootstrap over the videos.\n')


def _clicks(videos: list[FolderSequence]) -> str:
    """Return the section on clicks: overlap of their boxes with the true ones, first frames."""
    ways = [(stepwise(steps), places) for steps in (0, 1, 2) for places in (((0, 0),), OFFSETS)]
    found = []
    for one in videos:
        frame = read_image(one.images[0])
        found.append((np.sqrt(one.first_box.area) / len(frame), *(
            clicked(find, frame, one.first_box, places) for find, places in ways)))
    table = np.array(found)
    rows = [['target size, image heights', 'videos', 'click at the centre', 'beside it',
             'at most one step', 'beside it', 'at most two', 'beside it']]
    for least, most in SIZES:
        those = table[(table[:, 0] >= least) & (table[:, 0] < most)]
        rows.append([f'{least:g} to {most:g}', str(len(those)),
                     *(f'{mean:.3f}' for mean in those[:, 1:].mean(axis=0))])
    rows.append(['all', str(len(table)), *(f'{mean:.3f}' for mean in table[:, 1:].mean(axis=0))])
    return (f'\n## A click instead of a box\n\n{markdown(rows)}\n\nOverlap (IoU) of the true box '
            'with the one from a click on the first frame, as in [clicks.md](clicks.md). A large '
            'target with distinct parts is taken for one of its parts: take steps to a larger '
            'extent, or draw a box there.\n')


if __name__ == '__main__':
    sys.exit(main())
