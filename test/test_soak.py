"""The soak of benchmarks/soak.py, for seconds instead of an hour."""

from soak import Bench, soak


def test_a_node_keeps_what_it_has():
    """Neither memory nor threads nor open files grow with the images."""
    bench = Bench()
    try:
        first, *_, last = soak(bench, windows=4, seconds=1.5, rate=60)
    finally:
        bench.close()
    assert last.found > 0
    assert (last.threads, last.descriptors) == (first.threads, first.descriptors)
    # The frames kept for selections are 16 MB, there after some twenty.
    assert last.rss_mb - first.rss_mb < 4
