"""The whole path of the network in small: data, training, a drive, fine-tuning, figures, by the commands."""

import json
from pathlib import Path

import pytest

from ltvn_core.cli import main

pytestmark = pytest.mark.slow


pytest.importorskip("embreex")

KEYS = ("far_fpr_at_tpr60", "auc", "position_median_m", "position_p90_m", "yaw_median_deg", "ece")
SMALL = ["--scenes", "tune-3", "--clusters", "2", "--images", "10"]


def ltvn(*arguments: object, summary: Path) -> dict:
    """Run a verb and return its summary."""
    assert main([*map(str, arguments), "--json", str(summary)]) == 0
    return json.loads(summary.read_text(encoding="utf-8"))


def test_data_training_and_fine_tuning_follow_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    summary = tmp_path / "summary.json"
    scenes = ["train-00", "tune-0"]
    made = ltvn("dataset", "--scenes", *scenes, "--clusters", 4, "--processes", 1, summary=summary)
    assert made["pairs"] > 2 * 4 * 56

    trained = ltvn("train", "--output", "first.safetensors", "--steps", 2, *SMALL, summary=summary)
    assert trained["steps"] == 2
    assert 0 < trained["figures"]["auc"] < 1  # So few steps teach nothing yet.

    drive = ltvn("collect", "--scene", "tune-3", "--loops", 1, "--output", "drive.rrd", summary=summary)
    assert drive["frames"] > 100

    tuned = ltvn(
        "finetune", "drive.rrd", "--weights", "first.safetensors", "--data", "data", "--output", "second.safetensors",
        "--minutes", 0.01, "--part", "1/3", summary=summary,
    )  # fmt: skip
    assert tuned["parent"] == trained["figures"]["fingerprint"] != tuned["fingerprint"]

    judged = ltvn("train", "--evaluate", "--weights", "second.safetensors", *SMALL, summary=summary)
    assert judged["fingerprint"] == tuned["fingerprint"]
    assert all(isinstance(judged[key], float) for key in KEYS)

    card = json.loads((tmp_path / "second.card.json").read_text(encoding="utf-8"))
    assert card["parent_card"]["commands"][1].startswith("ltvn train --data data")
    assert card["command"].startswith("ltvn finetune drive.rrd")
    assert card["seed"] == 0
