"""Filters of presence on sequences in files, as the table of the documentation judges them."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import OptionError
from ltvn_core.graph.presence.presence_filter import SightErrors
from tests.repository import ROOT
from tools.presence_accuracy import fit_durations, read_sequences, stays_of
from tools.presence_table import Compare, ComparedFilters, Show


def write_room(path: Path, seed: int, *, length_s: float = 4000.0) -> Path:
    """Write two things, one that stays 100 s and goes for 200 s by turns, and one that is always there."""
    rng = np.random.default_rng(seed)
    times = np.arange(0, length_s, 2.0)
    arrays = {}
    for name, there in (("0", (times % 300) < 100), ("1", np.ones(len(times), bool))):
        wrong = rng.random(len(times)) < 0.1
        arrays |= {f"{name}.obs": there ^ wrong, f"{name}.obs_t": times}
        arrays |= {f"{name}.gt_obs": there, f"{name}.gt_t": times}
    np.savez(path, allow_pickle=False, **{key: np.asarray(values, np.float32) for key, values in arrays.items()})
    return path


def test_the_lengths_of_stays_are_learned_from_noisy_looks(tmp_path: Path) -> None:
    coming_and_going, always = read_sequences(write_room(tmp_path / "room.npz", 0))
    stays = stays_of(coming_and_going, SightErrors(0.1, 0.1))
    assert np.allclose(stays.present_s, 100, atol=15)
    assert np.allclose(stays.absent_s, 200, atol=15)
    assert stays.share_present == pytest.approx(1 / 3, abs=0.05)
    assert len(stays_of(always, SightErrors(0.1, 0.1)).absent_s) == 0


def test_kinds_of_stays_are_told_apart() -> None:
    rng = np.random.default_rng(1)
    lengths = np.concatenate([rng.normal(60, 3, 30), rng.normal(600, 20, 20)])
    found = fit_durations(lengths, never_ended_s=1e4)
    assert sorted(found.scales_s) == pytest.approx([62, 620], rel=0.1)
    assert sorted(found.weights) == pytest.approx([0.4, 0.6], abs=0.05)


def test_a_filter_of_stays_foretells_regular_changes_better_than_the_last_look_does(tmp_path: Path) -> None:
    files = [write_room(tmp_path / f"{seed}.npz", seed, length_s=2500.0) for seed in (0, 1)]
    found = Compare(fit=files[0], test=files[1], ahead=60.0, json=tmp_path / "found.json").run()
    brier = {each.name: (each.now.brier, each.ahead.brier) for each in found.filters}
    assert list(brier) == ["last look", "persistent"]
    assert brier["persistent"][0] < brier["last look"][0]
    assert brier["persistent"][1] < brier["last look"][1]
    assert ComparedFilters.load(tmp_path / "found.json") == found


@pytest.mark.parametrize(
    ("name", "path"), [("room", "presence.md"), ("room-exchanged", "lab-notebook/2026-11-presence.md")]
)
def test_the_tables_of_the_documentation_are_those_of_its_results(name: str, path: str, tmp_path: Path) -> None:
    page, written = tmp_path / "page.md", ROOT / "docs" / path
    page.write_text(written.read_text(encoding="utf-8"), encoding="utf-8")
    Show(found=ROOT / "docs" / "measurements" / "presence" / f"{name}.json", page=page, block=name).run()
    assert page.read_text(encoding="utf-8") == written.read_text(encoding="utf-8")


def test_files_that_hold_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, pictures=np.zeros(3))
    with pytest.raises(OptionError, match=r"N\.obs"):
        read_sequences(path)
    np.savez(path, allow_pickle=False, **{"0.obs": [0, 2], "0.obs_t": [0, 1], "0.gt_obs": [0, 1], "0.gt_t": [0, 1]})
    with pytest.raises(OptionError, match="other than 0 and 1"):
        read_sequences(path)
    np.savez(path, allow_pickle=False, **{"0.obs": [0, 1], "0.obs_t": [1, 1], "0.gt_obs": [0, 1], "0.gt_t": [0, 1]})
    with pytest.raises(OptionError, match="times that increase"):
        read_sequences(path)
    with pytest.raises(OptionError, match="no file of presence"):
        read_sequences(tmp_path / "missing.npz")


def test_other_things_than_those_a_filter_was_fitted_to_are_refused(tmp_path: Path) -> None:
    both = write_room(tmp_path / "room.npz", 0)
    with np.load(both) as arrays:
        np.savez(tmp_path / "one.npz", **{key: arrays[key] for key in arrays.files if key.startswith("0")})
    with pytest.raises(OptionError, match="fitted to 2 things and is to be judged on 1"):
        Compare(fit=both, test=tmp_path / "one.npz").run()
