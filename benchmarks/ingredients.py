"""
What each ingredient of a tracker is worth: its accuracy without one at a time.

`python benchmarks/ingredients.py [--seeds K]` tracks the targets of the shared sequences, plain
and under stress, and writes docs/results/ingredients.md: those on which constants were tuned, and
the others. A difference is the AUC without the ingredient minus that with all of them, as a mean
over the targets with the 95 % interval of a paired bootstrap: negative where the ingredient helps.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import math
from pathlib import Path
from typing import Any
from unittest.mock import patch

from joblib import delayed, Parallel
import numpy as np
from result_files import facts_text, interval_text
from sequences import interval
from shared_sequences import folder_sequences, half_of, HALVES, options

from vtrack_ros.appearance.image_motion import SparsePicture, TargetMotion
from vtrack_ros.estimation.forecast_mixture import ForecastMixture, STAYING
from vtrack_ros.evaluation import FolderSequence
from vtrack_ros.evaluation.metrics import overlaps, success_auc
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.runner import one_thread, run_tracker
from vtrack_ros.evaluation.stress import stressed_sequence
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.localisation import (
    global_search, guided_search, hypotheses, localiser, target_model)
from vtrack_ros.localisation.distractors import Distractors
from vtrack_ros.localisation.global_search import GlobalSearch
from vtrack_ros.localisation.guided_search import GuidedSearch
from vtrack_ros.localisation.presence import PresenceDetector
from vtrack_ros.localisation.redetection import Redetection
from vtrack_ros.trackers import create_tracker

ROOT = Path(__file__).resolve().parents[1]
KINDS = {'plain': 1.0, 'gaps': 10.0, 'jumps': 3.0, 'shake': 0.6, 'roll': 30.0, 'hidden': 30.0,
         'twin': 0.2}
ALL = 'all of them'

_search, _forecast, _update = GuidedSearch.search, GuidedSearch._forecast, Redetection.update
_step = SparsePicture.ground_step


def _without_own(self: Any, frame: Any, dt: float, own: Any = None) -> Any:
    return _search(self, frame, dt)


def _staying_or_own(self: Any, dt: float, own: Any) -> Any:
    every = _forecast(self, dt, own)
    return {name: place for name, place in every.items() if name in (STAYING, 'own')}


def _near(self: Any, later: Any, target: Any, far: bool = False) -> Any:
    return None if far else _step(self, later, target)


def _of_leader(self: Any, *values: Any, **named: Any) -> Any:
    return self._leader.estimate(*values, **named)


def _unsearched(self: Any, frame: Any, live: Any, similarity: float, peak: float, dt: float,
                search: bool, *others: Any) -> Any:
    return _update(self, frame, live, similarity, peak, dt, False, *others)


def _without_rival(self: Any, *values: Any) -> Any:
    return _update(self, *values[:-1])


#: Ingredient -> patches that leave it without effect.
WITHOUT: dict[str, Callable[[], list[Any]]] = {
    ALL: list,
    "the filter's forecast": lambda: [patch.object(GuidedSearch, 'search', _without_own)],
    'the other forecasts': lambda: [patch.object(GuidedSearch, '_forecast', _staying_or_own)],
    "the camera's motion": lambda: [
        patch.object(SparsePicture, 'camera_step', lambda self, later: None)],
    'measured jumps of the camera': lambda: [patch.object(SparsePicture, 'ground_step', _near)],
    'motion among candidates': lambda: [patch.object(
        ForecastMixture, 'log_density', lambda self, places, *_: np.zeros(len(places)))],
    'more search windows': lambda: [patch.object(guided_search, '_LOW_RESPONSE', -math.inf),
                                    patch.object(guided_search, '_LONG_GAP', math.inf)],
    'distractors': lambda: [patch.object(Distractors, 'near', lambda self, *_: [])],
    'the second model': lambda: [
        patch.object(hypotheses, '_PAUSE', math.inf),
        patch.object(hypotheses.Hypotheses, '_questionable', lambda self: False)],
    "the second model's size": lambda: [
        patch.object(hypotheses.Hypotheses, 'estimate', _of_leader)],
    'growth by optical flow': lambda: [patch.object(TargetMotion, 'growth', None)],
    'rotation by optical flow': lambda: [patch.object(TargetMotion, 'turn', None)],
    'check of jumps by optical flow': lambda: [
        patch.object(guided_search, '_FAR_FROM_EXPECTED', math.inf)],
    'lower bounds of usual response and similarity': lambda: [
        patch.object(localiser, '_FIRST_RESPONSE', 0.0),
        patch.object(localiser, '_FIRST_SIMILARITY', 0.0)],
    'no failure while surely present': lambda: [
        patch.object(PresenceDetector, 'is_sure', lambda self, *_: False)],
    "the first frame's weight in updates": lambda: [
        patch.object(target_model, '_FIRST_IN_FILTER', 0.0),
        patch.object(target_model, '_FIRST_IN_SCALE', 0.0)],
    'the global search': lambda: [
        patch.object(GlobalSearch, 'update', lambda self, *_: None)],
    'doubt of a re-detected place': lambda: [patch.object(global_search, '_CONFIRMED', 0.0)],
    'the rival': lambda: [patch.object(Redetection, 'update', _without_rival)],
    're-detection': lambda: [patch.object(Redetection, 'update', _unsearched)]}


@contextmanager
def without(ingredient: str) -> Iterator[None]:
    """Leave an ingredient out."""
    patches = WITHOUT[ingredient]()
    try:
        for one in patches:
            one.start()
        yield
    finally:
        for one in patches:
            one.stop()


def follow(tracker: str, kind: str, seed: int, sequence: FolderSequence) -> dict[str, float]:
    """Return the AUC without each ingredient."""
    stressed = stressed_sequence(sequence, kind, KINDS[kind], seed)
    frames = list(stressed.frames())
    scores = {}
    for ingredient in WITHOUT:
        with one_thread(), without(ingredient):
            run = run_tracker(create_tracker(tracker, seed=seed), frames, stressed.first_box,
                              stressed.steps)
        scores[ingredient] = success_auc(overlaps(run.boxes, stressed.truth))
    return scores


def main() -> None:
    """Measure and write the page."""
    parser = options(__doc__)
    parser.add_argument('--tracker', default='gmpf')
    parser.add_argument('--seeds', type=int, default=2)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results' / 'ingredients.md')
    arguments = parser.parse_args()
    found, _ = folder_sequences(arguments.sequences, arguments.frames)
    tasks = [(kind, seed, one) for one in found for kind in KINDS
             for seed in range(arguments.seeds)]
    every = Parallel(arguments.jobs, verbose=1)(
        delayed(follow)(arguments.tracker, kind, seed, one) for kind, seed, one in tasks)
    scores: dict[tuple[str, str], dict[str, list[dict[str, float]]]] = defaultdict(
        lambda: defaultdict(list))
    for (kind, _, one), score in zip(tasks, every):
        scores[half_of(one.name), kind][one.name].append(score)
    parts = [
        '# What each ingredient is worth\n\n'
        f'Made by `python benchmarks/ingredients.py --frames {arguments.frames} --seeds '
        f'{arguments.seeds}`: `{arguments.tracker}`, the first {arguments.frames} frames of '
        f'{len(found)} targets of the shared sequences, seeds: {arguments.seeds}. '
        'The first row is the AUC with all ingredients; the others are what is lost (-) or '
        'gained (+) without one, with the 95 % interval of a paired bootstrap over the targets. '
        'Rounding errors alone change a mean by up to .005, since a target that is lost in one '
        'run is kept in another.\n\n'
        + facts_text(environment()) + '.\n']
    for half, title in HALVES.items():
        rows = [['without', *(f'{kind} {severity:g}' if kind != 'plain' else kind
                              for kind, severity in KINDS.items())]]
        for ingredient in WITHOUT:
            row = ['nothing' if ingredient == ALL else ingredient]
            for kind in KINDS:
                runs = scores[half, kind].values()
                whole = np.array([np.mean([one[ALL] for one in each]) for each in runs])
                left = np.array([np.mean([one[ingredient] for one in each]) for each in runs])
                row.append(f'{whole.mean():.3f}' if ingredient == ALL else
                           interval_text(interval(left - whole)))
            rows.append(row)
        targets = len(scores[half, 'plain'])
        parts.append(f'## {title.capitalize()} ({targets} targets)\n\n{markdown(rows)}\n')
    text = '\n'.join(parts)
    arguments.out.write_text(text, encoding='utf-8')
    print(text)


if __name__ == '__main__':
    main()
