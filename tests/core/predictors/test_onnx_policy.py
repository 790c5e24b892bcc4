"""Other people's models, from an ONNX file and a card."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError, WeightsError
from ltvn_core.maps.topological_map import build_map
from ltvn_core.predictors.composed import ComposedPredictor
from ltvn_core.predictors.onnx_policy import OnnxPolicy
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation
from ltvn_core.verbs.jobs.plugins import list_or_test
from ltvn_core.verbs.plugins import PluginsVerb
from tests.core.predictors.onnx_models import CARD, STEPS_PER_COLOUR, descriptor_card, policy_card

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

    tested: Any = list_or_test(options)

    assert [check for check in tested.checks if not check.passed] == []
    assert options.exit_code(tested) == 0


def test_weights_belong_to_predictors_alone(tmp_path: Path) -> None:
    options = PluginsVerb(command=("test", "sptm"), weights=policy_card(tmp_path))

    with pytest.raises(OptionError, match="--weights belongs to a predictor"):
        list_or_test(options)
