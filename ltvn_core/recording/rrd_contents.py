"""Opens a `.rrd` file as one of ours and hands out its rows entity by entity.

Owns the checks that the file is a finished recording of this application and schema, and the clear errors otherwise.
Knows nothing of frames and events.
"""

import warnings
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
from rerun.chunk import RrdReader

from ltvn_core.atomic_files import require_usable_name
from ltvn_core.errors import RecordingError
from ltvn_core.recording import rrd_framing, schema
from ltvn_core.recording.file_check import FileCheck, check_file
from ltvn_core.recording.metadata import RecordingMetadata, read_metadata, read_schema_version

_READ = frozenset(f"/{entity}" for entity in schema.READ_BACK)


class RrdContents(NamedTuple):
    """What is read back from a recording, still as Arrow; pictures are compressed."""

    meta: RecordingMetadata
    rows: Mapping[str, Sequence[pa.RecordBatch]]
    """Entity path with a leading slash -> batches in the order of the file."""

    def batches_of(self, entity: str) -> Sequence[pa.RecordBatch]:
        """Return the batches of one entity."""
        return self.rows.get(f"/{entity}", ())


def require_rrd(path: Path) -> None:
    """Raise RecordingError when `path` is no Rerun file at all."""
    require_usable_name(path)
    if not path.exists():
        raise RecordingError(f"There is no file {path}; `ltvn collect` and `ltvn demo` make recordings.")
    if not path.is_file():
        raise RecordingError(f"{path} is no file; name a single .rrd recording.")
    try:
        genuine = rrd_framing.is_rrd(path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror}); check its permissions.") from error
    if not genuine:
        size = path.stat().st_size
        what = "is empty" if size == 0 else f"is no Rerun recording ({size} bytes of another format)"
        raise RecordingError(f"{path} {what}; name a .rrd file written by ltvn.")


def require_whole(path: Path) -> FileCheck:
    """Check the bytes of a finished file. Raises RecordingError that names `ltvn repair` when any is wrong."""
    require_rrd(path)
    found = check_file(path)
    if found.framing.finished and found.damage is None:
        return found
    size, whole_bytes = path.stat().st_size, found.framing.whole_bytes
    if found.damage is not None:
        what = f"was damaged since it was written: {found.damage}"
    elif rrd_framing.is_finished(path):
        what = f"was damaged since it was written: behind byte {whole_bytes} of {size} its messages do not go on"
    else:
        what = f"is cut or was never finished: {whole_bytes} of its {size} bytes are whole"
    raise RecordingError(f"{path} {what}. Run `ltvn repair {path} --output NEW.rrd` to get all whole frames back.")


def read_contents(path: Path) -> RrdContents:
    """Read all rows of a file whose messages are whole. Raises RecordingError for a foreign one."""
    try:
        with warnings.catch_warnings():
            # A file without its footer is what `repair` is for; that it is cut has been said already.
            warnings.filterwarnings("ignore", message="RRD file has no footer")
            reader = RrdReader(path)
        stores = reader.recordings()
        # Reading from here on touches every message, so damage inside one shows as an exception of any kind.
        chunks = reader.stream() if stores else ()
        batches = [(chunk.entity_path, chunk.to_record_batch()) for chunk in chunks if _is_read(chunk.entity_path)]
    except Exception as error:
        raise RecordingError(f"{path} is damaged inside: {error}. Restore it from a copy.") from error
    if not stores:
        raise RecordingError(f"{path} holds no recording (a blueprint only?); name a .rrd file written by ltvn.")
    if stores[0].application_id != schema.APPLICATION_ID:
        raise RecordingError(
            f"{path} was written by another program, {stores[0].application_id!r}; name a file written by ltvn."
        )
    rows: dict[str, list[pa.RecordBatch]] = defaultdict(list)
    for entity, batch in batches:
        rows[entity].append(batch)
    return RrdContents(_meta(path, rows, stores[0].recording_id), rows)


def _is_read(entity: str) -> bool:
    """Tell whether anybody reads an entity back; most only draw."""
    return entity in _READ or entity.startswith("/__properties")


def _meta(path: Path, rows: Mapping[str, Sequence[pa.RecordBatch]], recording_id: str) -> RecordingMetadata:
    described = rows.get(f"/__properties/{schema.PROPERTIES}", ())
    try:
        row = described[-1]
        version = read_schema_version(row)
    except (IndexError, KeyError, ValueError) as error:
        raise RecordingError(f"{path} does not say what it holds; name a .rrd file written by `ltvn`.") from error
    if version != schema.SCHEMA_VERSION:
        raise RecordingError(
            f"{path} has schema {version}, this program reads schema {schema.SCHEMA_VERSION}; use the version of ltvn "
            "that "
            "wrote it."
        )
    return read_metadata(row, recording_id)
