"""The figures of merit, against hand-made boxes and naive computations."""

import math

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from vtrack_ros.evaluation import calibration, metrics
from vtrack_ros.evaluation.runner import Run
from vtrack_ros.evaluation.scoring import score
from vtrack_ros.evaluation.stream_score import StreamScore
from vtrack_ros.geometry import Box

NAN = [math.nan] * 4
SIDES = st.integers(1, 60)
PLACES = st.integers(-40, 40)
BOXES = st.tuples(PLACES, PLACES, SIDES, SIDES)


def test_overlap_of_hand_made_boxes():
    """The same, half shifted, quarter shifted both ways, inside, touching, apart, absent."""
    truth = [(0, 0, 10, 10)] * 6 + [NAN, (5, 5, 0, 4)]
    boxes = [(0, 0, 10, 10), (5, 0, 10, 10), (5, 5, 10, 10), (2, 2, 5, 5), (10, 0, 10, 10),
             (30, 30, 10, 10), (0, 0, 10, 10), (0, 0, 10, 10)]
    expected = [1, 50 / 150, 25 / 175, 25 / 100, 0, 0, math.nan, math.nan]
    np.testing.assert_allclose(metrics.overlaps(boxes, truth), expected, rtol=1e-12)


@settings(deadline=None)
@given(BOXES, BOXES)
def test_overlap_counts_pixels(a, b):
    """Of boxes with whole coordinates the overlap is a ratio of numbers of pixels."""
    pixels_a = {(x, y) for x in range(a[0], a[0] + a[2]) for y in range(a[1], a[1] + a[3])}
    pixels_b = {(x, y) for x in range(b[0], b[0] + b[2]) for y in range(b[1], b[1] + b[3])}
    expected = len(pixels_a & pixels_b) / len(pixels_a | pixels_b)
    assert metrics.overlaps([a], [b])[0] == pytest.approx(expected, abs=1e-12)
    assert Box(*a).iou(Box(*b)) == pytest.approx(expected, abs=1e-12)


def test_success_of_known_overlaps():
    """A box that's always right is above 20 of 21 thresholds, an overlap of 1/3 above 7."""
    assert metrics.success_auc(np.ones(5)) == pytest.approx(20 / 21)
    assert metrics.success_auc(np.full(5, 1 / 3)) == pytest.approx(7 / 21)
    assert metrics.success_auc(np.zeros(5)) == 0
    assert metrics.success_auc(np.array([1, 1 / 3, math.nan])) == pytest.approx(13.5 / 21)
    assert math.isnan(metrics.success_auc(np.array([math.nan])))


def test_success_and_precision_against_loops():
    """The curves agree with counting frame by frame and threshold by threshold."""
    rng = np.random.default_rng(3)
    truth = np.column_stack([rng.uniform(0, 90, (200, 2)), rng.uniform(5, 60, (200, 2))])
    boxes = truth + rng.normal(0, 9, truth.shape)
    boxes[:, 2:] = np.maximum(boxes[:, 2:], 1)
    truth[rng.random(200) < 0.1] = math.nan
    pairs = [(Box(*b), Box(*t)) for b, t in zip(boxes, truth) if not np.isnan(t).any()]
    auc = np.mean([[b.iou(t) > step / 20 for b, t in pairs] for step in range(21)])
    assert metrics.success_auc(metrics.overlaps(boxes, truth)) == pytest.approx(auc)
    error = metrics.center_errors(boxes, truth)
    within = [b.center_distance(t) <= 20 for b, t in pairs]
    assert metrics.precision_at(error) == pytest.approx(np.mean(within))
    assert metrics.precision_curve(error)[20] == pytest.approx(np.mean(within))
    normal = [[math.hypot((b.center[0] - t.center[0]) / t.width,
                          (b.center[1] - t.center[1]) / t.height) <= step / 100
               for b, t in pairs] for step in range(51)]
    assert metrics.normalised_precision(
        metrics.normalised_errors(boxes, truth)) == pytest.approx(np.mean(normal))


def test_precision_counts_its_threshold():
    """An error of 20 px is within 20 px."""
    boxes = [(12, 16, 4, 4), (12, 17, 4, 4), (0, 0, 4, 4)]
    error = metrics.center_errors(boxes, [(0, 0, 4, 4)] * 3)
    assert metrics.precision_at(error) == pytest.approx(2 / 3)


def test_shapes_are_checked():
    """Arrays that can't be boxes, or don't fit each other, are refused."""
    with pytest.raises(ValueError, match=r'shape \(n, 4\)'):
        metrics.overlaps([1, 2, 3, 4], [(1, 2, 3, 4)])
    with pytest.raises(ValueError, match='2 boxes but 1 rows of truth'):
        metrics.center_errors([(1, 2, 3, 4)] * 2, [(1, 2, 3, 4)])
    with pytest.raises(ValueError, match=r'covariances must have shape \(1, 2, 2\)'):
        calibration.inside_ellipse([(1, 2, 3, 4)], np.eye(2), [(1, 2, 3, 4)], 0.9)


def test_failures_and_recoveries():
    """A failure begins at overlap 0, lasts through small overlaps and absences, ends above 0.1."""
    overlap = np.array([1, .6, 0, 0, .05, 0, .3, .8, 0, math.nan, 0, .2, 0, 0])
    found = metrics.failures(overlap)
    assert found.count == 3
    assert found.recoveries == (4, 2)
    assert metrics.failures(np.array([1, .05, .02, .9])).count == 0


