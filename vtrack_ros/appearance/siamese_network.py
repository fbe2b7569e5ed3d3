"""A Siamese network that localises a target in an image and regresses its box."""

from __future__ import annotations

from collections.abc import Mapping
import os
from typing import TypeVar

import cv2
import numpy as np

from vtrack_ros.appearance.sampling import PixelWindow
from vtrack_ros.file_names import is_utf8
from vtrack_ros.frame import Array, Array32, Frame, Point

#: Sides of the exemplar (the target's image) and of the search image, in samples, as in NanoTrack.
EXEMPLAR, SEARCHED = 127, 255
#: Stride of the response map, in samples of the search image, and number of places along a side.
STRIDE, PLACES = 16, 16
#: Margin of the exemplar about the target, on each side, as a share of the target's mean side.
_CONTEXT = 0.5
#: Bound (+/-) that outputs are clipped to: a trained network's are never beyond it, an untrained
#: one's may be.
_BOUND = 1000.0
#: Channels of the features, and their rows and columns for an image of either side.
_CHANNELS, _FEATURES = 48, {EXEMPLAR: 8, SEARCHED: 16}
#: Names of the head's inputs and outputs.
_TEMPLATE, _SEARCH, _SCORES, _SIDES = 'input1', 'input2', 'output1', 'output2'

#: Features of an image, float32, shape (1, channels, rows, columns).
Blob = Array32
#: A length, or an array of lengths, one for each of several boxes.
Length = TypeVar('Length', float, Array)


class SiameseNetwork:
    """
    A backbone and a head with the inputs and outputs of NanoTrack V2, run by OpenCV.

    The backbone turns images, float32 of shape (1, 3, 127, 127) or (1, 3, 255, 255), BGR from 0 to
    255, into features of shape (1, 48, 8, 8) or (1, 48, 16, 16). The head takes those of the
    exemplar as `input1` and of the search image as `input2`. It has two outputs for places 16
    samples apart, with place (8, 8) in the middle: `output1`, shape (1, 2, 16, 16), the logits of
    background and target, and `output2`, shape (1, 4, 16, 16), the distances from the place to the
    target's left, top, right and bottom, in samples.

    `backbone` and `head` are paths of ONNX files. ValueError if a file is missing, or can't be
    read, or isn't such a network.
    """

    def __init__(self, backbone: str, head: str) -> None:
        self._backbone = read_backbone(backbone)
        self._head = read_head(head)

    def learn(self, frame: Frame, center: Point, size: Point) -> Blob:
        """Return the features of a target in a frame, centre and size in pixels."""
        side = exemplar_side(size)
        return self._described(PixelWindow.about(center, (side, side)), frame, EXEMPLAR)

    def search(self, target: Blob, frame: Frame, center: Point,
               side: float) -> tuple[Array, Array]:
        """
        Search a target in a square of a frame, centre and side in pixels.

        Return the log-odds for the target at each place, shape (16, 16), and its box there, shape
        (4, 16, 16): centre x and y, width and height, in pixels.
        """
        square = PixelWindow.about(center, (side, side))
        self._head.setInput(target, _TEMPLATE)
        self._head.setInput(self._described(square, frame, SEARCHED), _SEARCH)
        logits, sides = (
            np.nan_to_num(output[0].astype(np.float64)).clip(-_BOUND, _BOUND)
            for output in self._head.forward([_SCORES, _SIDES]))
        left, top, right, bottom = sides
        at = STRIDE * (np.arange(PLACES) - PLACES // 2)
        boxes = np.stack([at + (right - left) / 2, at[:, None] + (bottom - top) / 2,
                          np.maximum(left + right, 1), np.maximum(top + bottom, 1)])
        boxes *= square.width / SEARCHED
        boxes[:2] += np.reshape(square.center, (2, 1, 1))
        return logits[1] - logits[0], boxes

    def _described(self, square: PixelWindow, frame: Frame, samples: int) -> Blob:
        pixels = square.sampled(frame, samples, samples)
        if pixels.ndim == 2:
            pixels = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
        self._backbone.setInput(cv2.dnn.blobFromImage(pixels))
        # a copy, as OpenCV may return the network's own buffer
        features: Blob = self._backbone.forward().copy()
        return features


def exemplar_side(size: tuple[Length, Length]) -> Length:
    """Return the side of the exemplar's square for a target of that (width, height)."""
    context = _CONTEXT * (size[0] + size[1])
    side: Length = np.sqrt((size[0] + context) * (size[1] + context))
    return side


def read_backbone(path: str) -> cv2.dnn.Net:
    """Return the backbone in an ONNX file; errors as `SiameseNetwork`."""
    net = read_network(path)
    for samples, side in _FEATURES.items():
        _check(path, net, {'': (1, 3, samples, samples)}, {'': (1, _CHANNELS, side, side)})
    return net


def read_head(path: str) -> cv2.dnn.Net:
    """Return the head in an ONNX file; errors as `SiameseNetwork`."""
    net = read_network(path)
    inputs = {name: (1, _CHANNELS, side, side)
              for name, side in zip((_TEMPLATE, _SEARCH), _FEATURES.values())}
    _check(path, net, inputs, {_SCORES: (1, 2, PLACES, PLACES), _SIDES: (1, 4, PLACES, PLACES)})
    return net


def read_network(path: str) -> cv2.dnn.Net:
    """Return the network in an ONNX file; ValueError if it's missing, or OpenCV can't read it."""
    # Path.is_file raises an OSError for a name that is too long.
    if not os.path.isfile(path):
        raise ValueError(f'{path!r} is not a file')
    if not is_utf8(path):
        raise ValueError(f'{path!r} is not UTF-8, which OpenCV cannot open: rename it')
    try:
        return cv2.dnn.readNetFromONNX(path)
    except cv2.error as error:
        raise ValueError(f"OpenCV {cv2.__version__} can't read {path!r} as an ONNX network: "
                         f'{_reason(error)}') from None


def _check(path: str, net: cv2.dnn.Net, inputs: Mapping[str, tuple[int, ...]],
           expected: Mapping[str, tuple[int, ...]]) -> None:
    """Raise a ValueError unless inputs of these shapes give outputs of the expected ones."""
    valid = f'expected {_shapes(expected)} from {_shapes(inputs)}'
    try:
        for name, shape in inputs.items():
            net.setInput(np.zeros(shape, np.float32), name)
        if '' in expected:
            shapes = {'': net.forward().shape}
        else:
            shapes = {name: output.shape
                      for name, output in zip(expected, net.forward(list(expected)))}
    except cv2.error as error:
        raise ValueError(f'{path!r} is not the right network: {valid}: {_reason(error)}') from None
    if shapes != expected:
        raise ValueError(f'{path!r} is not the right network: {valid}, not {_shapes(shapes)}')


def _shapes(named: Mapping[str, tuple[int, ...]]) -> str:
    return ', '.join(f'{name} {shape}'.strip() for name, shape in named.items())


def _reason(error: cv2.error) -> str:
    """Return OpenCV's error message on one line."""
    return ' '.join(str(error).split())
