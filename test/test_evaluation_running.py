"""Trackers over sequences: what is run, what is kept, what is reported if something is wrong."""

import math
import os
import subprocess
import sys

import cv2
from evaluation_material import (
    DeadlySequence, picture, SignedSequence, truth_of, untimed, write_sequence)
import numpy as np
import pytest

from vtrack_ros.evaluation import evaluate, find_sequences, parse_tracker, parse_trackers
from vtrack_ros.evaluation.results_json import as_json
from vtrack_ros.evaluation.runner import run_tracker
from vtrack_ros.evaluation.tracker_specification import TrackerSpecification
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import available_peers, create_tracker, tracker_names


def test_run_keeps_what_the_tracker_said():
    """The run's rows are the tracker's estimates; the first box is the one that was given."""
    frames = [picture(index) for index in range(6)]
    run = run_tracker(create_tracker('pf', seed=4), frames, Box(*truth_of(0)))
    tracker = create_tracker('pf', seed=4)
    estimates = [tracker.start(frames[0], Box(*truth_of(0)))]
    estimates += [tracker.update(frame) for frame in frames[1:]]
    np.testing.assert_array_equal(run.boxes[0], truth_of(0))
    np.testing.assert_array_equal(
        run.boxes[1:], [estimate.box.as_array() for estimate in estimates[1:]])
    np.testing.assert_array_equal(
        run.confidences, [estimate.confidence for estimate in estimates])
    assert run.covariances.shape == (6, 2, 2)
    assert len(run.wall_ms) == len(run.cpu_ms) == 5
    assert (run.wall_ms > 0).all()


def test_no_frames():
    """A sequence without frames can't be run."""
    with pytest.raises(ValueError, match='no frames'):
        run_tracker(create_tracker('pf', seed=4), [], Box(0, 0, 1, 1))


def test_processes_change_nothing(two_sequences):
    """In this process or in two others: the same figures, but for the times."""
    trackers = ['pf', 'gmpf:particles=40']
    here = evaluate(trackers, two_sequences, seeds=2, jobs=0)
    there = evaluate(trackers, two_sequences, seeds=2, jobs=2)
    assert untimed(as_json(here)) == untimed(as_json(there))
    assert list(here.summary) == trackers
    assert list(here.by_sequence) == ['First', 'Second']
    for tracker in trackers:
        assert list(here.runs('First', tracker)) == [0, 1]


def test_dask_spreads_an_evaluation(two_sequences):
    """On a dask cluster's workers, both of them: the same figures, but for the times."""
    pytest.importorskip('distributed', reason='needs distributed')
    from distributed import Client
    from joblib import parallel_config
    found = [SignedSequence(one.name, one.truth, one.images)
             for one in find_sequences(two_sequences)[0]]
    here = as_json(evaluate(['pf'], two_sequences, jobs=0))
    with Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client:
        workers = {f'{pid}.pid' for pid in client.run(os.getpid).values()}
        with parallel_config(backend='dask'):
            there = as_json(evaluate(['pf'], found))
    assert untimed(here) == untimed(there)
    signed = {path.name for path in two_sequences.rglob('*.pid')}
    assert len(signed) == 2 and signed == workers


def test_script_from_standard_input(two_sequences):
    """A script without a file may use processes too."""
    script = ('from vtrack_ros.evaluation import evaluate\n'
              f'results = evaluate(["pf"], {str(two_sequences)!r}, jobs=1)\n'
              'print(len(results.by_sequence), results.problems)\n')
    ended = subprocess.run([sys.executable, '-'], input=script, capture_output=True, text=True)
    assert ended.stdout.split() == ['2', '[]'], ended.stderr


def test_death_of_a_process_is_reported(two_sequences):
    """When a process dies, its runs are reported as problems, and the evaluation finishes."""
    [first, _] = find_sequences(two_sequences)[0]
    deadly = DeadlySequence('Deadly', first.truth, first.images)
    results = evaluate(['pf'], [deadly], jobs=2)
    assert [problem.sequence for problem in results.problems] == ['Deadly']
    assert 'died' in results.problems[0].text
    assert results.summary == {}


def test_an_image_of_another_size_is_named(tmp_path):
    """The error says which frame it is, and what is wrong with it."""
    path = write_sequence(tmp_path / 'Sizes', 6) / 'img' / '00004.png'
    cv2.imwrite(str(path), picture(3)[:100])
    [problem] = evaluate(['dcf'], tmp_path, jobs=0).problems
    assert problem.text.endswith('Sizes: frame 3 is 160 x 100 pixels, but the first is '
                                 '160 x 120: all must have the same size')


