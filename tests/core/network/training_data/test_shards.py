"""Shards are reproducible, resumable and never half-written, and their pairs across clusters are hard on purpose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import DatasetError
from ltvn_core.geometry import wrap_angle
from ltvn_core.network.training_data.pose_sampling import CameraVariation, ClusterSampling, DatasetScene, cluster_poses
from ltvn_core.network.training_data.shards import (
    DatasetRecipe,
    Shard,
    generate_shards,
    read_shard,
    shard_path,
    write_shard,
)
from ltvn_core.robots.robot_spec import LOCOBOT
from tests.core.network.training_data.box_world import two_rooms

RECIPE = DatasetRecipe(clusters=4, sampling=ClusterSampling(size=4))


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    generate_shards(["a"], two_rooms, tmp_path / "one", RECIPE)
    generate_shards(["a"], two_rooms, tmp_path / "two", RECIPE)
    one, two = (shard_path(tmp_path / each, "a").read_bytes() for each in ("one", "two"))
    assert one == two


def test_scenes_and_seeds_draw_different_poses() -> None:
    shard = RECIPE.make(two_rooms("a"))
    assert not np.array_equal(shard.poses, RECIPE.make(two_rooms("b")).poses)
    assert not np.array_equal(shard.poses, replace(RECIPE, seed=1).make(two_rooms("a")).poses)


def test_a_shard_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = generate_shards(["a"], two_rooms, tmp_path, RECIPE)[0]
    shard, made = read_shard(path), RECIPE.make(two_rooms("a"))
    assert shard.name == "a"
    for field in ("rgb", "depth_mm", "poses", "sources", "targets", "reachable", "failed", "overlap"):
        np.testing.assert_array_equal(getattr(shard, field), getattr(made, field))


def test_an_interrupted_dataset_goes_on_where_it_stopped(tmp_path: Path) -> None:
    opened: list[str] = []

    def open_world(name: str) -> DatasetScene:
        opened.append(name)
        return two_rooms(name)

    generate_shards(["a"], open_world, tmp_path, RECIPE)
    generate_shards(["a", "b"], open_world, tmp_path, RECIPE)
    assert opened == ["a", "b"]


def test_a_shard_of_another_recipe_or_a_cut_one_is_made_again(tmp_path: Path) -> None:
    path = generate_shards(["a"], two_rooms, tmp_path, RECIPE)[0]
    whole = path.read_bytes()
    path.write_bytes(whole[:1000])
    generate_shards(["a"], two_rooms, tmp_path, RECIPE)
    assert path.read_bytes() == whole
    generate_shards(["a"], two_rooms, tmp_path, replace(RECIPE, seed=5))
    assert path.read_bytes() != whole


def test_missing_cut_and_foreign_shards_are_named_in_the_error(tmp_path: Path) -> None:
    path = generate_shards(["a"], two_rooms, tmp_path, RECIPE)[0]
    with pytest.raises(DatasetError, match=r"missing\.pairs"):
        read_shard(tmp_path / "missing.pairs.safetensors")
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(DatasetError, match="make the dataset again"):
        read_shard(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"depth_mm": np.zeros((16, 36, 48), np.uint16)}, "rows, columns"),
        ({"targets": np.full(3, 2, np.int32)}, "different lengths"),
        ({"group": np.zeros(5, np.int32)}, "different lengths"),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(
    tmp_path: Path, change: dict[str, np.ndarray], message: str
) -> None:
    path = tmp_path / "odd.pairs.safetensors"
    write_shard(replace(RECIPE.make(two_rooms("a")), **change), path)
    with pytest.raises(DatasetError, match=message):
        read_shard(path)


def test_a_pair_of_an_image_that_is_not_there_is_refused(tmp_path: Path) -> None:
    shard = RECIPE.make(two_rooms("a"))
    path = tmp_path / "odd.pairs.safetensors"
    write_shard(replace(shard, targets=shard.targets + 1000), path)
    with pytest.raises(DatasetError, match="missing image"):
        read_shard(path)


def test_several_processes_make_the_same_bytes_as_one(tmp_path: Path) -> None:
    one = generate_shards(["a", "b"], two_rooms, tmp_path / "one", RECIPE)
    two = generate_shards(["a", "b"], two_rooms, tmp_path / "two", RECIPE, processes=2)
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]


def test_several_processes_write_below_the_folder_of_the_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in ("here", "there"):
        (tmp_path / place).mkdir()
        monkeypatch.chdir(tmp_path / place)
        paths = generate_shards(["a", "b"], two_rooms, Path("data"), RECIPE, processes=2)
        assert [read_shard(path).name for path in paths] == ["a", "b"]


def test_an_unwritable_folder_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(DatasetError, match="could not be written"):
        generate_shards(["a"], two_rooms, tmp_path / "file", RECIPE)


def test_clusters_stay_on_free_floor_and_near_their_anchor() -> None:
    world, spec = two_rooms(), ClusterSampling()
    poses = cluster_poses(world.floor, np.random.default_rng(0), 50, spec)
    assert poses.shape == (50, 8, 3)
    assert world.floor.at(poses[..., :2]).min() >= spec.min_clearance_m
    first = np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=-1)
    assert first.max() <= spec.reach_m
    assert (first > 1.2).sum() > 10


HARD = DatasetRecipe(clusters=40, sampling=ClusterSampling(size=4), strangers=40)


def strangers(shard: Shard) -> np.ndarray:
    across = shard.group[shard.sources] != shard.group[shard.targets]
    return np.column_stack([shard.sources, shard.targets])[across]


def test_pairs_across_clusters_hold_neighbours_views_from_behind_and_far_ones() -> None:
    shard = HARD.make(two_rooms("a"))
    pairs = strangers(shard)
    apart = np.linalg.norm(shard.poses[pairs[:, 0], :2] - shard.poses[pairs[:, 1], :2], axis=1)
    turn = np.abs(wrap_angle(shard.poses[pairs[:, 0], 2] - shard.poses[pairs[:, 1], 2]))
    assert len(np.unique(pairs, axis=0)) == len(pairs) > 1000
    assert ((apart < 1) & (turn > 2)).sum() > 100
    assert (apart > 3).sum() > 300
    assert (apart < 3).sum() > 300


def test_no_hard_negatives_are_drawn_where_none_are_asked_for() -> None:
    shard = DatasetRecipe(clusters=4, sampling=ClusterSampling(size=4), strangers=0).make(two_rooms("a"))
    assert len(strangers(shard)) == 0


def test_a_share_of_the_clusters_is_seen_by_another_camera_and_labelled_by_the_nominal_one() -> None:
    level = DatasetRecipe(clusters=40, cameras=CameraVariation(share=0.0)).make(two_rooms("a"))
    varied = DatasetRecipe(clusters=40, cameras=CameraVariation(share=0.5)).make(two_rooms("a"))
    changed = (level.depth_mm != varied.depth_mm).any((1, 2))
    by_cluster = changed.reshape(40, -1)
    assert np.array_equal(by_cluster.all(1), by_cluster.any(1))
    assert 0.2 < by_cluster.all(1).mean() < 0.8
    assert np.array_equal(level.reachable, varied.reachable)


def test_cameras_stay_near_the_nominal_one() -> None:
    variation, nominal = CameraVariation(share=1.0), LOCOBOT.camera
    drawn = variation.draw(np.random.default_rng(0), 200)
    heights = np.array([camera.height_m for camera in drawn]) - nominal.height_m
    assert 0.5 * variation.height_m < np.abs(heights).max() <= variation.height_m
    assert max(abs(camera.pitch_rad) for camera in drawn) <= variation.pitch_rad
    assert {camera.width for camera in drawn} == {nominal.width}
