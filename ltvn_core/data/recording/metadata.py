"""Metadata of a recording, and their encoding in the file."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import pyarrow as pa

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.schema import ArchetypeColumns, integer_column, text_column
from ltvn_core.errors import RecordingError
from ltvn_core.structured_text import parse_json

SOURCE_SCENE = "real:"
"""Prefix of the scene of an imported drive; the name of the source follows, unless the user named the place."""
METADATA_ARCHETYPE = "ltvn.Recording"
_PACKAGES = ("ltvn", "rerun-sdk", "numpy", "torch", "opencv-python-headless")


@dataclass(frozen=True, slots=True)
class RecordingMetadata:
    """Metadata of a recording."""

    scene: str
    """Name of the scene."""
    config: Mapping[str, Any]
    """Resolved configuration, as JSON values."""
    fingerprint: str
    """Fingerprint of the weights in use."""
    camera: CameraModel
    """Camera of the recorded images."""
    schema: int
    """Version of the recording's schema."""
    versions: Mapping[str, str]
    """Versions of the packages that wrote the recording, by name."""
    started_at: str
    """Wall-clock time at the start, ISO 8601 in UTC."""
    recording_id: str
    """Rerun's id of the recording; the viewer shows two files with the same id as one."""


def is_lens_known(meta: RecordingMetadata) -> bool:
    """Tell whether the camera's lens was given; for some imported drives it was assumed."""
    return bool(meta.config.get("import", {}).get("is_lens_known", True))


def metadata_row(meta: RecordingMetadata) -> ArchetypeColumns:
    """Encode the metadata of a recording as one row. Raises RecordingError when the configuration is not JSON."""
    return ArchetypeColumns(
        METADATA_ARCHETYPE,
        {
            "schema": integer_column(meta.schema),
            "scene": text_column(meta.scene),
            "config": text_column(_json(meta.config)),
            "fingerprint": text_column(meta.fingerprint),
            "intrinsics": text_column(_json(meta.camera.to_json())),
            "versions": text_column(_json(meta.versions)),
            "started_at": text_column(meta.started_at),
        },
    )


def read_metadata(row: pa.RecordBatch, recording_id: str) -> RecordingMetadata:
    """Decode the metadata of a row. Raises KeyError or ValueError if the row has another format."""
    value = {name: row.column(f"{METADATA_ARCHETYPE}:{name}").flatten()[0].as_py() for name in _COLUMNS}
    return RecordingMetadata(
        scene=value["scene"],
        config=parse_json(value["config"]),
        fingerprint=value["fingerprint"],
        camera=CameraModel.from_json(parse_json(value["intrinsics"])),
        schema=value["schema"],
        versions=parse_json(value["versions"]),
        started_at=value["started_at"],
        recording_id=recording_id,
    )


_COLUMNS = ("schema", "scene", "config", "fingerprint", "intrinsics", "versions", "started_at")


def read_schema_version(row: pa.RecordBatch) -> int:
    """Read only the version of the schema, which must be possible for every version."""
    return int(row.column(f"{METADATA_ARCHETYPE}:schema").flatten()[0].as_py())


def package_versions() -> dict[str, str]:
    """Return the versions of the installed packages that determine the content of a recording."""
    found = {}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def _json(value: Any) -> str:
    try:
        return json.dumps(value, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"The configuration cannot be recorded: {error}. Use numbers, texts, lists and mappings of them."
        ) from error
