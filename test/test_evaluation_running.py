"""Trackers over sequences: what is run, what is kept, what is said when something is wrong."""

from dataclasses import replace
import gc
import json
import math
import os
import subprocess
import sys
import weakref

from evaluation_material import (
    DeadlySequence, picture, SignedSequence, truth_of, write_sequence, write_truth)
import numpy as np
import pytest

from vtrack_ros.cli.command_line import main
from vtrack_ros.evaluation import (
    evaluate, find_sequences, FolderSequence, parse_tracker, parse_trackers, SequenceError)
from vtrack_ros.evaluation.cache import RunCache, source_files, source_hash
from vtrack_ros.evaluation.report import html_page
from vtrack_ros.evaluation.results_json import as_json
from vtrack_ros.evaluation.runner import run_tracker
from vtrack_ros.evaluation.scoring import FIGURES
from vtrack_ros.evaluation.sequences import read_folder
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import available_peers, create_tracker, tracker_class, tracker_names

TIMED = {figure.key for figure in FIGURES if figure.timed}


@pytest.fixture
def folder(tmp_path):
    """Return a folder of two good sequences."""
    write_sequence(tmp_path / 'data' / 'First')
    write_sequence(tmp_path / 'data' / 'Second', frames=8)
    return tmp_path / 'data'


def untimed(content):
    """Return results as JSON without what depends on the clock."""
    def stripped(scores):
        return {key: value for key, value in scores.items()
                if key.removesuffix('_std') not in TIMED}
    content = json.loads(json.dumps(content))
    for key in ('environment', 'timings'):
        del content[key]
    content['summary'] = {label: stripped(row) for label, row in content['summary'].items()}
    content['sequences'] = {name: {label: stripped(row) for label, row in rows.items()}
                            for name, rows in content['sequences'].items()}
    return content


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


def test_processes_change_nothing(folder):
    """In this process or in two others: the same figures, but for the times."""
    trackers = ['pf', 'gmpf:particles=40']
    here = evaluate(trackers, folder, seeds=2, jobs=0)
    there = evaluate(trackers, folder, seeds=2, jobs=2)
    assert untimed(as_json(here)) == untimed(as_json(there))
    assert list(here.summary) == trackers
    assert list(here.by_sequence) == ['First', 'Second']
    for tracker in trackers:
        assert list(here.runs('First', tracker)) == [0, 1]


def test_dask_spreads_an_evaluation(folder):
    """On a dask cluster's workers, both of them: the same figures, but for the times."""
    pytest.importorskip('distributed', reason='needs distributed')
    from distributed import Client
    from joblib import parallel_config
    found = [SignedSequence(one.name, one.truth, one.images) for one in find_sequences(folder)[0]]
    here = as_json(evaluate(['pf'], folder, jobs=0))
    with Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client:
        workers = {f'{pid}.pid' for pid in client.run(os.getpid).values()}
        with parallel_config(backend='dask'):
            there = as_json(evaluate(['pf'], found))
    assert untimed(here) == untimed(there)
    signed = {path.name for path in folder.rglob('*.pid')}
    assert len(signed) == 2 and signed == workers


def test_dask_that_is_missing(folder, monkeypatch, capsys):
    """One line says what to install."""
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert main(['evaluate', '--sequences', str(folder), '--backend', 'dask']) == 1
    assert 'pip install distributed' in capsys.readouterr().err


@pytest.mark.parametrize('missing', ['joblib', 'tqdm', 'jinja2', 'matplotlib'])
def test_library_that_is_missing(folder, tmp_path, missing, monkeypatch, capsys):
    """One line says what to install."""
    monkeypatch.setitem(sys.modules, missing, None)
    for module in ('report', 'charts'):
        monkeypatch.delitem(sys.modules, f'vtrack_ros.evaluation.{module}', raising=False)
    assert main(['evaluate', '--sequences', str(folder), '--trackers', 'pf', '--jobs', '1',
                 '--no-cache', '--html', str(tmp_path / 'page.html')]) == 1
    assert f'pip install {missing}' in capsys.readouterr().err.splitlines()[-1]


