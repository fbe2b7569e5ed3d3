"""
What confidence is worth: wrong boxes against false alarms, as `confidence_threshold` is varied.

`python benchmarks/operating_point.py` tracks the targets of the shared sequences, plain and under
stress, and writes docs/results/presence.md and docs/images/presence.svg: those on which constants
were tuned, and the others. A box is wrong if the state is TRACKING although its overlap with the
target is below 0.1, or the target is hidden. A false alarm is a frame that isn't TRACKING although
the overlap is above 0.5. Shares are means over targets.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from joblib import delayed, Parallel
from matplotlib import rc_context
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from shared_sequences import folder_sequences, half_of, HALVES, options

from vtrack_ros.evaluation import FolderSequence
from vtrack_ros.evaluation.calibration import auroc
from vtrack_ros.evaluation.charts import colour
from vtrack_ros.evaluation.metrics import off_target, on_target, overlaps
from vtrack_ros.evaluation.runner import one_thread, run_tracker
from vtrack_ros.evaluation.stress import stressed_sequence
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.frame import Array
from vtrack_ros.localisation.filter_parameters import PRESENCE
from vtrack_ros.trackers import create_tracker

ROOT = Path(__file__).resolve().parents[1]
KINDS = {'plain': 1.0, 'gaps': 10.0, 'shake': 0.6, 'hidden': 30.0, 'twin': 0.4}
THRESHOLDS = np.linspace(0.01, 0.99, 99)
DEFAULT = float(PRESENCE['confidence_threshold'].default)


@dataclass(frozen=True)
class Record:
    """
    A run, frame by frame without the first.

    `on` and `off` tell whether the box is on and off the target, `vanished` whether the frame is
    the first one of those in which it's hidden.
    """

    half: str
    kind: str
    confidence: Array
    on: NDArray[np.bool_]
    off: NDArray[np.bool_]
    vanished: NDArray[np.bool_]

    def wrong(self, threshold: float) -> float:
        """Return the share of all frames that are TRACKING off the target."""
        return float((self.off & (self.confidence >= threshold)).mean())

    def alarms(self, threshold: float) -> float:
        """Return the share of frames on the target that aren't TRACKING; NaN without any."""
        return float((self.confidence < threshold)[self.on].mean()) if self.on.any() else np.nan


def follow(tracker: str, kind: str, seed: int, sequence: FolderSequence) -> Record:
    """Track a target under stress."""
    with one_thread():
        stressed = stressed_sequence(sequence, kind, KINDS[kind], seed)
        run = run_tracker(create_tracker(tracker, seed=seed), stressed.frames(),
                          stressed.first_box, stressed.steps)
    overlap = overlaps(run.boxes, stressed.truth)
    present = np.isfinite(stressed.truth[:, 0])
    return Record(half_of(sequence.name), kind, run.confidences[1:], on_target(overlap)[1:],
                  off_target(overlap)[1:], (present[:-1] & ~present[1:]))


def rows(records: list[Record]) -> list[list[str]]:
    """Return a row of figures for each half and kind."""
    table = []
    for half in HALVES:
        for kind in KINDS:
            runs = [one for one in records if (one.half, one.kind) == (half, kind)]
            confidence, on, off, vanished = (np.concatenate([
                getattr(one, name) for one in runs])
                for name in ('confidence', 'on', 'off', 'vanished'))
            at_once = confidence[vanished] < DEFAULT
            table.append([
                half, kind, f'{auroc(confidence[on], confidence[off]):.3f}',
                f'{100 * np.mean([one.wrong(DEFAULT) for one in runs]):.1f} %',
                f'{100 * np.nanmean([one.alarms(DEFAULT) for one in runs]):.1f} %',
                f'{at_once.sum()} of {len(at_once)}' if kind == 'hidden' else ''])
    return table


def draw(records: dict[str, list[Record]], path: Path) -> None:
    """Draw the curve of each tracker, plain and under stress, for both halves."""
    with rc_context({'svg.hashsalt': 'vtrack', 'svg.fonttype': 'none', 'font.size': 9}):
        figure = Figure(figsize=(8, 3.4), layout='constrained')
        for axes, (half, title) in zip(figure.subplots(1, 2, sharey=True), HALVES.items()):
            for number, (tracker, every) in enumerate(records.items()):
                for name, dashes in (('plain', '-'), ('under stress', '--')):
                    runs = [one for one in every if one.half == half
                            and (one.kind == 'plain') == (name == 'plain')]
                    *curve, default = 100 * np.array([[
                        np.nanmean([one.alarms(at) for one in runs]),
                        np.mean([one.wrong(at) for one in runs])]
                        for at in (*THRESHOLDS, DEFAULT)])
                    line, = axes.plot(*np.transpose(curve), dashes, label=f'{tracker}, {name}',
                                      color=colour(number))
                    axes.plot(*default, 'o', color=line.get_color())
            axes.set(title=title, xlabel='false alarms [%]', xlim=(0, 30), ylim=(0, None))
        figure.axes[0].set_ylabel('wrong boxes [%]')
        figure.axes[1].legend(frameon=False)
        figure.savefig(path, metadata={'Date': None})


def main() -> None:
    """Measure and write page and picture."""
    parser = options(__doc__)
    parser.add_argument('--trackers', default='gmpf,dcf')
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    found, _ = folder_sequences(arguments.sequences, arguments.frames)
    records = {tracker: list(Parallel(arguments.jobs)(
        delayed(follow)(tracker, kind, arguments.seed, one)
        for kind in KINDS for one in found)) for tracker in arguments.trackers.split(',')}
    draw(records, ROOT / 'docs' / 'images' / 'presence.svg')
    tables = '\n\n'.join(f'`{tracker}`:\n\n' + markdown([
        ['videos', 'stress', 'AUROC', 'wrong boxes', 'false alarms', 'reported at once'],
        *rows(every)]) for tracker, every in records.items())
    text = f"""# What confidence is worth

The first {arguments.frames} frames of {len(found)} targets of the shared sequences, seed
{arguments.seed}; `python benchmarks/operating_point.py` writes this page. A box is wrong if the
state is TRACKING although its overlap with the target is below 0.1, or the target is hidden. A
false alarm is a frame that isn't TRACKING although the overlap is above 0.5. Shares are means over
targets at `confidence_threshold` {DEFAULT}; the AUROC is over all frames. *reported at once*: how
often the first hidden frame wasn't TRACKING. The weights of the evidence were fitted on both
halves, and those of each half were tested on the other (see [decisions](../decisions.md)).

![Wrong boxes against false alarms](../images/presence.svg)

The dot marks the default of `confidence_threshold`; the threshold rises to the right, up to 0.99.

{tables}
"""
    (ROOT / 'docs' / 'results' / 'presence.md').write_text(text, encoding='utf-8')
    print(text)


if __name__ == '__main__':
    main()