@settings(deadline=None)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=20),
       st.lists(st.integers(0, 6), min_size=1, max_size=20))
def test_auroc_is_a_probability_of_order(high, low):
    """It is the share of pairs in order, ties by half."""
    pairs = [(a > b) + 0.5 * (a == b) for a in high for b in low]
    assert calibration.auroc(high, low) == pytest.approx(np.mean(pairs))


def test_auroc_without_one_side():
    """Without values of one of the two classes it's NaN."""
    assert math.isnan(calibration.auroc([0.3], []))
    assert math.isnan(calibration.auroc([], [0.3]))


def test_losses_and_their_reports():
    """A loss lasts until the target is hit again; it's reported if the state says so meanwhile."""
    overlap = np.array([1, .7, .05, .0, .3, .6, math.nan, math.nan, .6, .0, .0, .9])
    reported = np.array([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1], dtype=bool)
    found = calibration.losses(overlap, reported)
    assert found.count == 3
    assert found.delays == (1, 0)


def test_report_after_the_end_of_a_loss_is_none():
    """A report that comes only when the box is back on the target doesn't count."""
    overlap = np.array([1, .0, .0, .8, .8])
    reported = np.array([0, 0, 0, 1, 0], dtype=bool)
    assert calibration.losses(overlap, reported) == calibration.Losses(1, ())


def test_returns():
    """Time from the return of the target until the box is on it; infinite where it never is."""
    gone = math.nan
    overlap = np.array([1, gone, gone, .0, .2, .6, gone, .7, gone, .1, gone, .2, .3])
    assert calibration.return_delays(overlap) == (2, 0, math.inf, math.inf)
    assert calibration.return_delays(np.array([1, .2, gone, gone])) == ()


def test_ellipse_holds_its_share_of_a_normal_distribution():
    """Of normal errors the 50 % and 90 % ellipses hold 50 and 90 %, within 4 deviations."""
    count = 4000
    covariance = np.array([[9.0, 5.0], [5.0, 16.0]])
    offsets = np.random.default_rng(5).multivariate_normal([0, 0], covariance, count)
    truth = np.tile([50.0, 40, 20, 10], (count, 1))
    boxes = truth + np.column_stack([offsets, np.zeros((count, 2))])
    for probability in (0.5, 0.9):
        inside = calibration.inside_ellipse(
            boxes, np.tile(covariance, (count, 1, 1)), truth, probability)
        bound = 4 * math.sqrt(probability * (1 - probability) / count)
        assert abs(inside.mean() - probability) < bound


def test_ellipse_of_hand_made_covariances():
    """The 90 % radius of a unit circle is sqrt(2 ln 10) = 2.146."""
    truth = [(0, 0, 4, 4)] * 5
    truth[3] = NAN
    boxes = [(2.1, 0, 4, 4), (2.2, 0, 4, 4), (0, 0, 4, 4), (0, 0, 4, 4), (0, 0, 4, 4)]
    covariances = np.tile(np.eye(2), (5, 1, 1))
    covariances[2] = 0
    covariances[4] = math.nan
    inside = calibration.inside_ellipse(boxes, covariances, truth, 0.9)
    np.testing.assert_array_equal(inside, [1, 0, 0, math.nan, math.nan])


def test_true_runs():
    """Runs of true values are returned as (begin, end), at both ends of the array, too."""
    assert metrics.true_runs(np.array([1, 1, 0, 1, 0, 0, 1], dtype=bool)) == [
        (0, 2), (3, 4), (6, 7)]
    assert metrics.true_runs(np.zeros(3, dtype=bool)) == []


def test_wrong_tracking():
    """TRACKING is wrong off the target and where it's absent; a prediction never is."""
    truth = np.array([(0, 0, 10, 10)] * 6 + [NAN] * 3)
    boxes = np.array([(0, 0, 10, 10), (0, 0, 10, 10), (9, 0, 10, 10), (9, 0, 10, 10),
                      (5, 0, 10, 10), (30, 0, 10, 10), (0, 0, 10, 10), (0, 0, 10, 10),
                      (50, 0, 10, 10)])
    measured = np.array([1, 1, 1, 0, 1, 1, 1, 0, 1], dtype=bool)
    count = len(truth)
    run = Run(boxes, np.tile(np.eye(2), (count, 1, 1)), np.ones(count), measured,
              np.ones(count - 1), np.ones(count - 1))
    # Of eight frames after the first: overlaps of 1/19 and 0, and two with the target absent.
    assert score(run, truth)['wrong_tracking'] == 4 / 8
    # A stream has no box where none is measured; it's judged by the same measure.
    score_of_stream = StreamScore({index: None if np.isnan(row).any() else Box(*row)
                                   for index, row in enumerate(truth)})
    for index in range(count):
        score_of_stream.add(index, Box(*boxes[index]) if measured[index] else None,
                            given=index == 0)
    assert score_of_stream.figures()['wrong_tracking'] == 4 / 8
    honest = Run(boxes, run.covariances, run.confidences, measured & False, run.wall_ms,
                 run.cpu_ms)
    assert score(honest, truth)['wrong_tracking'] == 0
