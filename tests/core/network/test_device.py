"""A network computes where it is told to: on the CPU always the same, on a graphics card nearly so."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from ltvn_core.errors import OptionError
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.network.device import choose_device
from ltvn_core.network.network_families import PairNetwork
from ltvn_core.network.optimization.scene_images import SceneImages
from ltvn_core.network.optimization.trainer import Hyperparameters, Trainer
from ltvn_core.network.predictor import NetworkPredictor, images_to_tensors, load_predictor
from ltvn_core.network.training_examples import BatchSampler
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.predictors.request import predictor_card
from ltvn_core.verbs.discovery import find_verbs
from ltvn_core.verbs.verb import Verb
from tests.core.network.tiny_data import SMALL, tiny_observations, tiny_shard

HAS_CARD = torch.cuda.is_available()


@pytest.mark.skipif(HAS_CARD, reason="there is a card")
def test_a_card_that_is_not_there_is_refused() -> None:
    with pytest.raises(OptionError, match="--device cuda"):
        open_predictor(device="cuda")


@pytest.mark.skipif(HAS_CARD, reason="auto takes the card")
def test_without_a_card_auto_answers_as_the_cpu_to_the_last_bit() -> None:
    chosen, plain = load_predictor(device="auto"), load_predictor()
    assert predictor_card(chosen).device == predictor_card(plain).device == "cpu"
    features = plain.encode(tiny_observations(12))
    assert chosen.encode(tiny_observations(12)).tobytes() == features.tobytes()
    found, expected = (each.predict(features, features[::-1]) for each in (chosen, plain))
    assert [part.tobytes() for part in found] == [part.tobytes() for part in expected]


@pytest.mark.parametrize("count", [12, 240])
def test_a_look_at_a_map_copies_each_image_to_the_device_once_and_again_when_its_row_is_another(count: int) -> None:
    network, seen = PairNetwork(SMALL), tiny_observations(48)
    cpu, card = (NetworkPredictor(network, "", as_on_card=as_on_card) for as_on_card in (False, True))
    frames, store, kept = tuple(range(count)), KeyframeStore(card), card.kept
    store.add([replace(seen[k % 40], step=k) for k in range(count)])
    assert kept is not None

    def copied() -> int:
        held = store.held(frames)
        assert held is not None
        found, expected = (each.predict_among(card.encode(seen[45:46]), held) for each in (card, cpu))
        assert [part.tobytes() for part in found] == [part.tobytes() for part in expected]
        return kept[0].copied

    assert (copied(), copied()) == (count, count)
    store.drop([3])
    store.add([replace(seen[47], step=3)])
    assert (copied(), copied()) == (count + 1, count + 1)
    store.add([replace(seen[46], step=500 + k) for k in range(300)])  # The rows move to a larger array.
    assert (copied(), copied()) == (2 * count + 1, 2 * count + 1)


def test_images_gathered_on_the_device_are_those_of_the_scenes() -> None:
    shard = replace(tiny_shard(), depth_mm=tiny_shard().depth_mm + np.uint16(60_000))
    rows = np.array([5, 0, 7])
    found = SceneImages([tiny_shard("b"), shard]).take([(1, rows)])
    expected = images_to_tensors(shard.rgb[rows], shard.depth_mm[rows] / np.float32(1000))
    assert all(torch.equal(*each) for each in zip(found, expected, strict=True))


@pytest.mark.skipif(not HAS_CARD, reason="needs a graphics card")
def test_a_card_answers_nearly_as_the_cpu() -> None:
    card, cpu = load_predictor(device="auto"), load_predictor()
    assert card.device == choose_device().type != "cpu"
    seen = tiny_observations(12)
    found, expected = (each.predict(each.encode(seen), each.encode(seen[::-1])) for each in (card, cpu))
    np.testing.assert_allclose(found.reachability, expected.reachability, atol=0.005)
    rows, pairs = cpu.encode(seen), np.arange(12)
    found, expected = (each.predict_rows(rows, pairs, pairs[::-1]) for each in (card, cpu))
    np.testing.assert_allclose(found.reachability, expected.reachability, atol=0.005)
    trainers = [Trainer(Hyperparameters(groups=4), SMALL, each) for each in (choose_device(), torch.device("cpu"))]
    assert all(np.isfinite(each.step(BatchSampler([tiny_shard()]), 0.5).loss) for each in trainers)


@pytest.mark.parametrize("name", ["train", "finetune", "build", "judge", "evaluate", "navigate", "app"])
def test_a_verb_that_asks_the_network_takes_a_device(name: str) -> None:
    verb = find_verbs()[name].load()
    assert isinstance(verb, type)
    assert issubclass(verb, Verb)
    assert {field.name: field.default for field in fields(verb)}["device"] == "auto"
