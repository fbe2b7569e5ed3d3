"""The results under stress, as text for a terminal and as JSON."""

from dataclasses import asdict
import math
from typing import Any

from vtrack_ros.evaluation.results_json import plain
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS
from vtrack_ros.evaluation.stress_results import REFERENCE, StressResults
from vtrack_ros.evaluation.table import aligned, fewer_targets, number_text


def stress_table(stress: StressResults) -> str:
    """Return the AUC of each tracker at each severity; the last row is the mean of all kinds."""
    trackers = list(stress.plain.summary)
    values = {'plain': [stress.plain.summary[tracker]['auc'] for tracker in trackers]}
    for kind, severity in stress.levels:
        place = 1 + list(stress.of_kind(kind)).index(severity)
        values[f'{kind} {severity:g}'] = [stress.auc(kind, one)[place] for one in trackers]
    values['mean over kinds'] = [stress.means[tracker] for tracker in trackers]
    return aligned([['AUC under stress', *trackers], *(
        [name, *(number_text(value, 'auc') for value in row)] for name, row in values.items())])


def fewer_under_stress(stress: StressResults) -> list[str]:
    """Return `fewer_targets` of each severity, but for what is so without stress, too."""
    without = fewer_targets(stress.plain)
    return [f'{kind} {severity:g}: {line}' for (kind, severity), level in stress.levels.items()
            for line in fewer_targets(level)
            if line.replace(f' ({kind} {severity:g})', '') not in without]


def influence_table(stress: StressResults) -> str:
    """Return the share of frames with a box elsewhere than that of `dcf`, and the median gain."""
    return aligned(influence_rows(stress))


def stress_json(stress: StressResults) -> dict[str, Any]:
    """
    Return the figures under stress as data that can be written as JSON; an undefined one is null.

    `kinds` has for each kind its severities, the AUC of each tracker by severity, first `plain`,
    and each tracker's `FilterInfluence` (`changed`); the outer `changed` is that without stress.
    `sequences` is the name under stress -> tracker -> AUC.
    """
    trackers = list(stress.plain.trackers)
    return {
        'seed': stress.seed,
        'mean_auc': plain(stress.means),
        'kinds': {kind: {
            'description': STRESS_KINDS[kind].description,
            'unit': STRESS_KINDS[kind].unit,
            'severities': list(stress.of_kind(kind)),
            'auc': {tracker: [value if math.isfinite(value) else None
                              for value in stress.auc(kind, tracker)] for tracker in trackers},
            'changed': _influences(stress, kind),
        } for kind in stress.kinds},
        'changed': _influences(stress, None),
        # where no frame is changed, the sequences have their plain names
        'sequences': {
            f'{name} ({kind} {severity:g})' if STRESS_KINDS[kind].plan is None else name: {
                tracker: plain(scores)['auc'] for tracker, scores in row.items()}
            for (kind, severity), level in stress.levels.items()
            for name, row in level.by_sequence.items()},
    }


def influence_rows(stress: StressResults) -> list[list[str]]:
    """Return the rows of `influence_table`, the header first."""
    trackers = [tracker for tracker in stress.plain.summary if tracker != REFERENCE]
    rows = [[f'differs from {REFERENCE}', *trackers]]
    for kind in (None, *stress.kinds):
        cells = []
        for tracker in trackers:
            found = stress.influence(kind, tracker)
            gain = '' if math.isnan(found.gain) else f' {found.gain:+.3f}'
            cells.append('-' if math.isnan(found.share) else f'{100 * found.share:.1f} %{gain}')
        rows.append([kind or 'plain', *cells])
    return rows


def _influences(stress: StressResults, kind: str | None) -> dict[str, Any]:
    return {tracker: plain(asdict(stress.influence(kind, tracker)))
            for tracker in stress.plain.trackers if tracker != REFERENCE}
