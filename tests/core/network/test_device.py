"""A network computes where it is told to: on the CPU always the same, on a graphics card nearly so."""

from dataclasses import fields

import numpy as np
import pytest
import torch

from ltvn_core.errors import OptionError
from ltvn_core.network.device import choose_device
from ltvn_core.network.predictor import load_predictor
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.predictors.request import predictor_card
from ltvn_core.verbs.discovery import find_verbs
from ltvn_core.verbs.verb import Verb
from tests.core.network.tiny_data import tiny_observations

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


@pytest.mark.skipif(not HAS_CARD, reason="needs a graphics card")
def test_a_card_answers_nearly_as_the_cpu() -> None:
    card, cpu = load_predictor(device="auto"), load_predictor()
    assert card.device == choose_device().type != "cpu"
    seen = tiny_observations(12)
    found, expected = (each.predict(each.encode(seen), each.encode(seen[::-1])) for each in (card, cpu))
    np.testing.assert_allclose(found.reachability, expected.reachability, atol=0.005)


@pytest.mark.parametrize("name", ["train", "finetune", "build", "judge", "evaluate", "navigate", "app"])
def test_a_verb_that_asks_the_network_takes_a_device(name: str) -> None:
    verb = find_verbs()[name].load()
    assert isinstance(verb, type)
    assert issubclass(verb, Verb)
    assert {field.name: field.default for field in fields(verb)}["device"] == "auto"
