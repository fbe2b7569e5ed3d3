"""The kinds of stress, and how each changes a sequence's frames, truth and time steps."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
import hashlib
import math

import numpy as np

from vtrack_ros.evaluation import frame_changes as change
from vtrack_ros.evaluation.metrics import present
from vtrack_ros.evaluation.stress_plan import (
    edited, Footage, Frames, moved, now_and_then, random_stretches, room, StressPlan,
    thinned)
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box

#: Period of the gaps [frames]: one gap and the frames kept around it.
GAP_PERIOD = 25
#: Range of the period of a roll to and fro [frames]: (minimum, maximum).
_ROLL = 60, 100
#: Frames between two full occlusions of the target.
_SEEN = 50
#: Frames of partial occlusion while an occluder slides in, and as many while it slides out.
_SLIDE = 3
#: Frames of a twin's (distractor's) path past the target; frames from its end to the next twin.
_PASS, _PAUSE = 40, 30
#: Offset from the target at which a twin's path begins and ends, in sizes of the target.
_REACH = 2.5


@dataclass(frozen=True)
class StressKind:
    """A kind of stress: its severities, mildest first, and its `plan` (None: changes no frame)."""

    name: str
    severities: tuple[float, ...]
    unit: str
    description: str
    plan: Callable[[Footage, float, np.random.Generator], StressPlan] | None


def _rate(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    return thinned(footage, np.arange(len(footage.truth)) % max(1, round(severity)) == 0)


def _gaps(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    missing, length = np.zeros(len(footage.truth), dtype=bool), round(severity)
    if length >= GAP_PERIOD:
        raise ValueError(f'the severity of gaps must be below {GAP_PERIOD} frames, not {length}')
    for begin in range(0, len(missing), GAP_PERIOD):
        first = begin + 1 + int(rng.random() * (GAP_PERIOD - length))
        missing[first:first + length] = True
    return thinned(footage, ~missing)


def _shake(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    count = len(footage.truth)
    length = severity * footage.sides * np.sqrt(rng.random(count))
    angle = rng.uniform(0, 2 * math.pi, count)
    offsets = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offsets[0] = 0
    return moved(footage, np.clip(offsets, *room(footage)))


def _jumps(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    """Jump and stay; of eight directions with room, take the one closest to offset zero."""
    least, most = room(footage)
    offsets, place = np.zeros((len(footage.truth), 2)), np.zeros(2)
    for number, (begin, end) in enumerate(random_stretches(len(offsets), 15, 35, rng)):
        angles = rng.uniform(0, 2 * math.pi) + np.arange(8) * math.pi / 4
        if number:
            jumps = severity * footage.sides[begin] * np.stack(
                [np.cos(angles), np.sin(angles)], axis=1)
            places = np.clip(place + jumps, least[begin:end].max(axis=0),
                             most[begin:end].min(axis=0))
            lengths = np.linalg.norm(places - place, axis=1)
            away = np.linalg.norm(places, axis=1)
            away[lengths < 0.95 * lengths.max()] = np.inf
            place = places[np.argmin(np.round(away, 6))]
        offsets[begin:end] = place
    return moved(footage, offsets)


def _roll(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    """Rotate to and fro about the target; the true box bounds the rotated ellipse of the box."""
    side, period = rng.choice([-1.0, 1.0]), rng.uniform(*_ROLL)
    phases = 2 * math.pi * np.arange(len(footage.truth)) / period
    angles = side * math.radians(severity) * np.sin(phases)
    centers = footage.boxes[:, :2] + footage.boxes[:, 2:] / 2
    bounds = [Box.around_ellipse(center, size, angle).as_array() for center, size, angle in zip(
        centers.tolist(), footage.boxes[:, 2:].tolist(), angles.tolist())]
    truth = np.where(present(footage.truth)[:, None], bounds, np.nan)
    return edited(footage, lambda index, frame, rng: change.rolled(
        frame, centers[index], angles[index]), truth)


def _hidden(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    count = len(footage.truth)
    length = max(1, min(round(severity), count // 3))
    cover = np.zeros(count)
    begin = max(1, round(min(20, count / 4) + rng.random() * min(20, count / 4)))
    while begin < count:
        for index in range(max(1, begin - _SLIDE), min(count, begin + length + _SLIDE)):
            outside = max(begin - index, index - (begin + length - 1), 0)
            cover[index] = 1 - outside / (_SLIDE + 1)
        begin += length + _SEEN

    def occluded(frames: Iterable[Frame], rng: np.random.Generator) -> Frames:
        piece, side = np.zeros((1, 1), dtype=np.uint8), 1.0
        for index, frame in enumerate(frames):
            if cover[index] and not cover[index - 1]:
                during = boxes[index:index + length + 2 * _SLIDE]
                wide, high = np.ceil(2 + 1.2 * during[:, 2:].max(axis=0)).astype(int).tolist()
                piece = change.surroundings(frame, boxes[index], (wide, high), rng)
                side = float(rng.choice([-1.0, 1.0]))
            if cover[index]:
                center, width = boxes[index, :2] + boxes[index, 2:] / 2, float(boxes[index, 2])
                away = 0.0 if cover[index] == 1 else (
                    (piece.shape[1] - width) / 2 + (1 - float(cover[index])) * width)
                frame = change.covered(frame, piece, center + [side * away, 0])
            yield frame

    boxes = footage.boxes
    return StressPlan(np.arange(count), footage.truth, present(footage.truth) & (cover < 1),
                      footage.steps, occluded)


def _twin(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    count, boxes = len(footage.truth), footage.boxes
    offsets = np.full((count, 2), np.nan)
    begin = round(5 + 15 * rng.random())
    while begin < count:
        angle, side = rng.uniform(0, 2 * math.pi), rng.choice([-1.0, 1.0])
        along = np.array([math.cos(angle), math.sin(angle)])
        way = np.linspace(-_REACH, _REACH, _PASS)[:, None] * along
        way = way + side * severity * np.array([-along[1], along[0]])
        end = min(count, begin + _PASS)
        offsets[begin:end] = way[:end - begin] * boxes[begin:end, 2:]
        begin += _PASS + _PAUSE
    there = present(footage.truth) & np.isfinite(offsets[:, 0])
    return edited(footage, lambda index, frame, rng: change.doubled(
        frame, boxes[index], offsets[index]) if there[index] else frame)


def _light(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    angles = now_and_then(len(footage.truth), 20, 40, rng)
    return edited(footage, lambda index, frame, rng: frame if math.isnan(
        angles[index]) else change.darkened(frame, severity, angles[index]))


def _blur(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    """Alternate motion blur and Gaussian blur, of equal standard deviation along the motion."""
    angles = now_and_then(len(footage.truth), 10, 20, rng)
    starts = np.isfinite(angles) & ~np.isfinite(np.concatenate([[np.nan], angles[:-1]]))
    odd = np.cumsum(starts) % 2 == 1
    lengths = severity * footage.sides

    def blurred(index: int, frame: Frame, rng: np.random.Generator) -> Frame:
        if math.isnan(angles[index]):
            return frame
        length = float(lengths[index])
        return (change.smeared(frame, length, angles[index]) if odd[index]
                else change.defocused(frame, length / math.sqrt(12)))
    return edited(footage, blurred)


def _noise(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    return edited(footage, lambda index, frame, rng: change.noisy(frame, severity, rng))


def _compression(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    return edited(footage, lambda index, frame, rng: change.compressed(frame, round(severity)))


def _resolution(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    width, height = (max(1, round(length / severity)) for length in footage.size)
    scale = np.array([width, height] * 2) / np.array([*footage.size, *footage.size])
    return edited(footage, lambda index, frame, rng: change.reduced(frame, (width, height)),
                  footage.truth * scale)


_ALL = (
    StressKind('rate', (2, 3, 5), 'every n-th frame', 'only every n-th frame is kept', _rate),
    StressKind('gaps', (5, 10, 15), f'frames missing of {GAP_PERIOD}',
               f'of every {GAP_PERIOD} frames, several in a row are missing', _gaps),
    StressKind('shake', (0.3, 0.6, 1.0), 'up to [sides]',
               'each frame is shifted at random', _shake),
    StressKind('jumps', (0.5, 1.5, 3.0), 'jump [sides]',
               'every 15 to 35 frames the picture jumps to another place', _jumps),
    StressKind('roll', (15, 30, 60), 'by up to [degrees]',
               'the picture rolls to and fro about the target', _roll),
    StressKind('hidden', (10, 30, 60), 'frames hidden',
               f'a piece of the surroundings covers the whole target; it is visible for {_SEEN} '
               'frames in between', _hidden),
    StressKind('twin', (0.6, 0.4, 0.2), 'nearest [sizes]',
               'a copy of the target passes in front of it', _twin),
    StressKind('light', (1.5, 2.25, 3.5), 'darker by a factor of',
               'every 20 to 40 frames the light falls in one step, unevenly, or returns', _light),
    StressKind('blur', (0.1, 0.2, 0.4), 'length [sides]',
               'motion blur and Gaussian blur in turn, for 10 to 20 frames at a time', _blur),
    StressKind('noise', (10, 20, 40), 'deviation, of 255', 'normal noise in each pixel', _noise),
    StressKind('compression', (30, 15, 7), 'JPEG quality', 'JPEG compression', _compression),
    StressKind('resolution', (1.5, 2, 3), 'smaller by a factor of',
               'frames with fewer pixels', _resolution),
    StressKind('particles', (50, 20, 10), 'particles',
               'frames unchanged, but fewer particles in the trackers', None),
)
#: The kinds by name.
STRESS_KINDS = {kind.name: kind for kind in _ALL}


def stress_kinds(text: str) -> tuple[str, ...]:
    """
    Return the kinds of a comma-separated list.

    If one of them is `all`, that's every kind. ValueError if one is unknown, or none is given.
    """
    names = tuple(dict.fromkeys(filter(None, (name.strip() for name in text.split(',')))))
    if not names:
        raise ValueError('no kind of stress is given; valid are all, ' + ', '.join(STRESS_KINDS))
    for name in names:
        if name != 'all':
            _kind(name, 'all')
    return tuple(STRESS_KINDS) if 'all' in names else names


def planned(footage: Footage, kind: str, severity: float, seed: int) -> (
        tuple[StressPlan, np.random.Generator]):
    """
    Return the plan of a sequence's changes, and the random generator for making its frames.

    The generators depend on the seed, the sequence's name and the kind. The kind `plain` changes
    nothing. ValueError if the kind is unknown or changes no frames, or the severity isn't
    positive.
    """
    plan = _plain if kind == 'plain' else _kind(kind, 'plain').plan
    if plan is None:
        raise ValueError(f'{kind} is a parameter of the trackers, and changes no frame')
    if kind != 'plain' and not severity > 0:
        raise ValueError(f'the severity of {kind} must be positive, not {severity}')
    words = hashlib.sha256(f'{footage.name}\0{kind}'.encode()).digest()
    planning, making = np.random.default_rng(
        [seed, *np.frombuffer(words, dtype='<u4').tolist()]).spawn(2)
    return plan(footage, severity, planning), making


def _plain(footage: Footage, severity: float, rng: np.random.Generator) -> StressPlan:
    return edited(footage, lambda index, frame, rng: frame)


def _kind(name: str, besides: str) -> StressKind:
    """Return a kind; `besides` is what the caller takes besides the kinds."""
    if name not in STRESS_KINDS:
        raise ValueError(
            f'unknown kind of stress {name!r}; valid are ' + ', '.join([besides, *STRESS_KINDS]))
    return STRESS_KINDS[name]
