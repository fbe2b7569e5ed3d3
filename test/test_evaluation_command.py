"""The command `vtrack evaluate`: its table and files, and what it says when something is wrong."""

from dataclasses import replace
import json
import os
import shutil
import sys

from evaluation_material import write_truth
import pytest

from vtrack_ros.cli import evaluate_command
from vtrack_ros.cli.command_line import main
from vtrack_ros.evaluation import tracker_specification
from vtrack_ros.evaluation.scoring import FIGURES
from vtrack_ros.evaluation.sequences import read_folder
from vtrack_ros.scenes import scene_names
from vtrack_ros.trackers import tracker_class


def test_command(two_sequences, tmp_path, capsys):
    """The command prints a table, writes JSON with all figures, and ends with 0."""
    code = main(['evaluate', '--sequences', str(two_sequences), '--trackers', 'pf', '--seeds', '2',
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


def test_command_skips_what_is_broken(two_sequences, tmp_path, capsys):
    """A broken sequence is named, the others are evaluated, and the code is 1."""
    (two_sequences / 'Second' / 'img' / '00003.png').write_bytes(b'torn')
    (two_sequences / 'Third').mkdir()
    code = main(['evaluate', '--sequences', str(two_sequences), '--trackers', 'pf', '--no-cache',
                 '--json', str(tmp_path / 'a.json')])
    assert code == 1
    errors = capsys.readouterr().err
    assert '00003.png' in errors and 'Third' in errors
    content = json.loads((tmp_path / 'a.json').read_text())
    assert content['sequences']['First']['pf']['auc'] > 0
    assert content['sequences']['Second'] == {}
    assert {problem['sequence'] for problem in content['problems']} == {'Second', 'Third'}


@pytest.mark.parametrize('more', [[], ['--no-cache'], ['--stress', 'rate'],
                                  ['--no-cache', '--stress', 'rate']])
def test_a_file_that_cannot_be_read_hides_no_other_sequence(two_sequences, tmp_path, more, capsys):
    """A dangling link among the images is an error of that sequence alone."""
    for number in range(1, 9):
        path = two_sequences / 'Second' / 'img' / f'{number:05}.png'
        path.unlink()
        path.symlink_to(tmp_path / 'nowhere')
    assert main(['evaluate', '--sequences', str(two_sequences), '--trackers', 'dcf', '--jobs', '1',
                 '--cache', str(tmp_path / 'cache'), '--json', str(tmp_path / 'a.json'),
                 *more]) == 1
    assert 'failed: Second: ' in (told := capsys.readouterr().err) and 'No such file' in told
    content = json.loads((tmp_path / 'a.json').read_text())
    assert content['sequences']['First']['dcf']['auc'] > 0
    assert {problem['sequence'] for problem in content['problems']} == {'Second'}


def test_names_that_are_not_utf8(two_sequences, tmp_path, capsys):
    """Tables, JSON and page have them with their other bytes as numbers, also under stress."""
    for name, place in ((b'M\xfcller', 'First'), (b'Torn \xe9', 'Second')):
        (two_sequences / place).rename(two_sequences / os.fsdecode(name))
    write_truth(two_sequences / os.fsdecode(b'Torn \xe9'), ['none'])
    code = main(['evaluate', '--sequences', str(two_sequences), '--trackers', 'dcf', '--jobs', '1',
                 '--cache', str(tmp_path / 'cache'), '--json', str(tmp_path / 'a.json'),
                 '--html', str(tmp_path / 'a.html'), '--stress', 'rate'])
    output = capsys.readouterr()
    assert code == 1, output.err
    assert 'M\\xfcller' in output.out
    content = json.loads((tmp_path / 'a.json').read_text())
    assert list(content['sequences']) == ['M\\xfcller']
    assert [one['sequence'] for one in content['problems']] == ['Torn \\xe9']
    assert 'M\\xfcller' in (tmp_path / 'a.html').read_text()


def test_means_over_fewer_targets_are_named(two_sequences, tmp_path, capsys, monkeypatch):
    """A tracker that fails on a target where another one doesn't isn't compared silently."""
    class Choosy(tracker_class('dcf')):
        """A tracker that accepts no target at the top of the image."""

        def _start(self, frame, box):
            if box.y < 31:
                raise ValueError('too high')
            return super()._start(frame, box)

    write_truth(two_sequences / 'Second', ['20,32,24,24'] * 8)
    monkeypatch.setattr(tracker_specification, 'tracker_class',
                        lambda name: Choosy if name == 'dcf' else tracker_class(name))
    words = ['evaluate', '--sequences', str(two_sequences), '--trackers', 'pf,dcf', '--jobs', '1',
             '--no-cache', '--html', str(tmp_path / 'a.html')]
    assert main(words) == 1
    told = 'dcf: means over 1 of 2 targets; it failed on First'
    assert told in capsys.readouterr().out
    assert told in (tmp_path / 'a.html').read_text()
    assert main([*words, '--trackers', 'dcf']) == 1
    assert 'means over' not in capsys.readouterr().out


@pytest.mark.parametrize(('arguments', 'message'), [
    ([], 'no sequences given'),
    (['--sequences', 'nowhere'], 'no such folder'),
    (['--bags', 'nowhere'], 'no such bag'),
    (['--scenes', 'nowhere'], 'unknown scene'),
    (['--scenes', 'nowhere,all'], 'unknown scene'),
    (['--scenes', ','], 'no sequences given'),
    (['--sequences', '.', '--trackers', 'nobody'], 'unknown tracker'),
    (['--sequences', '.', '--seeds', '0'], 'an integer'),
    (['--sequences', '.', '--json', 'nowhere/a.json'], 'no folder'),
    (['--sequences', '.', '--html', 300 * 'x'], f"can't write {300 * 'x'}: File name too"),
])
def test_wrong_arguments(arguments, message, capsys):
    """Wrong arguments end with 2 and say what is wrong."""
    assert main(['evaluate', *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize('text, names', [
    ('football, ,face_fast,football,', ['football', 'face_fast']),
    ('all,football', scene_names())])
def test_lists_of_scenes(two_sequences, monkeypatch, text, names):
    """Each scene is taken once; `all` is every one; empty names are left out."""
    taken = []

    def short(name):
        taken.append(name)
        return replace(read_folder(two_sequences / 'Second')[0], name=name)

    monkeypatch.setattr(evaluate_command, 'scene_sequence', short)
    assert main(['evaluate', '--scenes', text, '--trackers', 'dcf', '--jobs', '1',
                 '--no-cache']) == 0
    assert sorted(taken) == sorted(names)


def test_relative_paths_on_workers_elsewhere(two_sequences, repository, monkeypatch, capsys):
    """Dask workers find a sequence and a bag that are named relative to the command's folder."""
    pytest.importorskip('distributed', reason='needs distributed')
    pytest.importorskip('rosbags', reason='needs rosbags')
    from distributed import Client
    shutil.copytree(repository / 'bags' / 'face_fast', two_sequences.parent / 'bag')
    monkeypatch.chdir(two_sequences.parent)
    with Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client:
        client.run(os.chdir, '/')
        code = main(['evaluate', '--sequences', 'data', '--bags', 'bag', '--trackers', 'dcf',
                     '--no-cache', '--backend', 'dask',
                     '--scheduler', client.scheduler_info()['address']])
    assert (code, 'failed' in capsys.readouterr().err) == (0, False)


@pytest.mark.parametrize(('workers', 'code', 'message'), [
    (0, 2, 'has no worker'), (1, 0, 'runs everything in this process')])
def test_cluster_of_few_workers(two_sequences, workers, code, message, capsys):
    """A cluster that will not do the work is named."""
    pytest.importorskip('distributed', reason='needs distributed')
    from distributed import LocalCluster
    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        assert main(['evaluate', '--sequences', str(two_sequences), '--trackers', 'dcf',
                     '--no-cache', '--backend', 'dask',
                     '--scheduler', cluster.scheduler_address]) == code
    assert message in capsys.readouterr().err


def test_dask_that_is_missing(two_sequences, monkeypatch, capsys):
    """One line says what to install."""
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert main(['evaluate', '--sequences', str(two_sequences), '--backend', 'dask']) == 1
    assert 'pip install distributed' in capsys.readouterr().err


@pytest.mark.parametrize('missing', ['joblib', 'tqdm', 'jinja2', 'matplotlib'])
def test_library_that_is_missing(two_sequences, tmp_path, missing, monkeypatch, capsys):
    """One line says what to install, before anything is evaluated for a page that can't be."""
    monkeypatch.setitem(sys.modules, missing, None)
    for module in ('report', 'charts'):
        monkeypatch.delitem(sys.modules, f'vtrack_ros.evaluation.{module}', raising=False)
    assert main(['evaluate', '--sequences', str(two_sequences), '--trackers', 'pf', '--jobs', '1',
                 '--no-cache', '--html', str(tmp_path / 'page.html')]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert f'pip install {missing}' in lines[-1]
    assert not any('1/2 runs' in line or '2/2 runs' in line for line in lines)


def test_manual_names_every_figure(repository):
    """Every figure that can be in a JSON file is explained in the manual."""
    manual = (repository / 'docs' / 'evaluate.md').read_text()
    for figure in FIGURES:
        assert f'`{figure.key}`' in manual
