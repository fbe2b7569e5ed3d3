"""Pictures of what a tracker does."""

import os

import cv2
import numpy as np
import pytest

from vtrack_ros.drawing import AnnotatedFrame, Film


@pytest.mark.parametrize('shade', [0, 120, 255])
@pytest.mark.parametrize('text', ['8', '12  searching 0.87', 'W' * 30])
def test_text_is_as_wide_as_its_outline(shade, text):
    """White letters are complete, with a black outline of one pixel, and nothing else changes."""
    canvas = AnnotatedFrame(np.full((40, 500, 3), shade, np.uint8), enlarge=False)
    canvas.text(text)
    picture = canvas.picture.astype(int)
    plain = np.zeros((40, 500), np.uint8)
    cv2.putText(plain, text, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1, cv2.LINE_AA)
    assert (picture[plain == 255] == 255).all()
    near = cv2.dilate(plain, np.ones((3, 3), np.uint8)) > 0
    assert (picture[~near] == shade).all()
    edge = cv2.dilate((plain == 255).astype(np.uint8), np.ones((3, 3), np.uint8)) & (plain == 0)
    assert (picture[edge > 0] == 0).all()


def test_pictures_of_several_sizes(tmp_path):
    """They are fitted to the size of the first one, in the video and on the sheet."""
    with Film(tmp_path, 10, 6) as film:
        for index in range(6):
            shape = (60, 80, 3) if index % 2 else (48, 64, 3)
            film.add(np.full(shape, 40 * index, np.uint8), 'waiting')
    video, sheet = film.paths
    capture = cv2.VideoCapture(str(video))
    shapes = [frame.shape for found, frame in iter(capture.read, (False, None))]
    assert len(shapes) == 6 and len(set(shapes)) == 1
    height, width = shapes[0][:2]
    assert cv2.imread(str(sheet)).shape == (2 * height + 12, 4 * width + 20, 3)


@pytest.mark.parametrize('rate, shown', [(1e-4, 0.01), (1e6, 1000.0)])
def test_rates_that_no_video_has(tmp_path, rate, shown):
    """A video of a bag with an image per hour, or per microsecond, is made all the same."""
    with Film(tmp_path, rate, 3) as film:
        for _ in range(3):
            film.add(np.zeros((48, 64, 3), np.uint8), 'waiting')
    video = cv2.VideoCapture(str(film.paths[0]))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(shown)


@pytest.mark.parametrize('shape', [(3000, 2), (2, 3000, 3), (1, 1)])
def test_a_sliver_is_drawn_no_larger_than_it_has_to_be(shape):
    """It's enlarged by its longer side; by the other one a narrow column would take gigabytes."""
    assert max(AnnotatedFrame(np.zeros(shape, np.uint8)).picture.shape) == max(480, *shape)


@pytest.mark.parametrize('shape, size', [
    ((20, 9000, 3), (8190, 18)), ((9000, 1), (2, 8190)), ((1, 400), (400, 2))])
def test_pictures_that_no_video_can_have(tmp_path, shape, size):
    """Those of a line camera or a panorama are reduced; before, there were no results at all."""
    with Film(tmp_path, 25, 2) as film:
        for _ in range(2):
            film.add(np.zeros(shape, np.uint8), 'waiting')
    found, picture = cv2.VideoCapture(str(film.paths[0])).read()
    assert found and picture.shape[1::-1] == size
    assert cv2.imread(str(film.paths[1])).shape[0] == size[1] + 8


def test_a_folder_whose_name_is_not_utf8(tmp_path):
    """It's an error, for OpenCV would end the process."""
    folder = tmp_path / os.fsdecode(b'\xff')
    folder.mkdir()
    with pytest.raises(OSError, match='UTF-8'), Film(folder, 25, 1) as film:
        film.add(np.zeros((20, 30, 3), np.uint8), '')
    assert not list(folder.iterdir())


def test_half_a_video_is_none(tmp_path):
    """After an error no partial video is left."""
    with pytest.raises(KeyboardInterrupt), Film(tmp_path, 10, 6) as film:
        film.add(np.zeros((48, 64, 3), np.uint8), 'waiting')
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []
