"""What an evaluation caches: runs for the next evaluation, and frames from run to run."""

from dataclasses import replace
import gc
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
import json
import weakref

from evaluation_material import untimed, write_truth
import numpy as np
import pytest
from siamese_files import write_backbone, write_head

from vtrack_ros.evaluation import evaluate, find_sequences, FolderSequence, SequenceError
from vtrack_ros.evaluation.cache import RunCache, source_files, source_hash, tracker_source
from vtrack_ros.evaluation.report import html_page
from vtrack_ros.evaluation.results_json import as_json
from vtrack_ros.evaluation.runner import run_tracker
from vtrack_ros.evaluation.sequences import read_bag, read_folder, scene_sequence
from vtrack_ros.evaluation.stress import stressed_sequence
from vtrack_ros.evaluation.tracker_specification import TrackerSpecification
from vtrack_ros.trackers import create_tracker, tracker_class


def test_cache_runs_only_what_changed(two_sequences, tmp_path):
    """A second evaluation uses cached runs; with another parameter, seed or truth it runs anew."""
    cache = RunCache(tmp_path / 'cache')

    def cached(tracker='pf', seeds=1):
        results = evaluate([tracker], two_sequences, seeds=seeds, jobs=0, cache=cache)
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
    write_truth(two_sequences / 'Second', ['20,30,24,24'] * 8)
    assert cached()[1] == {('First', 0): True, ('Second', 0): False}


def test_torn_cache_entry_is_run_again(two_sequences, tmp_path):
    """A cache entry that can't be read is run again."""
    cache = RunCache(tmp_path / 'cache')
    evaluate(['pf'], two_sequences, jobs=0, cache=cache)
    for path in (tmp_path / 'cache').rglob('output.pkl'):
        path.write_bytes(path.read_bytes()[:100])
    results = evaluate(['pf'], two_sequences, jobs=0, cache=cache)
    assert results.timings == 'measured'
    assert not results.problems


def test_default_parameters_share_the_cache(two_sequences, tmp_path):
    """A parameter that is spelled out at its default is the same run."""
    cache = RunCache(tmp_path / 'cache')
    evaluate(['pf'], two_sequences, jobs=0, cache=cache)
    default = tracker_class('pf').PARAMETERS['particles'].default
    spelled = evaluate([f'pf:particles={default}'], two_sequences, jobs=0, cache=cache)
    assert spelled.timings == 'cached'


def test_network_files_that_changed_are_run_again(two_sequences, tmp_path):
    """A run with other weights in the files that its parameters name isn't the cached one."""
    cache = RunCache(tmp_path / 'cache')
    backbone, head = write_backbone(tmp_path / 'backbone.onnx'), tmp_path / 'head.onnx'
    text = f'gmpf:localiser=siamese,siamese.backbone={backbone},siamese.head={head}'

    def measured(grow):
        write_head(head, grow=grow)
        results = evaluate([text], two_sequences, jobs=0, cache=cache)
        assert not results.problems
        return results.timings, results.runs('First', text)[0].boxes

    (first, usual), (second, large), (third, again) = map(measured, (1.0, 2.0, 2.0))
    assert (first, second, third) == ('measured', 'measured', 'cached')
    assert (large[-1, 2:] > 1.2 * usual[-1, 2:]).all()
    np.testing.assert_array_equal(again, large)


def test_source_of_a_tracker():
    """A tracker's source includes the modules that it imports, not their neighbours."""
    files = source_files('vtrack_ros.tracker')
    assert {'vtrack_ros.tracker', 'vtrack_ros.parameters',
            'vtrack_ros.geometry.box'} <= set(files)
    assert 'vtrack_ros.trackers.registry' not in files
    assert 'vtrack_ros.tracker' in source_files('vtrack_ros.evaluation.runner')
    assert source_hash('vtrack_ros.tracker') != source_hash('vtrack_ros.parameters')
    with pytest.raises(ModuleNotFoundError, match='vtrack_ros.nowhere'):
        source_files('vtrack_ros.nowhere')


def test_source_of_another_package_s_tracker(tmp_path, monkeypatch):
    """It may have compiled modules, be in a namespace, and import what isn't always there."""
    package = tmp_path / 'company_of_trackers' / 'inner'
    package.mkdir(parents=True)
    (package / 'mine.py').write_text(
        'from company_of_trackers import inner\n'
        'from company_of_trackers.inner import helper\n'
        'from company_of_trackers.inner.core import step\n'
        'try:\n    from ._version import version\nexcept ImportError:\n    pass\n')
    (package / 'helper.py').write_text('import company_of_trackers.inner.mine')
    compiled = package / f'core{EXTENSION_SUFFIXES[0]}'
    compiled.write_bytes(b'\x7fELF')
    monkeypatch.syspath_prepend(tmp_path)
    name = 'company_of_trackers.inner.mine'
    assert source_files(name) == {
        name: package / 'mine.py', 'company_of_trackers.inner.helper': package / 'helper.py',
        'company_of_trackers.inner.core': compiled}
    before = source_hash(name)
    compiled.write_bytes(b'\x7fELF 2')
    assert source_hash(name) != before


