"""`ltvn dataset` renders simulated scenes, and `ltvn train` says what it misses."""

from pathlib import Path

import pytest

from ltvn_core.errors import DatasetError, SceneError
from ltvn_core.verbs.dataset import DatasetSummary, DatasetVerb
from ltvn_core.verbs.train import TrainVerb, read_shards

pytest.importorskip("embreex")


def test_a_scene_becomes_a_shard_of_labelled_pairs(tmp_path: Path) -> None:
    made = DatasetVerb(folder=tmp_path, scenes=("tune-5",), clusters=6).run()
    assert isinstance(made, DatasetSummary)
    assert (made.scenes, made.images) == (1, 48)
    assert 336 < made.pairs <= 336 + 6 * 28
    assert 0.05 < made.reachable < 0.6


def test_an_unknown_scene_is_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="nowhere"):
        DatasetVerb(folder=tmp_path, scenes=("nowhere",), clusters=1).run()


def test_training_without_a_dataset_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="ltvn dataset"):
        TrainVerb(data=tmp_path, output=tmp_path / "w.safetensors", work=tmp_path / "work").run()


@pytest.mark.slow
def test_scenes_for_measuring_are_never_learned_from(tmp_path: Path) -> None:
    DatasetVerb(folder=tmp_path, scenes=("train-00", "tune-0", "tune-3"), clusters=2).run()
    learned, validation = read_shards(tmp_path)
    assert [shard.name for shard in learned] == ["train-00"]
    assert [shard.name for shard in validation] == ["tune-0"]
