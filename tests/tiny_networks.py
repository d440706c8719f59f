"""Networks that OpenCV's trackers load, each so small that its answers follow by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

Weights = dict[str, NDArray[np.float32]]
Shapes = dict[str, tuple[int, ...]]

VIT_SPAN = 8.0
"""What a normalised value is divided by before it is a share of the window."""


def write_vit(path: Path) -> None:
    """TrackerVit's: the box's width and height say what the network sees in the second and third channel.

    In the middle of the window, with a score of .9, as shares of it: 1/2 and 1/8 of the normalised value.
    """
    seen = np.zeros((2, 3, 16, 16), np.float32)
    seen[0, 1] = seen[1, 2] = 1.0 / (VIT_SPAN * 256)
    nodes = [
        _node("Conv", "search w1 b1", "seen", kernel_shape=(16, 16), strides=(16, 16)),
        _node("Conv", "template wt bt", "known", kernel_shape=(8, 8), strides=(8, 8)),
        _node("Add", "seen known", "output1"),
        _node("Conv", "search w2 b2", "output2", kernel_shape=(16, 16), strides=(16, 16)),
        _node("Conv", "search w3 b3", "output3", kernel_shape=(16, 16), strides=(16, 16)),
    ]
    weights = {
        **_layer("1", (1, 3, 16, 16), bias=0.9),
        **_layer("t", (1, 3, 8, 8)),
        **_layer("2", (2, 3, 16, 16), bias=0.5),
        **_layer("3", (2, 3, 16, 16)),
        "w2": seen,
    }
    sides = {"output1": (1, 1, 16, 16), "output2": (1, 2, 16, 16), "output3": (1, 2, 16, 16)}
    path.write_bytes(_model(nodes, weights, {"template": (1, 3, 128, 128), "search": (1, 3, 256, 256)}, sides))


def write_dasiamrpn(folder: Path) -> None:
    """DaSiamRPN's three, with its shapes and names of layers; all weights are zero, so that nothing moves."""
    nodes = [
        _node("AveragePool", "input", "63", kernel_shape=(31, 31), strides=(32, 32)),
        _node("AveragePool", "input", "pooled", kernel_shape=(19, 19), strides=(12, 12)),
        _node("Conv", "pooled wf bf", "feature", kernel_shape=(1, 1)),
        _node("Conv", "feature w65 b65", "65", kernel_shape=(4, 4)),
        _node("Conv", "65 w66 b66", "66", kernel_shape=(1, 1)),
        _node("Conv", "feature w68 b68", "68", kernel_shape=(4, 4)),
    ]
    weights = {
        **_layer("f", (256, 3, 1, 1)),
        **_layer("65", (20, 256, 4, 4)),
        **_layer("66", (20, 20, 1, 1)),
        **_layer("68", (10, 256, 4, 4)),
    }
    found = {"66": (1, 20, 19, 19), "68": (1, 10, 19, 19)}
    (folder / "dasiamrpn_model.onnx").write_bytes(_model(nodes, weights, {"input": (1, 3, 271, 271)}, found))
    for name, filters in (("cls1", 10), ("r1", 20)):
        one = [_node("Conv", "x w b", "y", kernel_shape=(1, 1))]
        content = _model(
            one, _layer("", (256 * filters, 3, 1, 1)), {"x": (1, 3, 4, 4)}, {"y": (1, 256 * filters, 4, 4)}
        )
        (folder / f"dasiamrpn_kernel_{name}.onnx").write_bytes(content)


def _layer(name: str, shape: tuple[int, ...], bias: float = 0.0) -> Weights:
    return {f"w{name}": np.zeros(shape, np.float32), f"b{name}": np.full(shape[0], bias, np.float32)}


def _node(kind: str, inputs: str, output: str, **numbers: tuple[int, ...]) -> onnx.NodeProto:
    return helper.make_node(kind, inputs.split(), [output], **numbers)


def _values(shapes: Shapes) -> list[onnx.ValueInfoProto]:
    return [helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape) for name, shape in shapes.items()]


def _model(nodes: list[onnx.NodeProto], weights: Weights, inputs: Shapes, outputs: Shapes) -> bytes:
    constants = [numpy_helper.from_array(values, name) for name, values in weights.items()]
    graph = helper.make_graph(nodes, "tiny", _values(inputs), _values(outputs), constants)
    # Of the age that OpenCV 4.8 reads.
    model = helper.make_model(graph, ir_version=7, opset_imports=[helper.make_opsetid("", 13)])
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())
