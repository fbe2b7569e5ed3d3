"""The page, the charts and the moments."""

from html.parser import HTMLParser
import math
from xml.etree import ElementTree

from evaluation_material import write_sequence
import numpy as np
import pytest

from vtrack_ros.evaluation import evaluate
from vtrack_ros.evaluation.charts import bar_chart, Curve, line_chart, thinned, ticks
from vtrack_ros.evaluation.moments import worst_moments
from vtrack_ros.evaluation.report_html import html_page
from vtrack_ros.evaluation.results import Problem
from vtrack_ros.evaluation.running import Run

VOID = {'meta', 'br', 'img', 'link', 'input'}


class Page(HTMLParser):
    """Collects tags and references, and checks that every tag is closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.references, self.open = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        """Remember a tag and what it refers to."""
        self.tags.append(tag)
        self.references += [value for key, value in attributes
                            if key in ('src', 'href', 'xlink:href', 'data', 'action')]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        """Remember a tag that closes itself."""
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        """Check that it closes the last one that's open."""
        assert self.open.pop() == tag


def boxes_run(boxes):
    """Return a run that said these boxes."""
    count = len(boxes)
    return Run(np.array(boxes, dtype=float), np.zeros((count, 2, 2)), np.ones(count),
               np.ones(count, dtype=bool), np.ones(count - 1), np.ones(count - 1))


def test_page_is_whole_and_refers_to_nothing(tmp_path):
    """Every tag is closed; pictures are in the page; no address is outside."""
    write_sequence(tmp_path / 'Some & <such>')
    results = evaluate(['pf', 'gmpf'], tmp_path, seeds=2, jobs=0)
    results.problems.append(Problem('Torn', '', 'no images'))
    text = html_page(results)
    page = Page(text)
    assert page.open == []
    assert page.references and all(one.startswith('data:image/jpeg') for one in page.references)
    assert '@import' not in text and 'url(' not in text and 'script' not in page.tags
    assert 'Torn: no images' in text
    assert 'Some &amp; &lt;such&gt;' in text and '<such>' not in text


def test_worst_moments():
    """The start of the longest loss first, then the least overlap; near ones count once."""
    truth = np.tile([50.0, 50, 20, 20], (100, 1))
    lost = truth.copy()
    lost[10:13, 0] = 300
    lost[40:60, 0] = 300
    weak = truth.copy()
    weak[70, 0] += 8
    runs = {'weak': boxes_run(weak), 'lost': boxes_run(lost)}
    assert [(moment.index, moment.tracker) for moment in worst_moments(runs, truth)] == [
        (10, 'lost'), (40, 'lost'), (70, 'weak')]
    assert [(moment.index, moment.tracker) for moment in worst_moments(runs, truth, 2)] == [
        (40, 'lost'), (70, 'weak')]


@pytest.mark.parametrize(('low', 'high', 'expected'), [
    (0, 1, [0, 0.2, 0.4, 0.6, 0.8, 1]), (0, 50, [0, 10, 20, 30, 40, 50]), (3, 3, [3])])
def test_ticks(low, high, expected):
    """Ticks are round numbers."""
    assert ticks(low, high) == pytest.approx(expected)


def test_thinned_curve_keeps_the_peaks():
    """A peak of a single frame survives."""
    y = np.zeros(5000)
    y[3333] = 7
    x, thin = thinned(np.arange(5000.0), y, 100)
    assert len(x) == len(thin) == 100
    assert thin.max() == 7 and x[thin.argmax()] == 3333


def test_charts_are_well_formed():
    """A gap breaks a line in two; a bar without a value is left out."""
    x = np.arange(5.0)
    text = line_chart([Curve('a & b', '#123', x, np.array([1, 2, math.nan, 3, 4]))], 'x', 'y',
                      shaded=[(1, 2)])
    root = ElementTree.fromstring(text)
    [line] = [path for path in root.iter('path') if path.get('class') == 'line']
    assert line.get('d').count('M') == 2
    bars = ElementTree.fromstring(bar_chart(
        {'one': {'a': (0.5, 0.1), 'b': (math.nan, math.nan)}}, {'a': '#111', 'b': '#222'}))
    assert [bar.get('fill') for bar in bars.iter('rect')] == ['#111']
