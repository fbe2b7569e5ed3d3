"""The page, its charts and its pictures."""

from html.parser import HTMLParser
import re

import cv2
from evaluation_material import boxes_run, write_sequence, write_truth
from matplotlib.textpath import TextPath
import numpy as np
import pytest

from vtrack_ros.evaluation import evaluate
from vtrack_ros.evaluation.charts import bar_chart
from vtrack_ros.evaluation.report import html_page, worst_frames
from vtrack_ros.evaluation.results import Problem

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


def test_page_is_whole_and_refers_to_nothing(tmp_path):
    """Every tag is closed; pictures are in the page; no address is outside."""
    write_sequence(tmp_path / 'Some & <such>')
    results = evaluate(['pf', 'gmpf'], tmp_path, seeds=2, jobs=0)
    results.problems.append(Problem('Torn', '', 'no images'))
    text = html_page(results)
    page = Page(text)
    assert page.open == []
    assert any(one.startswith('data:image/jpeg') for one in page.references)
    assert all(one.startswith(('data:image/jpeg', '#')) for one in page.references)
    assert set(re.findall(r'url\(.', text)) <= {'url(#'}
    assert '@import' not in text and 'script' not in page.tags
    for words in ('Success and precision', 'AUC by sequence', 'centre error [px]', 'overlap',
                  'Computing time', '<title>Some &amp; &lt;such&gt;, pf: ', '<title>gmpf</title>'):
        assert words in text
    assert '1 target, 2 trackers, seeds 0, 1;' in text
    assert 'Torn: no images' in text
    assert 'Some &amp; &lt;such&gt;' in text and '<such>' not in text


def test_a_line_of_pixels_has_a_picture(tmp_path):
    """A frame of one row, which would shrink to nothing, has its picture on the page."""
    folder = tmp_path / 'Line'
    (folder / 'img').mkdir(parents=True)
    for index in range(4):
        line = np.random.default_rng(index).integers(256, size=(1, 2000), dtype=np.uint8)
        cv2.imwrite(str(folder / 'img' / f'{index + 1:05}.png'), line)
    write_truth(folder, ['900,0,40,1'] * 4)
    page = Page(html_page(evaluate(['dcf'], tmp_path, seeds=1, jobs=0)))
    assert any(one.startswith('data:image/jpeg') for one in page.references)


@pytest.mark.parametrize('name', [
    'Toy', 'rosbag2_2026_11_30-10_22_31', '$1_$2', 'a_{b$c$', 'first' + 9 * '_recording' + '_1'])
@pytest.mark.filterwarnings('error::UserWarning')
def test_names_in_a_chart(name):
    """They are whole, a recorder's own one and what looks like mathematics; or both ends are."""
    chart = bar_chart({name: {'pf': (0.5, 0.1)}}, {'pf': '#123456'})
    [[right, shown]] = re.findall(r' x="([\d.]+)"[^>]*>([^<]*)</text>', chart[:chart.index(
        '<title>')].replace('\n', ' '))[-1:]
    assert shown == name or len(name) > 90 and re.fullmatch('first_.{10,20}….*g_1', shown)
    assert float(right) >= TextPath((0, 0), shown.replace('$', 'S'), size=11).get_extents().width
    assert f'<title>{name}, pf: 0.500</title>' in chart


@pytest.mark.filterwarnings('error::UserWarning')
def test_a_name_in_another_script():
    """It's drawn by the page's font; that the chart's own one lacks it is no warning."""
    assert '>行人<' in bar_chart({'行人': {'pf': (0.5, 0.1)}}, {'pf': '#123456'})


def test_worst_frames():
    """The start of the longest loss first, then the least overlap; near ones count once."""
    truth = np.tile([50.0, 50, 20, 20], (100, 1))
    lost = truth.copy()
    lost[10:13, 0] = 300
    lost[40:60, 0] = 300
    weak = truth.copy()
    weak[70, 0] += 8
    runs = {'weak': boxes_run(weak), 'lost': boxes_run(lost)}
    assert [(frame.index, frame.tracker) for frame in worst_frames(runs, truth)] == [
        (10, 'lost'), (40, 'lost'), (70, 'weak')]
    assert [(frame.index, frame.tracker) for frame in worst_frames(runs, truth, 2)] == [
        (40, 'lost'), (70, 'weak')]
