"""The filters' benchmarks run, and their JSON has the documented shape."""

import json
import math
import os
from pathlib import Path
import subprocess
import sys

import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / 'benchmarks'
METRICS = ('rmse_mean', 'rmse_median', 'rmse_var', 'seconds_per_run')


def run(script, *arguments):
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(
        [str(BENCHMARKS.parent), os.environ.get('PYTHONPATH', '')])}
    return subprocess.run(
        [sys.executable, str(BENCHMARKS / script), *arguments], env=environment,
        capture_output=True, text=True, timeout=300)


def test_ung(tmp_path):
    file = tmp_path / 'ung.json'
    ended = run('ung.py', '--runs', '3', '--json', str(file))
    assert ended.returncode == 0, ended.stderr
    results = json.loads(file.read_text(encoding='utf-8'))
    for model in ('ung', 'vandermerwe'):
        for name in ('pf', 'epf', 'upf', 'qkpf', 'pqkpf'):
            entry = results[model][name]
            assert all(math.isfinite(entry[metric]) for metric in METRICS)
            assert entry['rmse_mean'] > 0 and entry['seconds_per_run'] > 0
            low, mean, high = (entry['difference_to_qkpf'][key] for key in ('low', 'mean', 'high'))
            assert low <= mean <= high
        # Pruning as printed prunes nothing in one dimension, and the seeds are the same.
        assert results[model]['pqkpf']['rmse_mean'] == results[model]['qkpf']['rmse_mean']
        assert name in ended.stdout and model in ended.stdout


def test_filters(tmp_path):
    file = tmp_path / 'filters.json'
    ended = run('filters.py', '--runs', '2', '--repeats', '2', '--json', str(file))
    assert ended.returncode == 0, ended.stderr
    results = json.loads(file.read_text(encoding='utf-8'))
    assert all(entry['ratio'] > 0 for entry in results['speed'].values())
    radar = results['rules']['4-D, 1 m, 0.01 rad']
    assert radar['full product']['points'] == 81 and radar['pruned']['points'] == 33
    for entries in results['rules'].values():
        # Order 3 on the position is the same integral as on the whole state.
        assert entries['position only']['rmse_mean'] == pytest.approx(
            entries['full product']['rmse_mean'], rel=1e-6)


@pytest.mark.parametrize('script', ['ung.py', 'filters.py'])
def test_help_and_bad_arguments(script):
    helped = run(script, '--help')
    assert helped.returncode == 0
    assert '--runs' in helped.stdout and '--json' in helped.stdout
    refused = run(script, '--runs', '0')
    assert refused.returncode == 2 and 'at least 1' in refused.stderr
