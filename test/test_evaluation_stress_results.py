"""Trackers under stress: what the command prints and writes, and what a filter changed."""

import json

from evaluation_material import boxes_run, write_sequence
import numpy as np
import pytest

from vtrack_ros.cli.command_line import main
from vtrack_ros.evaluation import evaluate, parse_tracker, tracker_specification
from vtrack_ros.evaluation.results import Results
from vtrack_ros.evaluation.sequences import read_folder
from vtrack_ros.evaluation.stress_results import evaluate_stress, StressResults
from vtrack_ros.evaluation.stress_table import stress_json
from vtrack_ros.trackers import tracker_class


@pytest.fixture(scope='module')
def square(tmp_path_factory):
    """Return a sequence of a red square, 8 frames long."""
    return read_folder(write_sequence(tmp_path_factory.mktemp('stress') / 'Square', 8))[0]


def test_command(square, tmp_path, capsys):
    """The tables are printed, the page has a chart of each kind, and JSON the figures."""
    words = ['evaluate', '--sequences', str(square.images[0].parent.parent), '--trackers', 'pf',
             '--stress', 'rate,shake,particles', '--jobs', '1', '--cache', str(tmp_path / 'cache'),
             '--json', str(tmp_path / 'a.json')]
    assert main([*words, '--html', str(tmp_path / 'a.html')]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ['AUC', 'under', 'stress', 'pf', 'dcf'] in lines
    assert ['differs', 'from', 'dcf', 'pf'] in lines
    names = [' '.join(line[:2]) for line in lines]
    assert {'rate 2', 'rate 5', 'shake 0.3', 'shake 1', 'particles 10'} <= set(names)
    content = json.loads((tmp_path / 'a.json').read_text())
    shake = content['stress']['kinds']['shake']
    assert shake['severities'] == [0.3, 0.6, 1.0]
    assert shake['auc']['pf'][0] == content['summary']['pf']['auc']
    assert all(0 <= value <= 1 for value in shake['auc']['dcf'])
    assert set(shake['changed']['pf']) == {'share', 'distance', 'gain'}
    mean = np.mean([kind['auc']['pf'][1:] for kind in content['stress']['kinds'].values()])
    assert content['stress']['mean_auc']['pf'] == pytest.approx(mean)
    assert content['stress']['sequences']['Square (rate 5)']['pf'] > 0
    page = (tmp_path / 'a.html').read_text()
    for word in ('Under stress', 'every n-th frame', 'up to [sides]', 'Frames in which'):
        assert word in page

    assert main(words) == 0
    assert 'times cached' in capsys.readouterr().out
    again = json.loads((tmp_path / 'a.json').read_text())
    assert again['stress'] == content['stress']
    main([*words, '--stress', 'shake', '--stress-seed', '1'])
    other = json.loads((tmp_path / 'a.json').read_text())['stress']
    assert list(other['kinds']) == ['shake']
    assert other['kinds']['shake']['auc'] != shake['auc']


def test_particles(square):
    """Trackers that have particles run with fewer; the others as they are."""
    stress = evaluate_stress(['pf'], [square], ['particles'], jobs=0)
    level = stress.of_kind('particles')[10]
    direct = evaluate(['pf:particles=10', 'dcf'], [square], jobs=0)
    for label, text in (('pf', 'pf:particles=10'), ('dcf', 'dcf')):
        np.testing.assert_array_equal(level.runs('Square', label)[0].boxes,
                                      direct.runs('Square', text)[0].boxes)
    assert not stress.plain.problems


def test_no_tracker_gets_more_particles_than_it_has(square):
    """A severity above a tracker's own number of particles leaves it as it is."""
    label = 'pf_paper:particles=15'
    stress = evaluate_stress([label], [square], ['particles'], jobs=0)
    own = stress.plain.runs('Square', label)[0].boxes
    boxes = {count: results.runs('Square', label)[0].boxes
             for count, results in stress.of_kind('particles').items()}
    np.testing.assert_array_equal(boxes[50], own)
    np.testing.assert_array_equal(boxes[20], own)
    assert (boxes[10] != own).any()


def test_each_severity_of_particles_has_its_figures_in_json(square):
    """The frames are the plain ones, but each severity has a name of its own, as other kinds."""
    stress = evaluate_stress(['pf'], [square], ['rate', 'particles'], jobs=0)
    sequences = stress_json(stress)['sequences']
    assert list(sequences) == [f'Square ({kind} {severity:g})' for kind, severity in stress.levels]
    for severity, results in stress.of_kind('particles').items():
        assert sequences[f'Square (particles {severity:g})']['pf'] == (
            results.summary['pf']['auc'])


def test_decoded_once(square):
    """Each process decodes a video once for all trackers and severities that have its length."""
    decoded = []

    class Counted(type(square)):
        """The sequence, which counts the frames that it decodes."""

        def frames(self):
            """Count, and decode."""
            for frame in super().frames():
                decoded.append(frame)
                yield frame

    counted = Counted(square.name, square.truth, square.images)
    evaluate_stress(['dcf'], [counted], ['shake', 'noise'], jobs=0)
    assert len(decoded) <= 8 + 1


def test_influence(square):
    """Two of seven frames differ, by half a side; there the overlap is 1/3 instead of 1."""
    results = Results([square], [parse_tracker('pf'), parse_tracker('dcf')], (0,))
    apart = square.truth.copy()
    apart[[0, 3], 0] += 12
    apart[5, 1] -= 12
    apart[6, 0] += 1
    results.add('Square', 'dcf', 0, boxes_run(square.truth))
    results.add('Square', 'pf', 0, boxes_run(apart))
    found = StressResults(results, {('shake', 0.3): results}, 0).influence('shake', 'pf')
    assert found.share == pytest.approx(2 / 7)
    assert found.distance == pytest.approx(0.5)
    assert found.gain == pytest.approx(1 / 3 - 1)


def test_broken_sequence_is_skipped(square, tmp_path):
    """One whose first image can't be read is named, and the others go on."""
    torn = read_folder(write_sequence(tmp_path / 'Torn', 3))[0]
    torn.images[0].write_bytes(b'torn')
    stress = evaluate_stress(['dcf'], [torn, square], ['rate'], jobs=0)
    assert [problem.sequence for problem in stress.plain.problems] == ['Torn']
    assert stress.auc('rate', 'dcf')[1] > 0


def test_means_over_fewer_targets_are_named(square, tmp_path, capsys, monkeypatch):
    """A tracker that fails on a target only under stress isn't compared silently."""
    class Choosy(tracker_class('dcf')):
        """A tracker that accepts no target at the left of a small image."""

        def _start(self, frame, box):
            if frame.shape[0] < 50 and box.x < 8:
                raise ValueError('too far to the left')
            return super()._start(frame, box)

    for name, left in (('First', 20), ('Second', 26)):
        write_sequence(tmp_path / 'data' / name, 3, [f'{left},30,24,24'] * 3)
    monkeypatch.setattr(tracker_specification, 'tracker_class',
                        lambda name: Choosy if name == 'dcf' else tracker_class(name))
    assert main(['evaluate', '--sequences', str(tmp_path / 'data'), '--trackers', 'pf,dcf',
                 '--jobs', '1', '--no-cache', '--stress', 'resolution,particles',
                 '--html', str(tmp_path / 'a.html')]) == 1
    told = 'dcf: means over 1 of 2 targets; it failed on '
    printed = capsys.readouterr().out
    assert f'\nresolution 3: {told}First (resolution 3)\n' in printed
    assert printed.count(told) == 1
    assert f'resolution 3: {told}First' in (tmp_path / 'a.html').read_text()


def test_wrong_kind(square, capsys):
    """An unknown kind ends with 2, or is a ValueError, and the valid ones are listed."""
    with pytest.raises(ValueError, match="unknown kind of stress 'rain'"):
        evaluate_stress(['dcf'], [square], ['rain'], jobs=0)
    folder = str(square.images[0].parent.parent)
    assert main(['evaluate', '--sequences', folder, '--stress', 'rain']) == 2
    assert "unknown kind of stress 'rain'; valid are all, rate, gaps" in capsys.readouterr().err
