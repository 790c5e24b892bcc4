"""Weights survive a round trip, and everything that is not weights is refused in plain words."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from ltvn_core.errors import WeightsError
from ltvn_core.network.architecture import PairArchitecture, StackedArchitecture
from ltvn_core.network.network_families import PairNetwork, build_network
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.weights_file import card_path, load_weights, read_card, save_weights
from tests.core.network.tiny_data import SMALL, SMALL_STACKED


@pytest.mark.parametrize("size", [SMALL, SMALL_STACKED], ids=lambda size: size.name)
def test_weights_come_back_as_they_were_saved(tmp_path: Path, size: PairArchitecture | StackedArchitecture) -> None:
    network = build_network(size)
    fingerprint = save_weights(network, tmp_path / "w.safetensors", {"figures": 1})
    loaded = load_weights(tmp_path / "w.safetensors")
    assert loaded.size == size
    for name, value in network.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value), name
    assert read_card(tmp_path / "w.safetensors") == {"fingerprint": fingerprint, "figures": 1}
    assert load_predictor(tmp_path / "w.safetensors").fingerprint == fingerprint


def test_equal_weights_have_equal_fingerprints_and_others_differ(tmp_path: Path) -> None:
    network = PairNetwork(SMALL)
    first, again = (save_weights(network, tmp_path / f"{name}.safetensors") for name in "ab")
    with torch.no_grad():
        network.place_line.add_(1)
    assert first == again != save_weights(network, tmp_path / "c.safetensors")


def test_missing_weights_are_named(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="there are no weights"):
        load_predictor(tmp_path / "nothing.safetensors")
    with pytest.raises(WeightsError, match="there are no weights"):
        read_card(Path("/"))


def test_cut_and_foreign_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_weights(PairNetwork(SMALL), path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(WeightsError, match="not a complete safetensors file"):
        load_weights(path)
    path.write_bytes(b"\x80\x04pickled")
    with pytest.raises(WeightsError, match="not a complete safetensors file"):
        load_weights(path)
    save_file({"x": torch.zeros(1)}, path)
    with pytest.raises(WeightsError, match="something else"):
        load_weights(path)


def test_weights_of_another_architecture_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    state = PairNetwork(SMALL).state_dict()
    save_file(state, path, {"ltvn": json.dumps({"schema": "ltvn-weights-1", "name": "siamese"})})
    with pytest.raises(WeightsError, match=r"w\.safetensors: .*'siamese'.*aligned-pairs, stacked"):
        load_weights(path)
    save_file(state, path, {"ltvn": json.dumps({"schema": "ltvn-weights-1", "name": "stacked"})})
    with pytest.raises(WeightsError, match="damaged"):
        load_weights(path)
    stacked = {"schema": "ltvn-weights-1", **asdict(StackedArchitecture())}
    save_file(state, path, {"ltvn": json.dumps(stacked)})
    with pytest.raises(WeightsError, match="do not fit") as refused:
        load_weights(path)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 500
    save_weights(PairNetwork(), path)
    text = path.read_bytes().replace(b'\\"tokens\\": 96', b'\\"tokens\\": 64')
    path.write_bytes(text)
    with pytest.raises(WeightsError, match="do not fit"):
        load_weights(path)


@pytest.mark.parametrize("size", [-1, 0, 10**9, 10**400, "wide", None])
def test_sizes_that_no_network_has_are_refused(tmp_path: Path, size: object) -> None:
    path = tmp_path / "w.safetensors"
    described = {"schema": "ltvn-weights-1", **asdict(StackedArchitecture()), "stem": size}
    save_file(PairNetwork(SMALL).state_dict(), path, {"ltvn": json.dumps(described)})
    with pytest.raises(WeightsError, match=r"w\.safetensors: the (description|architecture)") as refused:
        load_weights(path)
    assert "\n" not in str(refused.value)


def test_weights_with_numbers_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    network = PairNetwork(SMALL)
    with torch.no_grad():
        network.place_line[0] = torch.nan
    save_weights(network, tmp_path / "w.safetensors")
    with pytest.raises(WeightsError, match="not finite"):
        load_weights(tmp_path / "w.safetensors")


def test_an_unwritable_place_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(WeightsError, match="could not be written"):
        save_weights(PairNetwork(SMALL), tmp_path / "file" / "w.safetensors")


@pytest.mark.parametrize("text", ["[]", '"card"', "3", "{", "\xff"])
def test_a_card_that_is_none_is_named(tmp_path: Path, text: str) -> None:
    card_path(tmp_path / "w.safetensors").write_bytes(text.encode("latin-1"))
    with pytest.raises(WeightsError, match=r"w\.card\.json"):
        read_card(tmp_path / "w.safetensors")


def test_a_card_of_other_weights_never_lies_beside_new_ones(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    network = PairNetwork(SMALL)
    first = save_weights(network, path, {"trained": "long"})
    assert save_weights(network, path) == first
    assert read_card(path) == {"fingerprint": first, "trained": "long"}
    with torch.no_grad():
        network.place_line.add_(1)
    save_weights(network, path)
    assert read_card(path) == {}
    second = save_weights(network, path, {"trained": "longer"})
    assert read_card(path) == {"fingerprint": second, "trained": "longer"}
    assert sorted(tmp_path.iterdir()) == [card_path(path), path]


def test_old_weights_and_their_card_stay_where_new_ones_cannot_be_written(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    network = PairNetwork(SMALL)
    first = save_weights(network, path, {"trained": "long"})
    with torch.no_grad():
        network.place_line.add_(1)
    with pytest.raises(TypeError):
        save_weights(network, path, {"no JSON": object()})
    assert read_card(path) == {"fingerprint": first, "trained": "long"}
    assert load_predictor(path).fingerprint == first
    assert sorted(tmp_path.iterdir()) == [card_path(path), path]
