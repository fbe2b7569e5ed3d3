"""Evaluation of trackers on sequences with truth, in figures of merit."""

from vtrack_ros.bags.errors import SequenceError
from vtrack_ros.evaluation.evaluator import evaluate
from vtrack_ros.evaluation.results import Results
from vtrack_ros.evaluation.sequences import find_sequences, FolderSequence, Sequence
from vtrack_ros.evaluation.tracker_specification import (
    parse_tracker, parse_trackers, TrackerSpecification)

__all__ = [
    'FolderSequence', 'Results', 'Sequence', 'SequenceError', 'TrackerSpecification',
    'evaluate', 'find_sequences', 'parse_tracker', 'parse_trackers',
]
