"""The labelled image pairs of one scene (a shard), in memory and as a safetensors file.

Files are written to a temporary name and then renamed; equal content gives equal bytes.
"""

import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.errors import DatasetError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.structured_text import parse_json
from ltvn_core.types import Pose

SCHEMA = "ltvn-pairs-1"
"""Name of the file format; files of another format are refused."""

SHARD_SUFFIX = ".pairs.safetensors"
"""How the names of shards end."""


@dataclass(frozen=True, eq=False)
class Shard:
    """The images of one scene and labelled pairs of them."""

    name: str
    """The scene."""
    recipe: str
    """JSON text of the recipe that generated the shard; a shard with another recipe is generated again."""
    rgb: NDArray[np.uint8]
    """(N, H, W, 3)."""
    depth_mm: NDArray[np.uint16]
    """(N, H, W); 0 = no return."""
    poses: Pose
    """(N, 3) in the scene's frame."""
    group: NDArray[np.int32]
    """(N,) cluster of each image."""
    sources: NDArray[np.int32]
    """(P,) rows of the images."""
    targets: NDArray[np.int32]
    """(P,)"""
    reachable: NDArray[np.bool_]
    """(P,)"""
    failed: NDArray[np.uint8]
    """(P,) flags of `ltvn_core.training_data.reachability_labels.FailedCriteria`."""
    overlap: NDArray[np.float32]
    """(P,) nan where not measured."""
    path_ratio: NDArray[np.float32]
    """(P,) nan where not measured."""


_ARRAYS = tuple(field.name for field in fields(Shard) if field.name not in ("name", "recipe"))


def shard_path(folder: Path, name: str) -> Path:
    """Return where the shard of a scene lies."""
    return folder / f"{Path(name).stem}{SHARD_SUFFIX}"


def shard_scene(path: Path) -> str:
    """Return the scene that a shard is of, by its file's name."""
    return path.name.removesuffix(SHARD_SUFFIX)


def dataset_shards(folder: Path) -> list[Path]:
    """Return the files of a folder that are shards by their names, in order."""
    return sorted(folder.glob(f"*{SHARD_SUFFIX}"))


def split_shards(shards: Iterable[Shard], validation_scenes: Collection[str]) -> tuple[list[Shard], list[Shard]]:
    """Part shards into those to learn from and those of the validation scenes, each in their order."""
    every = list(shards)
    learned = [shard for shard in every if shard.name not in validation_scenes]
    return learned, [shard for shard in every if shard.name in validation_scenes]


def write_shard(shard: Shard, path: Path) -> None:
    """Write a shard so that the file is either complete or not there.

    Raises:
        DatasetError: The file cannot be written.
    """
    # One entry only: safetensors writes several in random order, and the bytes must not vary.
    metadata = {"ltvn": json.dumps({"schema": SCHEMA, "name": shard.name, "recipe": shard.recipe})}
    arrays = {name: np.ascontiguousarray(getattr(shard, name)) for name in _ARRAYS}
    try:
        with atomic_replacement(path) as part:
            save_file(arrays, part, metadata)
    except (OSError, SafetensorError) as error:
        raise DatasetError(
            f"{path}: the shard could not be written ({error}); free some space and run again."
        ) from error


def read_shard(path: Path) -> Shard:
    """Read a shard.

    Raises:
        DatasetError: The file is missing, truncated, inconsistent or of another format.
    """
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = _metadata(file)
            _check_schema(metadata, path)
            arrays = {name: file.get_tensor(name) for name in _ARRAYS}
    except (OSError, SafetensorError) as error:
        raise DatasetError(f"{path}: not a whole shard ({error}); delete it and make the dataset again.") from error
    shard = Shard(name=metadata["name"], recipe=metadata["recipe"], **arrays)
    _check_arrays(shard, path)
    return shard


def read_recipe(path: Path) -> str | None:
    """Return the recipe of a shard, or None if there is no complete shard."""
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = _metadata(file)
    except (OSError, SafetensorError):
        return None
    return metadata.get("recipe") if metadata.get("schema") == SCHEMA else None


def _check_arrays(shard: Shard, path: Path) -> None:
    """Refuse arrays that do not belong together, as another program might write them."""
    count = len(shard.poses)
    pairs = len(shard.sources)
    size = (LOCOBOT.camera.height, LOCOBOT.camera.width)
    if shard.rgb.shape != (count, *size, 3) or shard.depth_mm.shape != (count, *size):
        raise DatasetError(
            f"{path}: {count} poses with images {shard.rgb.shape} and depths {shard.depth_mm.shape}; each pose has one "
            f"image of {size} (rows, columns). Make the dataset again."
        )
    columns = (shard.targets, shard.reachable, shard.failed, shard.overlap, shard.path_ratio)
    if shard.group.shape != (count,) or any(len(column) != pairs for column in columns):
        raise DatasetError(f"{path}: its columns are of different lengths; make the dataset again.")
    if (
        pairs
        and not 0
        <= min(shard.sources.min(), shard.targets.min())
        <= max(shard.sources.max(), shard.targets.max())
        < count
    ):
        raise DatasetError(f"{path}: a pair names an image that is not there; make the dataset again.")


def _metadata(file: Any) -> dict[str, str]:
    """Return the metadata of an open safetensors file, empty if another program wrote it."""
    try:
        return parse_json((file.metadata() or {})["ltvn"])
    except (KeyError, ValueError):
        return {}


def _check_schema(metadata: dict[str, str], path: Path) -> None:
    if metadata.get("schema") != SCHEMA:
        raise DatasetError(
            f"{path}: holds {metadata.get('schema', 'something else')!r}, not {SCHEMA!r}; make the dataset again."
        )