def test_script_from_standard_input(folder):
    """A script without a file may use processes too."""
    script = ('from vtrack_ros.evaluation import evaluate\n'
              f'results = evaluate(["pf"], {str(folder)!r}, jobs=1)\n'
              'print(len(results.by_sequence), results.problems)\n')
    ended = subprocess.run([sys.executable, '-'], input=script, capture_output=True, text=True)
    assert ended.stdout.split() == ['2', '[]'], ended.stderr


def test_death_of_a_process_is_reported(folder):
    """When a process dies, its runs are problems, and the evaluation comes to its end."""
    [first, _] = find_sequences(folder)[0]
    deadly = DeadlySequence('Deadly', first.truth, first.images)
    results = evaluate(['pf'], [deadly], jobs=2)
    assert [problem.sequence for problem in results.problems] == ['Deadly']
    assert 'died' in results.problems[0].text
    assert results.summary == {}


def test_seeds_differ_and_their_spread_is_reported(folder):
    """Mean and sample deviation over seeds are those of the seeds' own figures."""
    results = evaluate(['pf'], folder, seeds=3, jobs=0)
    values = [results.scores['First']['pf'][seed]['auc'] for seed in range(3)]
    row = results.by_sequence['First']['pf']
    assert row['auc'] == pytest.approx(np.mean(values))
    assert row['auc_std'] == pytest.approx(np.std(values, ddof=1))
    each = [[results.scores[name]['pf'][seed]['auc'] for name in ('First', 'Second')]
            for seed in range(3)]
    assert results.summary['pf']['auc'] == pytest.approx(np.mean(each))
    assert results.summary['pf']['auc_std'] == pytest.approx(np.std(np.mean(each, 1), ddof=1))


def test_composite_index_compares_the_trackers(folder):
    """It is the weighted sum of the figures, each relative to the worst tracker's."""
    results = evaluate(['pf', 'gmpf', 'opencv_camshift'], folder, seeds=2, jobs=0)
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
    """Rows of NaN leave the overlap alone and are a loss."""
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


def test_cache_runs_only_what_changed(folder, tmp_path):
    """A second time everything is there; another parameter, seed or frame is run anew."""
    cache = RunCache(tmp_path / 'cache')

    def cached(tracker='pf', seeds=1):
        results = evaluate([tracker], folder, seeds=seeds, jobs=0, cache=cache)
        return as_json(results), {
            (name, seed): run.cached for name in results.sequences
            for seed, run in results.runs(name, tracker).items()}

    first, flags = cached()
    assert not any(flags.values())
    again, flags = cached()
    assert all(flags.values())
    assert untimed(again) == untimed(first)
    assert (first['timings'], again['timings']) == ('measured', 'cached')
    assert again['summary']['pf']['ms_median'] == first['summary']['pf']['ms_median']
    assert not any(cached('pf:particles=40')[1].values())
    assert cached(seeds=2)[1] == {('First', 0): True, ('First', 1): False,
                                  ('Second', 0): True, ('Second', 1): False}
    write_truth(folder / 'Second', ['20,30,24,24'] * 8)
    assert cached()[1] == {('First', 0): True, ('Second', 0): False}


def test_torn_cache_entry_is_run_again(folder, tmp_path):
    """A file that can't be read is as good as none."""
    cache = RunCache(tmp_path / 'cache')
    evaluate(['pf'], folder, jobs=0, cache=cache)
    for path in (tmp_path / 'cache').rglob('output.pkl'):
        path.write_bytes(path.read_bytes()[:100])
    results = evaluate(['pf'], folder, jobs=0, cache=cache)
    assert results.timings == 'measured'
    assert not results.problems


def test_default_parameters_share_the_cache(folder, tmp_path):
    """A parameter that is spelled out at its default is the same run."""
    cache = RunCache(tmp_path / 'cache')
    evaluate(['pf'], folder, jobs=0, cache=cache)
    default = tracker_class('pf').PARAMETERS['particles'].default
    assert evaluate([f'pf:particles={default}'], folder, jobs=0, cache=cache).timings == 'cached'


