"""Small ONNX models of each kind, for the tests: they compare the mean colours of images."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIZE = (8, 6)
"""Width and height of the images that the models take."""
STEPS_PER_COLOUR = 100.0
"""How many steps the policy believes lie between images whose mean red differs by 1."""

CARD = """
model = "policy.onnx"
[image]
size = [8, 6]
[inputs]
source = "obs"
target = "goal"
context = 2
[outputs]
distance = "steps"
waypoints = "way"
[units]
reachable_below = 10.0
distance_m = 0.1
waypoint_m = 0.5
"""
DESCRIPTOR_CARD = """
model = "descriptor.onnx"
[image]
size = [8, 6]
[inputs]
image = "image"
[outputs]
embedding = "code"
[units]
same_place_above = 0.9
"""


def policy_card(folder: Path, card: str = CARD) -> Path:
    """Write a policy that takes two images before the source, and its card; return the card."""
    red_of_last = _constant("at_last", np.array([6], np.int64)), _constant("at_first", np.array([0], np.int64))
    steps = _constant("scale", np.array(STEPS_PER_COLOUR, np.float32))
    ahead = _constant("ahead", np.array([[[1.0, 0.0], [2.0, 1.0]]], np.float32))
    axes = _constant("axes", np.array([2, 3], np.int64))
    nodes = [
        helper.make_node("ReduceMean", ["obs", "axes"], ["obs_mean"], keepdims=0),
        helper.make_node("ReduceMean", ["goal", "axes"], ["goal_mean"], keepdims=0),
        helper.make_node("Gather", ["obs_mean", "at_last"], ["obs_red"], axis=1),
        helper.make_node("Gather", ["goal_mean", "at_first"], ["goal_red"], axis=1),
        helper.make_node("Sub", ["goal_red", "obs_red"], ["apart"]),
        helper.make_node("Abs", ["apart"], ["absolute"]),
        helper.make_node("Mul", ["absolute", "scale"], ["steps"]),
        helper.make_node("Unsqueeze", ["steps", "last_axis"], ["column"]),
        helper.make_node("Mul", ["column", "none"], ["zeros"]),
        helper.make_node("Add", ["zeros", "ahead"], ["way"]),
    ]
    extra = _constant("last_axis", np.array([2], np.int64)), _constant("none", np.array(0.0, np.float32))
    inputs = [_images("obs", 9), _images("goal", 3)]
    outputs = [_values("steps", [None, 1]), _values("way", [None, 2, 2])]
    _save(folder / "policy.onnx", nodes, inputs, outputs, [*red_of_last, steps, ahead, axes, *extra])
    path = folder / "policy.toml"
    path.write_text(card, encoding="utf-8")
    return path


def descriptor_card(folder: Path) -> Path:
    """Write a descriptor that is the mean colour, and its card; return the card."""
    axes = _constant("axes", np.array([2, 3], np.int64))
    nodes = [helper.make_node("ReduceMean", ["image", "axes"], ["code"], keepdims=0)]
    _save(folder / "descriptor.onnx", nodes, [_images("image", 3)], [_values("code", [None, 3])], [axes])
    path = folder / "descriptor.toml"
    path.write_text(DESCRIPTOR_CARD, encoding="utf-8")
    return path


def _images(name: str, channels: int) -> onnx.ValueInfoProto:
    return _values(name, [None, channels, SIZE[1], SIZE[0]])


def _values(name: str, shape: Sequence[int | None]) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def _constant(name: str, value: np.ndarray) -> onnx.TensorProto:
    return numpy_helper.from_array(value, name)


def _save(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    inputs: Sequence[onnx.ValueInfoProto],
    outputs: Sequence[onnx.ValueInfoProto],
    constants: Sequence[onnx.TensorProto],
) -> None:
    graph = helper.make_graph(nodes, "model", inputs, outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
