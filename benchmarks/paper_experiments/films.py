"""Films that the papers' trackers run on, and the runs on them, both kept on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
import hashlib
from pathlib import Path
import zlib

import cv2
import numpy as np

from vtrack_ros.evaluation import parse_tracker
from vtrack_ros.evaluation.cache import run_key, RunCache, source_hash, tracker_source
from vtrack_ros.evaluation.runner import one_thread, Run, run_tracker
from vtrack_ros.evaluation.sequences import read_folder
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.scenes import render, scene_info, SceneFrame
from vtrack_ros.scenes.catalogue import story_times
from vtrack_ros.scenes.stage import film, Light, View

#: (frame, target's box or NaN if it's hidden, target's box even if it's hidden).
Shot = tuple[Frame, Array, Array]
#: Name in the table -> specification as for `vtrack evaluate`.
Trackers = dict[str, str]
_ABSENT = np.full(4, np.nan)


class Film:
    """
    A film with exact ground truth; frames that are on disk are read when they are first needed.

    `truth` and `outline`, shape (n, 4), are boxes (x, y, width, height) in px: the truth is NaN
    where the target is hidden, the outline isn't.
    """

    def __init__(self, name: str, key: str, shots: Callable[[], Iterable[Shot]],
                 folder: Path | None) -> None:
        self.name = name
        self._frames: list[Frame] = []
        self._stem = None if folder is None else (
            folder / hashlib.sha256(key.encode()).hexdigest())
        if self._stem is not None and self._stem.with_suffix('.npz').is_file():
            with np.load(self._stem.with_suffix('.npz')) as kept:
                self.truth, self.outline = kept['truth'], kept['outline']
                self.fingerprint = str(kept['fingerprint'])
            return
        self._frames, truth, outline = (list(column) for column in zip(*shots()))
        self.truth, self.outline = np.stack(truth), np.stack(outline)
        digest = hashlib.sha256(self.truth.tobytes())
        for frame in self._frames:
            digest.update(np.ascontiguousarray(frame).tobytes())
        self.fingerprint = digest.hexdigest()
        if self._stem is not None:
            self._stem.parent.mkdir(parents=True, exist_ok=True)
            np.save(self._stem.with_suffix('.npy'), np.stack(self._frames))
            np.savez(self._stem.with_suffix('.npz'), truth=self.truth, outline=self.outline,
                     fingerprint=self.fingerprint)

    @property
    def frames(self) -> list[Frame]:
        """Return the frames."""
        if not self._frames:
            assert self._stem is not None
            self._frames = list(np.load(self._stem.with_suffix('.npy')))
        return self._frames

    @property
    def first_box(self) -> Box:
        """Return the box that trackers are started on."""
        return Box(*self.truth[0])

    def forget(self) -> None:
        """Free the memory of frames that are on disk."""
        if self._stem is not None:
            self._frames = []


@dataclass(frozen=True)
class Outcome:
    """A run, and the film that it was on."""

    film: Film
    run: Run


@dataclass(frozen=True)
class Laboratory:
    """The source of films and runs: number of runs, folder of the sequences, and caches."""

    seeds: int
    sequences: Path
    cache: Path | None
    runs: RunCache | None
    #: Of each run so far, whether it's from the cache.
    cached: list[bool] = field(default_factory=list)

    @property
    def timings(self) -> str:
        """Return `measured` if all times are of these runs, `cached` if none, or `mixed`."""
        kinds = set(self.cached)
        return 'mixed' if len(kinds) > 1 else 'cached' if kinds == {True} else 'measured'

    def films(self, scene: str, count: int, frames: int | None = None, grey: bool = False,
              light: float | None = None) -> Iterator[Film]:
        """Render a scene with `count` seeds; `light` is the factor that `light_step` falls to."""
        folder = None if self.cache is None else self.cache / 'films'
        for seed in range(min(count, self.seeds)):
            key = f'{scene} {seed} {frames} {light} {_scene_source()}'
            colour = Film(scene, key, partial(_rendered, scene, seed, frames, light), folder)
            yield Film(scene, f'{key} grey', partial(_greyed, colour), folder) if grey else colour

    def video(self, name: str, grey: bool = False, frames: int | None = None) -> list[Film]:
        """Return the first frames of a shared sequence; nothing if it isn't there."""
        if not (self.sequences / name).is_dir():
            return []
        sequence = read_folder(self.sequences / name)[0]
        return [Film(name, '', lambda: (
            (_grey(frame) if grey else frame, box, box)
            for frame, box in zip(sequence.frames(), sequence.truth[:frames])), None)]

    def measure(self, films: Iterable[Film], count: int,
                trackers: Trackers) -> dict[str, list[Outcome]]:
        """Return name -> runs; run k is tracker seed k on film k modulo the number of films."""
        found: dict[str, dict[int, Outcome]] = {label: {} for label in trackers}
        for number, one in enumerate(films):
            for label, text in trackers.items():
                for seed in range(number, self.seeds, min(count, self.seeds)):
                    found[label][seed] = Outcome(one, self._run(text, one, seed))
            one.forget()
        return {label: [by_seed[seed] for seed in sorted(by_seed)]
                for label, by_seed in found.items()}

    def _run(self, text: str, film: Film, seed: int) -> Run:
        tracker = parse_tracker(text)
        key = run_key(tracker, tracker_source(tracker), film.fingerprint, seed)
        run = None if self.runs is None else self.runs.get(key)
        if run is None:
            with one_thread():
                run = run_tracker(tracker.create(seed), film.frames, film.first_box)
            if self.runs is not None:
                self.runs.put(key, run)
        self.cached.append(run.cached)
        return run


def _rendered(scene: str, seed: int, frames: int | None, light: float | None) -> Iterator[Shot]:
    shots = (render(scene, frames=frames, seed=seed) if light is None
             else _lit(scene, seed, light))
    for shot in shots:
        truth = _ABSENT if shot.truth is None else shot.truth.as_array()
        yield shot.frame, truth, shot.outline.as_array()


def _greyed(colour: Film) -> Iterator[Shot]:
    return ((_grey(frame), truth, outline) for frame, truth, outline in zip(
        colour.frames, colour.truth, colour.outline))


def _lit(name: str, seed: int, level: float) -> Iterator[SceneFrame]:
    """Render a scene whose light falls to a level in frames 55 to 58, in all colours alike."""
    info = scene_info(name)
    building, sensor = np.random.default_rng([seed, zlib.crc32(name.encode())]).spawn(2)
    scene = info.make(View(info.width, info.height, info.width, info.height), building)

    def colour(time: float) -> tuple[float, float, float]:
        factor = float(np.interp(time, (55, 58), (1.0, level)))
        return factor, factor, factor

    return film(replace(scene, light=Light(colour)), story_times(info.frames, info.frames), sensor)


def _scene_source() -> str:
    return source_hash('vtrack_ros.scenes.catalogue')


def _grey(frame: Frame) -> Frame:
    return cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame
