"""
The pictures of README and the documentation, from the project's own scenes and result files.

`python benchmarks/pictures.py [scenes] [parameters] [click] [animation] [plot] [stress]` writes
docs/images/scenes.jpg, parameters.jpg, click.jpg, tracking.webp, accuracy_speed.svg and
above_dcf.svg; without arguments all of them.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Iterator
import json
from pathlib import Path

import cv2
from matplotlib import rc_context
from matplotlib.figure import Figure
import numpy as np
from PIL import Image

from vtrack_ros.appearance.extent import find_extent, next_extent
from vtrack_ros.drawing import AnnotatedFrame, contact_sheet
from vtrack_ros.evaluation.charts import colour, svg
from vtrack_ros.scenes import render, scene_names
from vtrack_ros.trackers import create_tracker, Frame

ROOT = Path(__file__).resolve().parents[1]
IMAGES, RESULTS = ROOT / 'docs' / 'images', ROOT / 'docs' / 'results'
#: Scene -> frame that shows its difficulty.
TELLING = {'face_fast': 14, 'football': 66, 'similar_occlusion': 106, 'pose_change': 56,
           'scale_change': 76, 'light_change': 66, 'light_step': 60, 'full_occlusion': 66,
           'car_approach': 110, 'helicopter': 100, 'leave_and_return': 52, 'low_light_noise': 30,
           'distractor_cross': 40}
#: Scenes of the animation, side by side -> (first frame, last frame).
ANIMATED = {'scale_change': (20, 110), 'full_occlusion': (30, 120), 'light_change': (20, 110)}
#: Parameters of gmpf on the sheet -> (low value, default, high value).
VARIED = {'particles': (10, 150, 1000), 'acceleration': (0.02, 0.2, 1.0),
          'temperature': (0.01, 0.07, 0.5)}
#: Scenes in which the target is clicked on -> frame.
CLICKED = {'light_change': 0, 'leave_and_return': 20}
FOUND = (60, 220, 60)
#: Size of a picture, [px]; in the animation, step [frames] and duration of each picture, [ms].
SIZE, STEP, SHOWN = (280, 210), 2, 80


def tracked(scene: str, frames: int, **parameters: float) -> Iterator[tuple[Frame, str]]:
    """Yield the pictures of a scene tracked by gmpf, with the estimate drawn, and the state."""
    shots = render(scene, frames=frames)
    first = next(shots)
    tracker = create_tracker('gmpf', seed=0, **parameters)
    estimate = tracker.start(first.frame, first.truth)
    trail: deque[tuple[float, float]] = deque(maxlen=40)
    for shot in (first, *shots):
        if shot is not first:
            estimate = tracker.update(shot.frame)
        trail.append(estimate.box.center)
        picture = AnnotatedFrame(shot.frame)
        picture.trail(trail)
        picture.estimate(estimate)
        yield picture.picture, f'{estimate.state.value} {estimate.confidence:.2f}'


def resized(picture: Frame, text: str) -> Frame:
    """Return a picture in the common size, padded if its aspect differs, with a text on it."""
    scale = min(SIZE[0] / picture.shape[1], SIZE[1] / picture.shape[0])
    small = cv2.resize(picture, None, fx=scale, fy=scale,
                       interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    result = np.full((SIZE[1], SIZE[0], 3), 32, np.uint8)
    y, x = (SIZE[1] - small.shape[0]) // 2, (SIZE[0] - small.shape[1]) // 2
    result[y:y + small.shape[0], x:x + small.shape[1]] = small
    whole = AnnotatedFrame(result, enlarge=False)
    whole.text(text)
    return whole.picture


def captioned(picture: Frame, text: str) -> Frame:
    """Return a picture with a caption in its lowest lines."""
    cv2.rectangle(picture, (0, SIZE[1] - 22), (SIZE[0], SIZE[1]), (32, 32, 32), -1)
    cv2.putText(picture, text, (6, SIZE[1] - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255),
                1, cv2.LINE_AA)
    return picture


def write_scenes(path: Path) -> None:
    """Write a sheet with a picture of each scene."""
    pictures = []
    for name in scene_names():
        *_, last = tracked(name, TELLING[name] + 1)
        pictures.append(captioned(resized(*last), name))
    cv2.imwrite(str(path), contact_sheet(pictures), [cv2.IMWRITE_JPEG_QUALITY, 82])


def write_parameters(path: Path) -> None:
    """Write a sheet that shows the effect of the parameters on a face that moves fast."""
    scene, pictures = 'face_fast', []
    for name, values in VARIED.items():
        for value in values:
            *_, last = tracked(scene, TELLING[scene] + 1, **{name: value})
            pictures.append(captioned(resized(*last), f'{name} {value:g}'))
    cv2.imwrite(str(path), contact_sheet(pictures, columns=3), [cv2.IMWRITE_JPEG_QUALITY, 82])


def write_click(path: Path) -> None:
    """Write a sheet with the extents found about a click, each row by steps in one scene."""
    pictures = []
    for scene, index in CLICKED.items():
        *_, shot = render(scene, frames=index + 1)
        assert shot.truth is not None
        x, y = click = tuple(round(place) for place in shot.truth.center)
        box = find_extent(shot.frame, x, y)
        larger = next_extent(shot.frame, box, larger=True)
        smaller = next_extent(shot.frame, larger, larger=False)
        for extent, text in ((box, 'a click'), (larger, 'Larger'), (smaller, 'Smaller')):
            picture = AnnotatedFrame(shot.frame, enlarge=False)
            picture.box(extent, FOUND)
            cv2.drawMarker(picture.picture, click, (255, 255, 255), cv2.MARKER_CROSS, 12, 2)
            pictures.append(captioned(resized(picture.picture, ''), text))
    cv2.imwrite(str(path), contact_sheet(pictures, columns=3), [cv2.IMWRITE_JPEG_QUALITY, 82])


def write_animation(path: Path) -> None:
    """Write an animated WebP of some scenes side by side."""
    films = [[resized(*one) for one in tracked(name, last)][first::STEP]
             for name, (first, last) in ANIMATED.items()]
    frames = [Image.fromarray(np.hstack(row)[..., ::-1]) for row in zip(*films)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=SHOWN, loop=0,
                   quality=55, method=6)


def write_plot(path: Path) -> None:
    """Write the accuracy on the first sixteen targets against the frame rate."""
    accuracy = json.loads((RESULTS / 'sequences.json').read_text())['summary']
    times = json.loads((RESULTS / 'speed.json').read_text())['image']['640x480']
    names = sorted(filter(accuracy.get, times), key=times.get)
    figure = Figure((6.4, 3.6), layout='constrained')
    axes = figure.add_subplot()
    for index, name in enumerate(names):
        peer = name.startswith('opencv_')
        x, y = 1e3 / times[name], accuracy[name]['auc']
        axes.scatter(x, y, marker='s' if peer else 'o', color=colour(index))
        # Above and below in turn, since some are close together.
        up = index % 2 == 0
        axes.annotate(name.removeprefix('opencv_').upper() if peer else name, (x, y),
                      (0, 7 if up else -7), textcoords='offset points', fontsize=9, rotation=40,
                      ha='left' if up else 'right', va='bottom' if up else 'top',
                      rotation_mode='anchor')
    axes.set_xscale('log')
    axes.set_xticks([10, 20, 50, 100, 200, 500, 1000])
    axes.xaxis.set_major_formatter('{x:g}')
    axes.xaxis.set_minor_formatter('')
    axes.set(xlabel='updates per second of one core, 640 x 480, target of 64 px',
             ylabel='AUC, 16 targets', ylim=(0, 0.9))
    axes.grid(alpha=0.3)
    write_svg(figure, path)


def write_above_dcf(path: Path) -> None:
    """Write by how much gmpf is above dcf, without stress and under each kind of it."""
    halves = json.loads((RESULTS / 'stress.json').read_text())
    figure = Figure((6.4, 4.6), layout='constrained')
    axes = figure.add_subplot()
    for offset, half, label in ((-0.2, 'tuned', '16 tuned targets'),
                                (0.2, 'others', '16 other targets')):
        kinds = halves[half]['kinds']
        gains = [np.mean(each['auc']['gmpf']) - np.mean(each['auc']['dcf'])
                 for each in kinds.values()]
        axes.barh(np.arange(len(gains)) + offset, gains, 0.38, label=label)
    axes.set_yticks(range(len(kinds)), list(kinds))
    axes.invert_yaxis()
    axes.set_xlabel('AUC of gmpf above that of dcf, mean over severities')
    axes.grid(axis='x', alpha=0.3)
    axes.legend()
    write_svg(figure, path)


def write_svg(figure: Figure, path: Path) -> None:
    """Write a figure, the same text for the same figure."""
    with rc_context({'svg.hashsalt': 'vtrack', 'svg.fonttype': 'none'}):
        path.write_text(svg(figure) + '\n', encoding='utf-8')


MADE = {'scenes': (write_scenes, 'scenes.jpg'),
        'parameters': (write_parameters, 'parameters.jpg'),
        'click': (write_click, 'click.jpg'),
        'animation': (write_animation, 'tracking.webp'),
        'plot': (write_plot, 'accuracy_speed.svg'),
        'stress': (write_above_dcf, 'above_dcf.svg')}

if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', choices=[*MADE, 'all'], default='all')
    names = parser.parse_args().names
    for name in MADE if 'all' in names else names:
        write, file = MADE[name]
        write(IMAGES / file)
        print(IMAGES / file)
