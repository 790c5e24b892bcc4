"""Other people's models, from an ONNX file and a card."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError, WeightsError
from ltvn_core.maps.built_map import build_map
from ltvn_core.predictors.composed import ComposedPredictor
from ltvn_core.predictors.onnx_card import read_onnx_card
from ltvn_core.predictors.onnx_policy import OnnxModel, OnnxPolicy
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation
from ltvn_core.verbs.plugins import PluginsVerb
from tests.core.predictors.onnx_models import CARD, DESCRIPTOR_CARD, STEPS_PER_COLOUR, descriptor_card, policy_card

pytest.importorskip("onnxruntime")


def image_of(red: int, step: int = 0) -> Observation:
    """Return an image of one colour."""
    camera = LOCOBOT.camera
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    rgb[..., 0] = red
    depth = np.ones((camera.height, camera.width), np.float32)
    return Observation(step=step, stamp=0.1 * step, rgb=rgb, depth=depth, odometry=np.zeros(3))


def test_a_policy_says_how_far_the_target_is_and_where(tmp_path: Path) -> None:
    policy = open_predictor("onnx", weights=policy_card(tmp_path))
    images = policy.encode([image_of(red) for red in (100, 100, 110, 125, 250)])

    found = policy.predict(images[:1], images[1:])

    steps = STEPS_PER_COLOUR * np.array([0, 10, 25, 150]) / 255
    assert found.reachability[0] > 0.95
    assert (np.diff(found.reachability) < 0).all()
    assert (found.reachability[:2] > 0.5).all()
    assert (found.reachability[2:] > 0.5).tolist() == [s < 10 for s in steps[2:]]
    assert np.allclose(np.hypot(*found.waypoints[:, :2].T), 0.1 * steps, atol=1e-4)
    assert np.allclose(found.waypoints[1:, 2], np.arctan2(1, 2))
    assert found.waypoints[1, 0] > found.waypoints[1, 1] > 0


def test_many_pairs_at_once_are_answered_as_one_by_one(tmp_path: Path) -> None:
    policy = open_predictor("onnx", weights=policy_card(tmp_path))
    images = policy.encode([image_of(red) for red in range(0, 250, 2)])

    together = policy.predict(images, images[::-1])

    for k in (0, 40, 124):
        alone = policy.predict(images[k : k + 1], images[::-1][k : k + 1])
        assert together.reachability[k] == pytest.approx(alone.reachability[0], abs=1e-6)
        assert np.allclose(together.waypoints[k], alone.waypoints[0], atol=1e-6)
    assert policy.predict(images[:1], images[:0]).reachability.shape == (0,)


def test_another_card_or_model_is_another_predictor(tmp_path: Path) -> None:
    first = open_predictor("onnx", weights=policy_card(tmp_path))
    again = open_predictor("onnx", weights=policy_card(tmp_path))
    other = open_predictor("onnx", weights=policy_card(tmp_path, CARD.replace("10.0", "20.0")))

    assert isinstance(first, OnnxPolicy)
    assert first.fingerprint == again.fingerprint != other.fingerprint


def test_a_place_descriptor_proposes_what_geometry_confirms(tmp_path: Path) -> None:
    composed = open_predictor("onnx", weights=descriptor_card(tmp_path))
    images = composed.encode([image_of(200), image_of(100)])

    assert isinstance(composed, ComposedPredictor)
    assert composed.fingerprint.startswith("onnx-")
    assert len(composed.predict(images[:1], images).reachability) == 2


def compare_two_images(card: Path) -> None:
    policy = open_predictor("onnx", weights=card)
    image = policy.encode([image_of(100)])
    policy.predict(image, image)


def test_a_map_is_built_with_a_policy_and_remembers_it(tmp_path: Path) -> None:
    policy = open_predictor("onnx", weights=policy_card(tmp_path))
    drive = [replace(image_of(60 + 4 * k, k), odometry=np.array([0.1 * k, 0.0, 0.0])) for k in range(30)]

    built = build_map(drive, predictor=policy, predictor_name="onnx")
    built.save(tmp_path / "map.rrd")

    assert len(built.graph.nodes) > 2
    assert built.graph.edges
    saved = Recording.open(tmp_path / "map.rrd").meta
    assert (saved.fingerprint, saved.config["predictor"]) == (policy.fingerprint, "onnx")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (CARD.replace('distance = "steps"\n', ""), "reachability or distance"),
        (CARD.replace('waypoints = "way"\n', ""), "pose or waypoints"),
        (CARD.replace('"obs"', '"image"'), "takes obs, goal"),
        (CARD.replace("size = [8, 6]", "size = [8, 7]"), "refuses obs"),
        (CARD.replace("context = 2", "context = 0"), "refuses obs"),
        (CARD.replace("size = [8, 6]", "size = [8]"), "size must have 2"),
        (CARD.replace("[units]", "[unit]"), "unknown: unit"),
        (CARD.replace("10.0", "-1.0"), "above 0"),
        (CARD.replace("policy.onnx", "../policy.onnx"), "beside the card"),
        (CARD.replace("policy.onnx", "other.onnx"), "cannot be read"),
        ("model = ", "is not TOML"),
    ],
)
def test_a_card_that_does_not_fit_says_what_is_wrong(tmp_path: Path, wrong: str, says: str) -> None:
    card = policy_card(tmp_path, wrong)

    with pytest.raises(WeightsError, match=says):
        compare_two_images(card)


def test_a_damaged_model_and_a_missing_card_are_clear_errors(tmp_path: Path) -> None:
    card = policy_card(tmp_path)
    (tmp_path / "policy.onnx").write_bytes(b"no model")

    with pytest.raises(WeightsError, match="not an ONNX model"):
        open_predictor("onnx", weights=card)
    with pytest.raises(WeightsError, match="--weights"):
        open_predictor("onnx")
    with pytest.raises(WeightsError, match="cannot be read"):
        open_predictor("onnx", weights=tmp_path / "nothing.toml")


@pytest.mark.parametrize("card", [policy_card, descriptor_card])
def test_a_model_keeps_the_contract_of_predictors(tmp_path: Path, card: Callable[[Path], Path]) -> None:
    options = PluginsVerb(command=("test", "onnx"), weights=card(tmp_path))

    tested: Any = options.run()

    assert (tested.why, options.exit_code(tested)) == ("", 0)


def test_weights_belong_to_predictors_alone(tmp_path: Path) -> None:
    options = PluginsVerb(command=("test", "sptm"), weights=policy_card(tmp_path))

    with pytest.raises(OptionError, match="--weights belongs to a predictor"):
        options.run()


def descriptor_with(folder: Path, nodes: Sequence[onnx.NodeProto], weights: onnx.TensorProto, card: str = "") -> Path:
    """Write a place descriptor that makes its embedding of `mean`, the mean colours, and `weights`; return the card."""
    mean = helper.make_node("ReduceMean", ["image"], ["mean"], axes=[2, 3], keepdims=0)
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", 3, 6, 8])
    code = helper.make_tensor_value_info("code", TensorProto.FLOAT, ["N", 3])
    graph = helper.make_graph([mean, *nodes], "graph", [image], [code], [weights])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    (folder / "descriptor.onnx").write_bytes(model.SerializeToString())
    path = folder / "card.toml"
    path.write_text(card or DESCRIPTOR_CARD, encoding="utf-8")
    return path


def weights_beside(location: str) -> onnx.TensorProto:
    """Return weights of three numbers in a file beside the model."""
    weights = TensorProto(name="weights", data_type=TensorProto.FLOAT, dims=[3], data_location=TensorProto.EXTERNAL)
    for key, value in (("location", location), ("offset", "0"), ("length", "12")):
        weights.external_data.add(key=key, value=value)
    return weights


def test_other_weights_beside_a_model_are_another_predictor(tmp_path: Path) -> None:
    card = descriptor_with(
        tmp_path, [helper.make_node("Mul", ["mean", "weights"], ["code"])], weights_beside("weights.bin")
    )

    def fingerprint(value: float) -> str:
        (tmp_path / "weights.bin").write_bytes(np.full(3, value, np.float32).tobytes())
        return open_predictor("onnx", weights=card).fingerprint

    assert fingerprint(1.0) == fingerprint(1.0) != fingerprint(2.0)


def test_weights_beside_a_model_count_inside_of_branches_too(tmp_path: Path) -> None:
    code = helper.make_tensor_value_info("inner", TensorProto.FLOAT, ["N", 3])
    node = helper.make_node("Mul", ["mean", "weights"], ["inner"])
    branch = helper.make_graph([node], "branch", [], [code], [weights_beside("weights.bin")])
    chosen = helper.make_node("If", ["is_so"], ["code"], then_branch=branch, else_branch=branch)
    card = descriptor_with(tmp_path, [chosen], numpy_helper.from_array(np.array(True), "is_so"))
    fingerprints = set[str]()
    for value in (1.0, 2.0):
        (tmp_path / "weights.bin").write_bytes(np.full(3, value, np.float32).tobytes())
        fingerprints.add(open_predictor("onnx", weights=card).fingerprint)
    assert len(fingerprints) == 2


@pytest.mark.parametrize(
    "location", ["../weights.bin", "/dev/zero", "folder/weights.bin", "..\\weights.bin", "", "a\0b"]
)
def test_weights_elsewhere_than_beside_the_model_are_refused(tmp_path: Path, location: str) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    (tmp_path / "weights.bin").write_bytes(bytes(12))
    card = descriptor_with(folder, [helper.make_node("Mul", ["mean", "weights"], ["code"])], weights_beside(location))

    with pytest.raises(WeightsError, match="beside it"):
        open_predictor("onnx", weights=card)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such files")
@pytest.mark.parametrize("name", ["card.toml", "descriptor.onnx", "weights.bin"])
@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")], ids=["pipe", "device"])
def test_pipes_and_devices_are_not_read(tmp_path: Path, name: str, make: Callable[[Path], None]) -> None:
    card = descriptor_with(
        tmp_path, [helper.make_node("Mul", ["mean", "weights"], ["code"])], weights_beside("weights.bin")
    )
    (tmp_path / "weights.bin").write_bytes(bytes(12))
    (tmp_path / name).unlink()
    make(tmp_path / name)

    with pytest.raises(WeightsError, match="pipe or a device"):
        open_predictor("onnx", weights=card)


@pytest.mark.parametrize("name", ["a\\u0000.onnx", "x" * 300, "..", ""])
def test_a_model_of_an_impossible_name_is_refused(tmp_path: Path, name: str) -> None:
    card = descriptor_card(tmp_path)
    card.write_text(DESCRIPTOR_CARD.replace("descriptor.onnx", name), encoding="utf-8")
    with pytest.raises(WeightsError):
        open_predictor("onnx", weights=card)


def test_an_endless_loop_is_ended(tmp_path: Path) -> None:
    kept = helper.make_tensor_value_info("kept", TensorProto.FLOAT, ["N", 3])
    goes_on = helper.make_tensor_value_info("goes_on", TensorProto.BOOL, [])
    round_ = helper.make_graph(
        [helper.make_node("Identity", ["goes_on"], ["on"]), helper.make_node("Identity", ["kept"], ["next"])],
        "round",
        [helper.make_tensor_value_info("number", TensorProto.INT64, []), goes_on, kept],
        [
            helper.make_tensor_value_info("on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("next", TensorProto.FLOAT, ["N", 3]),
        ],
    )
    loop = helper.make_node("Loop", ["trips", "", "mean"], ["code"], body=round_)
    card = descriptor_with(tmp_path, [loop], numpy_helper.from_array(np.array(2**62, np.int64), "trips"))

    with pytest.raises(WeightsError, match="endless"):
        OnnxModel(read_onnx_card(card), most_s=0.2)