def test_source_of_a_tracker():
    """A tracker's source holds what it imports by name, not its neighbours."""
    files = source_files('vtrack_ros.tracker')
    assert {'vtrack_ros.tracker', 'vtrack_ros.parameters',
            'vtrack_ros.geometry.box'} <= set(files)
    assert 'vtrack_ros.trackers.registry' not in files
    assert 'vtrack_ros.tracker' in source_files('vtrack_ros.evaluation.runner')
    assert source_hash('vtrack_ros.tracker') != source_hash('vtrack_ros.parameters')
    with pytest.raises(ModuleNotFoundError, match='vtrack_ros.nowhere'):
        source_files('vtrack_ros.nowhere')


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
    ('', 'no tracker is named; valid are .*gmpf'),
    ('nobody', "unknown tracker 'nobody'; valid are .*gmpf"),
    ('pf:size=3', "unknown parameter of pf: 'size'; valid are .*particles"),
    ('pf:particles=many', 'particles must be an integer from'),
    ('pf:particles', 'expected parameter=value'),
    ('pf:particles=0', 'particles must be an integer from'),
])
def test_wrong_specifications(text, message):
    """What is wrong is said, and what is valid."""
    with pytest.raises(ValueError, match=message):
        parse_trackers(text)


@pytest.mark.parametrize('name', available_peers())
def test_peers(name, folder):
    """Trackers of OpenCV run in the same harness; those that draw nothing run once."""
    [_, second] = find_sequences(folder)[0]
    results = evaluate([name], [second], seeds=2, jobs=0)
    assert not results.problems
    once = parse_tracker(name).deterministic
    assert list(results.runs('Second', name)) == ([0] if once else [0, 1])
    assert math.isnan(results.summary[name]['coverage90'])
    assert results.summary[name]['auc'] > 0.3
    again = evaluate([name], [second], seeds=2, jobs=0)
    for seed, run in results.runs('Second', name).items():
        np.testing.assert_array_equal(run.boxes, again.runs('Second', name)[seed].boxes)


def test_manual_names_every_figure(repository):
    """Every figure that can be in a JSON file is explained in the manual."""
    manual = (repository / 'docs' / 'evaluate.md').read_text()
    for figure in FIGURES:
        assert f'`{figure.key}`' in manual


def test_command(folder, tmp_path, capsys):
    """The command prints a table, writes JSON with all figures, and ends with 0."""
    code = main(['evaluate', '--sequences', str(folder), '--trackers', 'pf', '--seeds', '2',
                 '--jobs', '2',
                 '--json', str(tmp_path / 'a.json'), '--cache', str(tmp_path / 'cache')])
    assert code == 0
    output = capsys.readouterr().out
    assert 'First' in output and 'Second' in output and 'AUC' in output
    content = json.loads((tmp_path / 'a.json').read_text())
    for row in (content['sequences']['First']['pf'], content['summary']['pf']):
        for figure in FIGURES:
            assert {figure.key, f'{figure.key}_std'} <= set(row)
    assert content['seeds'] == [0, 1]


def test_command_skips_what_is_broken(folder, tmp_path, capsys):
    """A broken sequence is named, the others are evaluated, and the code is 1."""
    (folder / 'Second' / 'img' / '00003.png').write_bytes(b'torn')
    (folder / 'Third').mkdir()
    code = main(['evaluate', '--sequences', str(folder), '--trackers', 'pf', '--no-cache',
                 '--json', str(tmp_path / 'a.json')])
    assert code == 1
    errors = capsys.readouterr().err
    assert '00003.png' in errors and 'Third' in errors
    content = json.loads((tmp_path / 'a.json').read_text())
    assert content['sequences']['First']['pf']['auc'] > 0
    assert content['sequences']['Second'] == {}
    assert {problem['sequence'] for problem in content['problems']} == {'Second', 'Third'}


