"""The films of the benchmark in which the camera comes near its target."""

import numpy as np
import pytest


@pytest.mark.parametrize(('first', 'last'), [(24, 240), (120, 60)])
def test_truth_is_where_the_target_is_drawn(from_benchmarks, monkeypatch, first, last):
    """The centre of what is drawn is that of the true box, to a fifth of a pixel."""
    nearing = from_benchmarks('nearing')
    # a bright square on dark ground has a centre that can be measured
    monkeypatch.setattr(nearing, '_texture', lambda rng, width, height, mean, contrast: np.full(
        (height, width, 3), 200 if width == nearing.TARGET else 60, np.uint8))
    film = nearing.film(first, last, 12, 0)
    for frame, (x, y, width, height) in zip(film.frames, film.truth):
        left, top = round(x - width / 2), round(y - height / 2)
        # the noise is at most 6: it isn't in the weights
        weights = np.clip(frame[top:top + round(2 * height), left:left + round(2 * width), 0]
                          .astype(float) - 80, 0, 100)
        rows, columns = np.indices(weights.shape) + 0.5
        found = np.array([(weights * columns).sum(), (weights * rows).sum()]) / weights.sum()
        np.testing.assert_allclose(
            found + (left, top), (x + width / 2, y + height / 2), atol=0.2)
