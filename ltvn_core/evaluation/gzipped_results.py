"""Result files that are kept gzipped: `NAME.json.gz` stands for `NAME.json` wherever results are read.

Owns the name and the bytes, which do not depend on when a text is packed. What a result holds is in
`evaluation.results`.
"""

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path

from ltvn_core.atomic_files import atomic_output
from ltvn_core.errors import OptionError

SUFFIX = ".gz"
MAX_BYTES = 256_000_000
"""Of an unpacked file; 50 times the largest result that was ever written."""


def packed_path(path: Path) -> Path:
    """Return where a result lies that is kept gzipped."""
    return path.with_name(path.name + SUFFIX)


def is_stored(path: Path) -> bool:
    """Tell whether there is a result of this name, packed or not."""
    return path.exists() or packed_path(path).exists()


def stored_results(folder: Path, pattern: str) -> Iterator[Path]:
    """Yield the results below a folder whose names match, in order; a plain file goes before its packed twin."""
    plain = set(folder.rglob(pattern))
    packed = {path for path in folder.rglob(pattern + SUFFIX) if path.with_suffix("") not in plain}
    yield from sorted(plain | packed)


def read_result_text(path: Path) -> str:
    """Return the text of a result, which may lie gzipped beside its name.

    Raises OSError, OptionError for what is no gzip file or too large, and ValueError for what is no text.
    """
    if path.suffix != SUFFIX and not path.exists() and packed_path(path).exists():
        path = packed_path(path)
    return _unpacked(path) if path.suffix == SUFFIX else path.read_text(encoding="utf-8")


def pack(path: Path) -> Path:
    """Replace a result by its gzipped twin and return that. Raises RecordingError if there is one already."""
    packed = packed_path(path)
    with atomic_output(packed) as part:
        part.write_bytes(gzip.compress(path.read_bytes(), compresslevel=9, mtime=0))
    path.unlink()
    return packed


def _unpacked(path: Path) -> str:
    try:
        with gzip.open(path) as file:
            content = file.read(MAX_BYTES + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise OptionError(f"{path} is damaged, or not packed by gzip: {error}.") from error
    if len(content) > MAX_BYTES:
        raise OptionError(f"{path} unpacks to more than {MAX_BYTES // 1_000_000} MB, which is no result.")
    return content.decode("utf-8")
