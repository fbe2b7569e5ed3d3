"""The measuring instrument: trackers over sequences with truth, in figures."""

from vtrack_ros.evaluation.evaluating import evaluate
from vtrack_ros.evaluation.results import Results
from vtrack_ros.evaluation.sequences import find_sequences, FolderSequence, Sequence, SequenceError
from vtrack_ros.evaluation.variants import parse_variant, parse_variants, TrackerVariant

__all__ = [
    'FolderSequence', 'Results', 'Sequence', 'SequenceError', 'TrackerVariant',
    'evaluate', 'find_sequences', 'parse_variant', 'parse_variants',
]
