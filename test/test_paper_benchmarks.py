"""The benchmark of the papers' claims: runs in order, intervals, verdicts, and one seed."""

import importlib
import json
from types import SimpleNamespace

import numpy as np
import pytest


def test_a_verdict_needs_an_interval_clear_of_the_limit(from_benchmarks):
    """The verdict is open if the interval contains the limit, or if there are too few runs."""
    outcomes = from_benchmarks('paper_experiments.outcomes')
    rng = np.random.default_rng(1)
    lower, higher = rng.normal(2, 0.1, 12), rng.normal(4, 0.1, 12)
    half = outcomes.ratio(lower, higher)
    assert half.low < 0.5 < half.high or abs(half.value - 0.5) < 0.05
    assert half.below(0.7) == outcomes.HOLDS and half.below(0.3) == outcomes.FAILS
    assert half.above(0.3) == outcomes.HOLDS
    assert outcomes.ratio(lower, rng.permutation(lower)).below(1) == outcomes.OPEN
    assert outcomes.ratio(lower[:1], higher[:1]).below(0.7) == outcomes.OPEN
    assert outcomes.both(outcomes.HOLDS, outcomes.OPEN) == outcomes.OPEN
    assert outcomes.both(outcomes.OPEN, outcomes.FAILS) == outcomes.FAILS


def test_a_share_of_all_runs_has_an_interval_too(from_benchmarks):
    """Ten of ten are above 0.5, three of three are too few; bounds of none are from 0 to 0.5."""
    outcomes = from_benchmarks('paper_experiments.outcomes')
    assert outcomes.share(np.ones(10)).above(0.5) == outcomes.HOLDS
    assert outcomes.share(np.ones(3)).above(0.5) == outcomes.OPEN
    none = outcomes.share(np.zeros(10))
    assert none.low == 0 and 0 < none.high < 0.5


def test_run_k_is_seed_k_on_its_film_and_is_kept(from_benchmarks, tmp_path):
    """Three runs on two films use them in turn; repeated, they come from the cache."""
    films = from_benchmarks('paper_experiments.films')
    outcomes = from_benchmarks('paper_experiments.outcomes')
    cache = importlib.import_module('vtrack_ros.evaluation.cache').RunCache(tmp_path)
    laboratory = films.Laboratory(3, tmp_path / 'none', tmp_path, cache)
    trackers = {'PF': 'pf_paper:particles=20'}
    runs = [laboratory.measure(laboratory.films('face_fast', 2, 5), 2, trackers)['PF']
            for _ in range(2)]
    prints = [one.film.fingerprint for one in runs[0]]
    assert prints[0] == prints[2] != prints[1]
    assert not runs[0][0].run.cached and all(one.run.cached for one in runs[1])
    for before, after in zip(*runs):
        np.testing.assert_array_equal(before.run.boxes, after.run.boxes)
    assert outcomes.figures(runs[0])['error'].shape == (3,)
    assert laboratory.timings == 'mixed'
    again = films.Laboratory(3, tmp_path / 'none', tmp_path, cache)
    assert again.timings == 'measured'
    again.measure(again.films('face_fast', 2, 5), 2, trackers)
    assert again.timings == 'cached'
    assert laboratory.video('David') == []


def test_all_trackers_follow_by_one_standard(from_benchmarks):
    """A box on the target follows it, in any state and of any tracker; the state is beside it."""
    films = from_benchmarks('paper_experiments.films')
    outcomes = from_benchmarks('paper_experiments.outcomes')
    yin = from_benchmarks('paper_experiments.yin')
    truth = np.full((130, 4), 20.0)
    film = SimpleNamespace(truth=truth)

    def runs(tracking):
        return [films.Outcome(film, SimpleNamespace(
            boxes=truth, measured=np.full(130, tracking), cpu_ms=np.ones(130)))] * 10

    measured = {label: runs(label == yin.PF) for label in yin.TRACKERS}
    laboratory = SimpleNamespace(films=lambda *_, **__: [], measure=lambda *_: measured)
    result = outcomes.Experiment()
    yin.light(laboratory, result, 0.5)
    dim, end = result.claims
    assert dim[2] == 'ABMS lost: does not hold; ABMSPF follows: 20 holds, 10 holds'
    assert end[2] == 'PF 200 lost: does not hold; ABMSPF follows: 20 holds, 10 holds'
    for says in (dim[1], end[1]):
        assert 'ABMS 1.00 (0.72 to 1.00)' in says and 'ABMS 0.00, PF 200 1.00' in says


def test_one_seed_gives_json_and_a_page(from_benchmarks, tmp_path):
    """With one seed the page has no standard errors, and open verdicts; other papers are kept."""
    films = from_benchmarks('paper_experiments.films')
    outcomes = from_benchmarks('paper_experiments.outcomes')
    page = from_benchmarks('paper_experiments.page')
    laboratory = films.Laboratory(1, tmp_path, None, None)
    runs = laboratory.measure(laboratory.films('face_fast', 2, 4), 2, {
        name: f'{name}_paper:particles=20' for name in ('pf', 'gmpf')})
    experiment = outcomes.Experiment()
    rows = {label: outcomes.figures(one) for label, one in runs.items()}
    experiment.table('face_fast', rows)
    one = outcomes.ratio(rows['pf']['error'], rows['gmpf']['error'])
    experiment.claim('one', str(one), one.below(1))
    content = {'paper1': {'tables': experiment.tables, 'claims': experiment.claims,
                          'environment': {}, 'timings': 'mixed', 'seeds': 1, 'curves': {}}}
    from_benchmarks('result_files').write_json(tmp_path / 'papers.json', content)
    kept = json.loads((tmp_path / 'papers.json').read_text())
    text = page.filled('a\n<!-- paper1 claims --> <!-- end -->\n<!-- paper1 tables --> '
                       '<!-- end -->\n<!-- paper2 claims --> b <!-- end -->\n', kept)
    assert 'times mixed' in text
    assert '| one | ' in text and '| open |' in text and '**face_fast**' in text
    assert ' ± ' not in text and '<!-- paper2 claims --> b' in text


def test_help_and_bad_arguments(from_benchmarks, capsys):
    """Help names the papers; a number of runs must be positive."""
    papers = from_benchmarks('papers')
    with pytest.raises(SystemExit, match='0'):
        papers.main(['--help'])
    assert 'paper4' in capsys.readouterr().out
    with pytest.raises(SystemExit, match='2'):
        papers.main(['--seeds', '0'])
    assert 'at least 1' in capsys.readouterr().err
