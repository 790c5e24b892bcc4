"""The files of an ONNX model: the model itself, and the data beside it that it names. All are of strangers.

Owns which files these are, their limits, and the hash of their contents. They are plain files, not too large, and lie
in the folder of the card.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath

from ltvn_core.data.importing.foreign_files import read_foreign, require_plain
from ltvn_core.errors import DriveError, WeightsError
from ltvn_core.protobuf_fields import bytes_fields, read_fields

_MOST_CARD_BYTES = 1_000_000
_MOST_MODEL_BYTES = 2_147_483_648
"""Largest size of a model; a larger one cannot be written in this format, and keeps its data beside it."""
_MOST_DATA_BYTES = 17_179_869_184

_PARTS = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "function": {7: "node", 11: "attribute"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
}
"""The messages of ONNX that may contain tensors, with the numbers and kinds of their fields."""
_EXTERNAL_DATA = 13
"""The field of a tensor with the pairs of texts that name its data."""


def read_card_text(path: Path) -> str:
    """Return the text of a card. Raises WeightsError; ValueError if it is not UTF-8."""
    return _read(path, _MOST_CARD_BYTES, "name the .toml card of an ONNX model").decode("utf-8")


def model_contents(path: Path) -> Iterator[bytes]:
    """Yield the contents of a model and of the data beside it, in parts, for a fingerprint.

    Raises WeightsError if one is missing, too large, not a plain file, or not beside the model.
    """
    model = _read(path, _MOST_MODEL_BYTES, "the card names it as its model")
    yield model
    try:
        names = sorted(set(_data_names(model)))
    except ValueError as error:
        raise WeightsError(f"{path}: is not an ONNX model that can be loaded ({error}).") from error
    for name in names:
        yield _data_digest(path, name)


def _data_digest(model: Path, name: str) -> bytes:
    if not name or "\0" in name or "\\" in name or Path(name).name != name or PureWindowsPath(name).name != name:
        raise WeightsError(
            f"{model}: names its data as {name!r:.80}, which is not a file beside it; save model and data together."
        )
    data = model.with_name(name)
    try:
        require_plain(data)
        if data.stat().st_size > _MOST_DATA_BYTES:
            raise DriveError(f"{data} has more than {_MOST_DATA_BYTES:,} bytes, which is too large for a model.")
        with data.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except DriveError as error:
        raise WeightsError(str(error)) from error
    except OSError as error:
        raise WeightsError(f"{data}: cannot be read ({error.strerror}); {model.name} keeps its data there.") from error


def _data_names(model: bytes) -> Iterator[str]:
    """Yield the names of the files with data of tensors. Raises ValueError if it is not a model."""
    left = [("model", model)]
    while left:
        kind, message = left.pop()
        for field in read_fields(message):
            if not isinstance(field.value, bytes):
                continue
            if kind == "tensor":
                if field.number == _EXTERNAL_DATA:
                    entry = bytes_fields(field.value)
                    if entry.get(1) == b"location":
                        yield entry.get(2, b"").decode("utf-8")
            elif part := _PARTS[kind].get(field.number):
                left.append((part, field.value))


def _read(path: Path, most_bytes: int, why: str) -> bytes:
    try:
        return read_foreign(path, most_bytes=most_bytes, what="model")
    except DriveError as error:
        raise WeightsError(f"{error} As a model or its card, {why}.") from error
    except OSError as error:
        raise WeightsError(f"{path}: cannot be read ({error.strerror}); {why}.") from error
