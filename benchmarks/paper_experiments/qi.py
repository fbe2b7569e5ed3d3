"""Qi and Li 2012, P-QKPF: a walker covered by somebody dressed alike, and a face that turns."""

from __future__ import annotations

import numpy as np
from paper_experiments.films import Laboratory, Outcome, Trackers
from paper_experiments.outcomes import (
    errors, Experiment, Figures, figures, listed, mean_by_frame, ratio, share)

from vtrack_ros.evaluation import metrics

#: Films of each scene; the runs take them in turn.
FILMS = 3
_ALL = 'particles=100,kernel=epanechnikov'
COLOUR, CUES = 'PF, colour', 'PF, both cues, eqs 16-19'
LETTER, PRINTED = 'P-QKPF, eqs 16-19', 'P-QKPF as printed'
OURS = 'P-QKPF, our reading'
#: Trackers by name; `run` adds the dynamics.
TRACKERS: Trackers = {
    COLOUR: f'pf_paper:{_ALL}',
    CUES: f'pf_paper:cues=colour+motion_edge,fusion=normalised,{_ALL}',
    LETTER: f'pqkpf_paper:fusion=normalised,{_ALL}',
    PRINTED: f'pqkpf_paper:as_printed=true,{_ALL}',
    OURS: f'pqkpf_paper:{_ALL}',
}
#: Frames after the occlusion, where its outcome is judged; frames in which the face is turned.
_AFTER, _TURNED = np.s_[136:], np.s_[53:85]


def run(laboratory: Laboratory) -> Experiment:
    """Run both scenes with white acceleration, and some of the trackers with a random walk."""
    result = Experiment()
    walk = {label: TRACKERS[label] + ',dynamics=random_walk'
            for label in (COLOUR, CUES, LETTER, PRINTED)}
    for dynamics, trackers in (('white acceleration', TRACKERS), ('random walk', walk)):
        for scene, judge in (('similar_occlusion', _occlusion), ('pose_change', _turn)):
            outcomes = laboratory.measure(laboratory.films(scene, FILMS), FILMS, trackers)
            rows = {label: figures(runs) for label, runs in outcomes.items()}
            result.table(f'{scene}, N = 100, {dynamics}', rows)
            judge(result, dynamics, outcomes)
            _precision(result, f'{scene}, {dynamics}', rows)
            if trackers is TRACKERS:
                result.curves[scene] = {
                    axis: {label: _by_frame(outcomes[label], column)
                           for label in (COLOUR, CUES, LETTER, PRINTED)}
                    for column, axis in enumerate('xy')}
    return result


def _precision(result: Experiment, where: str, rows: dict[str, Figures]) -> None:
    ours = [label for label in (LETTER, PRINTED, OURS) if label in rows]
    for baseline in (COLOUR, CUES):
        intervals = {label: ratio(rows[label]['error'], rows[baseline]['error'])
                     for label in ours}
        result.claim(
            f'{where}: precision rises by nearly 32 % (abstract, which names no baseline: here '
            f'{baseline}); clearly more precise than it (figs 4, 6)',
            f'error over that of {baseline}: ' + '; '.join(
                f'{label} {one}' for label, one in intervals.items()),
            '; '.join(f'{label}: at most .68 {one.below(0.68)}, below 1 {one.below(1)}'
                      for label, one in intervals.items()))


def _occlusion(result: Experiment, dynamics: str, outcomes: dict[str, list[Outcome]]) -> None:
    kept = {label: np.array([_on(outcome) for outcome in runs])
            for label, runs in outcomes.items()}
    shares = {label: share(values) for label, values in kept.items()}
    result.claim(
        f'similar_occlusion, {dynamics}: colour alone is lost by frame 135 (in most runs)',
        f'on the target afterwards: {COLOUR} {shares[COLOUR]}', shares[COLOUR].below(0.5))
    names = [label for label in (CUES, LETTER, PRINTED, OURS) if label in shares]
    result.claim(
        f'similar_occlusion, {dynamics}: with both cues it stays on the target (in most runs)',
        '; '.join(f'{label} {shares[label]}' for label in names),
        ', '.join(f'{label}: {shares[label].above(0.5)}' for label in names))


def _turn(result: Experiment, dynamics: str, outcomes: dict[str, list[Outcome]]) -> None:
    turned = {label: {'error': np.array([np.nanmean(errors(one, _TURNED)) for one in runs])}
              for label, runs in outcomes.items()}
    rest = np.array([np.nanmean(np.delete(errors(one), np.r_[_TURNED]))
                     for one in outcomes[COLOUR]])
    more = ratio(turned[COLOUR]['error'], rest)
    gain = {label: ratio(turned[label]['error'], turned[COLOUR]['error'])
            for label in (CUES, LETTER, PRINTED, OURS) if label in turned}
    result.claim(
        f'pose_change, {dynamics}: while the face is turned (53-84) colour alone errs more, both '
        'cues less', f'colour alone, turned over not: {more}; turned, over colour alone: '
        + '; '.join(f'{label} {interval}' for label, interval in gain.items())
        + f' ({listed(turned, "error")} px)',
        ', '.join([f'colour: {more.above(1)}', *(
            f'{label}: {interval.below(1)}' for label, interval in gain.items())]))


def _on(outcome: Outcome) -> float:
    overlap = metrics.overlaps(outcome.run.boxes, outcome.film.truth)[_AFTER]
    return float(np.nanmean(overlap) > 0.3)


def _by_frame(runs: list[Outcome], column: int) -> list[list[float | None]]:
    return mean_by_frame([np.abs(metrics.center_offsets(
        one.run.boxes, one.film.truth)[:, column]) for one in runs])