def test_source_of_a_base_class_in_another_module(tmp_path, monkeypatch):
    """An edit of the class that a tracker is derived from makes another source of it, too."""
    (tmp_path / 'first_of_two.py').write_text(
        'from vtrack_ros.trackers.dcf import CorrelationTracker\n'
        'class First(CorrelationTracker):\n    NAME = "first_of_two"\n')
    (tmp_path / 'second_of_two.py').write_text(
        'from first_of_two import First\nclass Second(First):\n    NAME = "second_of_two"\n')
    monkeypatch.syspath_prepend(tmp_path)
    second = import_module('second_of_two').Second
    monkeypatch.setattr(TrackerSpecification, 'tracker_class', second)
    specification = TrackerSpecification('second_of_two', 'second_of_two')
    before = tracker_source(specification)
    assert tracker_source(specification) == before
    with (tmp_path / 'first_of_two.py').open('a') as file:
        file.write('    SUMMARY = "changed"\n')
    assert tracker_source(specification) != before


def test_pictures_that_changed_are_read_again(two_sequences):
    """A second evaluation in the same process reads images that have changed."""
    before = evaluate(['pf'], two_sequences, jobs=0)
    [first, _] = find_sequences(two_sequences)[0]
    for path in first.images[1:]:
        path.write_bytes(first.images[0].read_bytes())
    changed = evaluate(['pf'], [first], jobs=0)
    assert (changed.runs('First', 'pf')[0].boxes != before.runs('First', 'pf')[0].boxes).any()


def test_a_video_s_frames_are_those_of_the_sequence(two_sequences):
    """Sequences cut from a folder, backwards or every second frame, each get their own frames."""
    [one] = read_folder(two_sequences / 'First')
    cuts = [replace(one, name=name, truth=one.truth[order], images=one.images[order])
            for name, order in (('all', slice(None)), ('back', slice(None, None, -1)),
                                ('even', slice(None, None, 2)), ('odd', slice(1, None, 2)))]
    together = evaluate(['dcf'], cuts, jobs=0)
    for cut in cuts:
        alone = run_tracker(create_tracker('dcf', seed=0), cut.frames(), cut.first_box)
        np.testing.assert_array_equal(together.runs(cut.name, 'dcf')[0].boxes, alone.boxes)


def test_a_bag_s_frames_are_those_of_the_sequence(repository, tmp_path):
    """A sequence cut from a bag has its own frames beside the whole bag."""
    pytest.importorskip('rosbags', reason='needs rosbags')
    whole = read_bag(repository / 'bags' / 'face_fast')
    cut = replace(whole, name='cut', truth=whole.truth[20:], first=whole.first + 20,
                  intervals=whole.intervals[20:])
    together = evaluate(['dcf'], [whole, cut], jobs=0)
    alone = run_tracker(create_tracker('dcf', seed=0), cut.frames(), cut.first_box, cut.steps)
    np.testing.assert_array_equal(together.runs('cut', 'dcf')[0].boxes, alone.boxes)


def test_a_scene_with_another_truth_is_run_again(tmp_path):
    """Runs of a scene that was cut, or starts elsewhere, aren't those of the whole one."""
    cache = RunCache(tmp_path / 'cache')
    whole = scene_sequence('face_fast')
    moved, short = replace(whole, truth=whole.truth + 3), replace(whole, truth=whole.truth[:20])
    evaluate(['dcf'], [whole], jobs=0, cache=cache)
    for one in (moved, short):
        cached, fresh = (evaluate(['dcf'], [one], jobs=0, cache=kept) for kept in (cache, None))
        assert not cached.problems and cached.timings == 'measured'
        np.testing.assert_array_equal(cached.runs('face_fast', 'dcf')[0].boxes,
                                      fresh.runs('face_fast', 'dcf')[0].boxes)


def test_stress_follows_the_target_of_each_sequence(two_sequences):
    """Two truths of one video, or a part of it, have their own stressed frames."""
    [one] = read_folder(two_sequences / 'First')
    others = [replace(one, truth=one.truth + 20), replace(one, truth=one.truth[:6])]
    stressed = [stressed_sequence(each, 'hidden', 2) for each in (one, *others)]
    together = evaluate(['dcf'], stressed, jobs=0)
    for name, each in zip(together.sequences, stressed):
        alone = run_tracker(create_tracker('dcf', seed=0), each.frames(), each.first_box)
        np.testing.assert_array_equal(together.runs(name, 'dcf')[0].boxes, alone.boxes)
    moved = replace(stressed[0], truth=stressed[0].truth + 1)
    assert moved.fingerprint() != stressed[0].fingerprint()


def test_no_picture_is_kept(two_sequences):
    """After an evaluation in this process, also an interrupted one, no frame is in memory."""
    [first, _] = find_sequences(two_sequences)[0]
    seen = []

    class Watched(FolderSequence):
        """A sequence that keeps weak references to its frames."""

        def frames(self):
            """Decode them, and keep weak references."""
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


def test_a_seed_that_failed_on_one_sequence(two_sequences, tmp_path):
    """The summary is of the seeds that ran on all sequences; runs of the others are kept, too."""
    cache = RunCache(tmp_path / 'cache')
    evaluate(['pf'], two_sequences, seeds=1, jobs=0, cache=cache)
    [first, second] = find_sequences(two_sequences)[0]
    evaluate(['pf'], [first], seeds=2, jobs=0, cache=cache)

    class Torn(FolderSequence):
        """A sequence whose frames can't be read, with the fingerprint of the good one."""

        def fingerprint(self):
            """Return that of the good one."""
            return second.fingerprint()

        def frames(self):
            """Raise the error."""
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