@pytest.mark.parametrize(('arguments', 'message'), [
    ([], 'nothing to evaluate on'),
    (['--sequences', 'nowhere'], 'no such folder'),
    (['--bags', 'nowhere'], 'no such bag'),
    (['--scenes', 'nowhere'], 'unknown scene'),
    (['--sequences', '.', '--trackers', 'nobody'], 'unknown tracker'),
    (['--sequences', '.', '--seeds', '0'], 'whole number'),
    (['--sequences', '.', '--json', 'nowhere/a.json'], 'no folder'),
])
def test_wrong_arguments(arguments, message, capsys):
    """Wrong arguments end with 2 and say what is wrong."""
    assert main(['evaluate', *arguments]) == 2
    assert message in capsys.readouterr().err


def test_pictures_that_changed_are_read_again(folder):
    """In one process, a second evaluation sees the files as they are then."""
    before = evaluate(['pf'], folder, jobs=0)
    [first, _] = find_sequences(folder)[0]
    for path in first.images[1:]:
        path.write_bytes(first.images[0].read_bytes())
    changed = evaluate(['pf'], [first], jobs=0)
    assert (changed.runs('First', 'pf')[0].boxes != before.runs('First', 'pf')[0].boxes).any()


def test_a_video_s_frames_are_those_of_the_sequence(folder):
    """One's own cuts of a folder: backwards, and every second frame, have the same images."""
    [one] = read_folder(folder / 'First')
    cuts = [replace(one, name=name, truth=one.truth[order], images=one.images[order])
            for name, order in (('all', slice(None)), ('back', slice(None, None, -1)),
                                ('even', slice(None, None, 2)), ('odd', slice(1, None, 2)))]
    together = evaluate(['dcf'], cuts, jobs=0)
    for cut in cuts:
        alone = run_tracker(create_tracker('dcf', seed=0), cut.frames(), cut.first_box)
        np.testing.assert_array_equal(together.runs(cut.name, 'dcf')[0].boxes, alone.boxes)


def test_no_picture_is_kept(folder):
    """When an evaluation in this process is over, or was given up, its frames are gone."""
    [first, _] = find_sequences(folder)[0]
    seen = []

    class Watched(FolderSequence):
        """A sequence that knows what became of its frames."""

        def frames(self):
            """Decode them, and remember them weakly."""
            for frame in super().frames():
                seen.append(weakref.ref(frame))
                yield frame

    def give_up(done, total):
        if done:
            raise KeyboardInterrupt

    watched = Watched('Watched', first.truth, first.images)
    evaluate(['pf'], [watched], jobs=0)
    with pytest.raises(KeyboardInterrupt):
        evaluate(['pf', 'gmpf'], [watched], jobs=0, progress=give_up)
    gc.collect()
    assert seen and not any(one() is not None for one in seen)


def test_a_seed_that_failed_on_one_sequence(folder, tmp_path):
    """The summary is of the seeds that ran everywhere; the others' runs stay in their place."""
    cache = RunCache(tmp_path / 'cache')
    evaluate(['pf'], folder, seeds=1, jobs=0, cache=cache)
    [first, second] = find_sequences(folder)[0]
    evaluate(['pf'], [first], seeds=2, jobs=0, cache=cache)

    class Torn(FolderSequence):
        """A sequence whose disk fails, with the content of the good one."""

        def fingerprint(self):
            """Return the good one's."""
            return second.fingerprint()

        def frames(self):
            """Fail."""
            raise SequenceError('not an image')

    results = evaluate(['pf'], [first, Torn('Second', second.truth, second.images)], seeds=2,
                       jobs=0, cache=cache)
    assert [problem.sequence for problem in results.problems] == ['Second']
    assert list(results.runs('First', 'pf')) == [0, 1]
    assert list(results.runs('Second', 'pf')) == [0]
    each = [results.scores[name]['pf'][0]['auc'] for name in ('First', 'Second')]
    assert results.summary['pf']['auc'] == pytest.approx(np.mean(each))
    assert json.loads(json.dumps(as_json(results)))['summary']['pf']['auc'] is not None
    assert 'not an image' in html_page(results)