def test_seeds_differ_and_their_spread_is_reported(two_sequences):
    """Mean and sample deviation over seeds are those of the seeds' own figures."""
    results = evaluate(['pf'], two_sequences, seeds=3, jobs=0)
    values = [results.scores['First']['pf'][seed]['auc'] for seed in range(3)]
    row = results.by_sequence['First']['pf']
    assert row['auc'] == pytest.approx(np.mean(values))
    assert row['auc_std'] == pytest.approx(np.std(values, ddof=1))
    each = [[results.scores[name]['pf'][seed]['auc'] for name in ('First', 'Second')]
            for seed in range(3)]
    assert results.summary['pf']['auc'] == pytest.approx(np.mean(each))
    assert results.summary['pf']['auc_std'] == pytest.approx(np.std(np.mean(each, 1), ddof=1))


def test_composite_index_compares_the_trackers(two_sequences):
    """It is the weighted sum of the figures, each relative to the worst tracker's."""
    results = evaluate(['pf', 'gmpf', 'opencv_camshift'], two_sequences, seeds=2, jobs=0)
    for name, seed in (('First', 0), ('First', 1), ('Second', 1)):
        rows = {tracker: by_seed.get(seed, by_seed[0])
                for tracker, by_seed in results.scores[name].items()}
        worst = {key: max(row[key] for row in rows.values())
                 for key in ('cpu_ms_median', 'rmse_mean', 'rmse_var')}
        for tracker in ('pf', 'gmpf'):
            row = rows[tracker]
            assert row['cei'] == pytest.approx(
                0.5 * row['cpu_ms_median'] / worst['cpu_ms_median']
                + 0.3 * row['rmse_mean'] / worst['rmse_mean']
                + 0.2 * row['rmse_var'] / worst['rmse_var'])


def test_absent_target_counts_for_loss_only(tmp_path):
    """Frames without a target don't count in the overlap, and are a loss."""
    whole = [','.join(map(str, truth_of(index))) for index in range(12)]
    gaps = whole[:6] + ['NaN,NaN,NaN,NaN'] * 2 + whole[8:]
    write_sequence(tmp_path / 'Gap', rows=gaps)
    results = evaluate(['pf'], tmp_path, jobs=0)
    row = results.by_sequence['Gap']['pf']
    run = results.runs('Gap', 'pf')[0]
    kept = [index for index in range(12) if index not in (6, 7)]
    overlaps = [Box(*run.boxes[index]).iou(Box(*truth_of(index))) for index in kept]
    auc = np.mean([[overlap > step / 20 for overlap in overlaps] for step in range(21)])
    assert row['auc'] == pytest.approx(auc)
    assert row['losses'] >= 1
    assert row['returns'] == 1
    assert not math.isnan(row['auroc'])


def test_specifications():
    """A list of names with parameters; a part with = belongs to the tracker before it."""
    found = parse_trackers('pf, gmpf:particles=40,floor=0.2 ,pf')
    assert [tracker.label for tracker in found] == ['pf', 'gmpf:particles=40,floor=0.2']
    assert found[1].parameters == (('floor', 0.2), ('particles', 40))
    assert found[1].create(0).parameters['particles'] == 40
    own = tracker_names(replicas=False)
    assert 'dcf' in own and 'pf_paper' not in own
    assert tuple(tracker.name for tracker in parse_trackers('all')) == own
    papers = {tracker.name for tracker in parse_trackers('all,papers')} - set(own)
    assert papers and all(name.endswith('_paper') for name in papers)


@pytest.mark.parametrize(('text', 'message'), [
    ('', 'no tracker is given; valid are .*gmpf'),
    ('nobody', "unknown tracker 'nobody'; valid are .*gmpf"),
    ('pf:size=3', "unknown parameter of pf: 'size'; valid are .*particles"),
    ('pf:particles=many', 'particles must be an integer from'),
    ('pf:particles', 'expected parameter=value'),
    ('pf:particles=0', 'particles must be an integer from'),
])
def test_wrong_specifications(text, message):
    """The error says what is wrong, and what is valid."""
    with pytest.raises(ValueError, match=message):
        parse_trackers(text)


def test_a_label_stands_for_one_tracker(two_sequences):
    """Trackers given twice run once; two that differ but have one label are refused."""
    results = evaluate(['pf', 'pf'], two_sequences, jobs=0)
    assert len(results.trackers) == 1
    few = TrackerSpecification('pf', 'pf', (('particles', 40),))
    with pytest.raises(ValueError, match="two trackers have the label 'pf'"):
        evaluate(['pf', few], two_sequences, jobs=0)


@pytest.mark.parametrize('name', available_peers())
def test_peers(name, two_sequences):
    """Trackers of OpenCV run in the same harness; those without randomness run once."""
    [_, second] = find_sequences(two_sequences)[0]
    results = evaluate([name], [second], seeds=2, jobs=0)
    assert not results.problems
    once = parse_tracker(name).deterministic
    assert list(results.runs('Second', name)) == ([0] if once else [0, 1])
    assert math.isnan(results.summary[name]['coverage90'])
    assert results.summary[name]['auc'] > 0.3
    again = evaluate([name], [second], seeds=2, jobs=0)
    for seed, run in results.runs('Second', name).items():
        np.testing.assert_array_equal(run.boxes, again.runs('Second', name)[seed].boxes)
