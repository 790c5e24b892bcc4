"""The presets: complete, distinct, plain, and refused under a wrong name."""

import inspect
import json
from dataclasses import asdict, fields, is_dataclass

import cattrs
import pytest

from ltvn_core import config
from ltvn_core.config import PAPER, PRESETS, ROBUST, Method, preset
from ltvn_core.errors import OptionError


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_survives_strict_json(name: str) -> None:
    text = json.dumps(asdict(preset(name)), allow_nan=False)
    assert cattrs.structure(json.loads(text), Method) == preset(name)


def test_robust_is_the_default() -> None:
    assert Method() == ROBUST
    assert preset("robust") is ROBUST


def test_the_literal_method_has_every_departure_switched_off() -> None:
    assert not PAPER.matching.temporal_support
    assert not PAPER.building.bridges
    assert not PAPER.building.keep_merged
    assert not PAPER.planning.belief_weight
    assert not PAPER.planning.failure_penalty
    assert not PAPER.planning.repeat_limit
    assert not PAPER.driving.depth_veto
    assert not PAPER.localising.follow_places
    assert not PAPER.judging.success_distance
    assert PAPER.believing.prune_after_failures == 1
    assert not PAPER.expanding.strict


def test_an_unknown_method_is_refused_with_the_names_that_exist() -> None:
    with pytest.raises(OptionError, match=r"'fastest'.*robust, paper"):
        preset("fastest")


def test_every_threshold_says_whose_it_is() -> None:
    source = inspect.getsource(config)
    parts = [kind for kind in vars(config).values() if is_dataclass(kind) and isinstance(kind, type)]
    for part in parts:
        if part is Method:
            continue
        for field in fields(part):
            below = source.split(f"    {field.name}:")[1].split('"""')[1]
            assert "paper" in below or "ours" in below.lower(), f"{part.__name__}.{field.name}"
