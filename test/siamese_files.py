"""Tiny networks with NanoTrack V2's inputs and outputs: they recognise a target by mean colour."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from onnx import checker, helper, numpy_helper, save, TensorProto

#: Half the side of a square target in the search image, in samples.
HALF = 255 / 8

_folder = TemporaryDirectory()


@cache
def network_files() -> dict[str, str]:
    """Return the parameters that name a network's files, which last as long as the process."""
    folder = Path(_folder.name)
    return {'siamese.backbone': write_backbone(folder / 'backbone.onnx'),
            'siamese.head': write_head(folder / 'head.onnx')}


def write_backbone(path: Path, channels: int = 48, gain: float = 1.0) -> str:
    """Write a backbone: the mean colour of each 16 x 16 samples."""
    weight = np.zeros((channels, 3, 16, 16), np.float32)
    for channel in range(3):
        weight[channel, channel] = gain / 256
    nodes = [helper.make_node('Conv', ['input', 'weight'], ['output'], kernel_shape=[16, 16],
                              strides=[16, 16], pads=[1, 1, 0, 0])]
    return _write(path, nodes, {'input': (1, 3, 255, 255)}, {'output': (1, channels, 16, 16)},
                  {'weight': weight})


def write_head(path: Path, grow: float = 1.0, gain: float = 1.0, clip: bool = False) -> str:
    """
    Write a head: its score is how near a place's mean colour is to the target's; its box is fixed.

    A square target fills the middle 4 x 4 cells of its image. With `clip`, distances are clipped
    to limits that none of them reaches, and these are inputs of the node.
    """
    middle = np.zeros((48, 1, 8, 8), np.float32)
    middle[:, :, 2:6, 2:6] = 1 / 16
    score = np.zeros((2, 48, 1, 1), np.float32)
    score[1] = -0.1 * gain
    sides = np.full(4, grow * HALF, np.float32)
    nodes = [
        helper.make_node('Conv', ['input1', 'middle'], ['target'], kernel_shape=[8, 8], group=48),
        helper.make_node('ConvTranspose', ['target', 'spread'], ['everywhere'],
                         kernel_shape=[16, 16], group=48),
        helper.make_node('AveragePool', ['input2'], ['about'], kernel_shape=[4, 4],
                         pads=[2, 2, 1, 1]),
        helper.make_node('Sub', ['about', 'everywhere'], ['difference']),
        helper.make_node('Abs', ['difference'], ['far']),
        helper.make_node('Conv', ['far', 'score', 'level'], ['output1'], kernel_shape=[1, 1]),
        helper.make_node('Conv', ['far', 'none', 'sides'], ['output2'], kernel_shape=[1, 1])]
    limits = {}
    if clip:
        limits = {'least': np.float32(0), 'most': np.float32(1000)}
        nodes[4].output[0] = 'unlimited'
        nodes.insert(5, helper.make_node('Clip', ['unlimited', *limits], ['far']))
    return _write(
        path, nodes, {'input1': (1, 48, 8, 8), 'input2': (1, 48, 16, 16)},
        {'output1': (1, 2, 16, 16), 'output2': (1, 4, 16, 16)},
        {'middle': middle, 'spread': np.ones((48, 1, 16, 16), np.float32), 'score': score,
         'level': np.array([0, 10], np.float32), 'none': np.zeros((4, 48, 1, 1), np.float32),
         'sides': sides, **{name: np.array(limit) for name, limit in limits.items()}})


def _write(path: Path, nodes: list, inputs: dict[str, tuple[int, ...]],
           outputs: dict[str, tuple[int, ...]], weights: dict[str, np.ndarray]) -> str:
    graph = helper.make_graph(
        nodes, path.stem,
        *([helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
           for name, shape in ends.items()] for ends in (inputs, outputs)),
        [numpy_helper.from_array(array, name) for name, array in weights.items()])
    model = helper.make_model(
        graph, ir_version=6, opset_imports=[helper.make_opsetid('', 11)])
    checker.check_model(model)
    save(model, str(path))
    return str(path)
