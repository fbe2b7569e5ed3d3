"""The filters' benchmarks run, and their JSON has the documented shape."""

import json
import math

import pytest

METRICS = ('rmse_mean', 'rmse_median', 'rmse_var', 'seconds_per_run')


@pytest.fixture
def run(from_benchmarks, monkeypatch, capsys):
    """Return a call of a benchmark's main function, which returns what was printed."""
    def call(script, *arguments):
        module = from_benchmarks(script)
        for name in ('STEPS', 'GREY_STEPS', 'REFERENCE_PARTICLES'):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, 8)
        assert module.main(list(arguments)) == 0
        return capsys.readouterr().out
    return call


def test_ung(run, tmp_path):
    """Every filter on both models has its figures, in the JSON and in a row of the table."""
    file = tmp_path / 'ung.json'
    printed = run('ung', '--runs', '2', '--particles', '20', '--json', str(file))
    results = json.loads(file.read_text(encoding='utf-8'))
    for model in ('ung', 'vandermerwe'):
        table = printed.partition(f'### {model}\n')[2].partition('###')[0]
        for name in ('pf', 'epf', 'upf', 'qkpf', 'pqkpf'):
            entry = results[model][name]
            assert all(math.isfinite(entry[metric]) for metric in METRICS)
            assert entry['rmse_mean'] > 0 and entry['seconds_per_run'] > 0
            low, mean, high = (entry['difference_to_qkpf'][key] for key in ('low', 'mean', 'high'))
            assert low <= mean <= high
            assert f'| {name} |' in table
        # Pruning as printed prunes nothing in one dimension, and the seeds are the same.
        assert results[model]['pqkpf']['rmse_mean'] == results[model]['qkpf']['rmse_mean']


def test_filters(run, tmp_path):
    """Every step has its time, every rule its points and its error."""
    file = tmp_path / 'filters.json'
    printed = run('filters', '--runs', '2', '--repeats', '1', '--json', str(file))
    results = json.loads(file.read_text(encoding='utf-8'))
    for name, entry in results['speed'].items():
        assert entry['ratio'] > 0 and f'| {name} |' in printed
    radar = results['rules']['4-D, 1 m, 0.01 rad']
    assert radar['full product']['points'] == 81 and radar['pruned']['points'] == 33
    for entries in results['rules'].values():
        # Order 3 on the position is the same integral as on the whole state.
        assert entries['position only']['rmse_mean'] == pytest.approx(
            entries['full product']['rmse_mean'], rel=1e-6)


@pytest.mark.parametrize('script', ['ung', 'filters'])
def test_help_and_bad_arguments(run, script, capsys):
    """Help names the options; a number of runs must be positive."""
    with pytest.raises(SystemExit, match='0'):
        run(script, '--help')
    helped = capsys.readouterr().out
    assert '--runs' in helped and '--json' in helped
    with pytest.raises(SystemExit, match='2'):
        run(script, '--runs', '0')
    assert 'at least 1' in capsys.readouterr().err
