"""A predictor whose answers are kept in a file, so that an interrupted build of a map goes on where it was.

A build asks the same questions in the same order each time. Each answer is kept with a checksum of its question; from
the first question that differs on, the file begins anew. Owns the file.
"""

import io
import logging
import pickle
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Features, HeldFeatures, Observation, Prediction, Predictor

_HEADER = struct.Struct("<IIQ")
"""Checksum of the question, checksum and length of the answer."""
_LOG = logging.getLogger(__name__)


class RememberedPredictor:
    """Answers as `predictor` does, and from the file where it holds the answer. Implements `types.Predictor`."""

    def __init__(self, predictor: Predictor, path: Path) -> None:
        """Keep the answers in the file `path`, which an interrupted build may have left; keep none if it cannot be
        opened."""
        self._predictor = predictor
        self._answers = _AnswerFile(path)

    @property
    def fingerprint(self) -> str:
        """Identifier of the weights."""
        return self._predictor.fingerprint

    @property
    def camera(self) -> CameraModel:
        """The camera whose images `encode` takes."""
        return self._predictor.camera

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, F) features, one row per image."""
        question = [np.asarray(part) for seen in observations for part in _parts(seen)]
        return self._answers.answer("encode", question, lambda: [self._predictor.encode(observations)])[0]

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, F) with targets (N, F) in one batch."""
        found = self._answers.answer("predict", [sources, targets], lambda: self._predictor.predict(sources, targets))
        return Prediction(*found)

    def __enter__(self) -> Self:
        """Return this predictor."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the file, which stays."""
        self._answers.close()

    def __getattr__(self, name: str) -> Any:
        """Return the other abilities of the predictor, where it has them."""
        found = getattr(self._predictor, name)
        return self._among(found) if name == "predict_among" else found

    def _among(self, predict_among: Callable[..., Prediction]) -> Callable[[Features, HeldFeatures], Prediction]:
        def remembered(source: Features, held: HeldFeatures) -> Prediction:
            question = [source, held.keys[held.rows], held.rows]
            return Prediction(*self._answers.answer("among", question, lambda: predict_among(source, held)))

        return remembered


class _AnswerFile:
    """Answers in the order of their questions: first those of an earlier build, then new ones."""

    def __init__(self, path: Path) -> None:
        self._file: io.BufferedRandom | None = None
        self._is_known = False
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch(mode=0o600)
            self._size_bytes = path.stat().st_size
            self._file = path.open("r+b")
            self._is_known = True
        except OSError as error:
            _warn(error)

    def answer(
        self, kind: str, question: Iterable[NDArray[Any]], compute: Callable[[], Iterable[NDArray[Any]]]
    ) -> list[NDArray[Any]]:
        """Return the stored answer if the file goes on with this question; else compute and store it."""
        asked = zlib.crc32(kind.encode())
        for part in question:
            asked = _checksum(part, asked)
        known = self._next(asked) if self._is_known else None
        if known:
            return known
        answer = list(compute())
        if known is None:
            self._append(asked, answer)
        return answer

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def _next(self, asked: int) -> list[NDArray[Any]] | None:
        """Return the next stored answer, which may be empty, if it is for this question; else forget it and all that
        follow."""
        assert self._file is not None
        start = self._file.tell()
        header = self._file.read(_HEADER.size)
        if len(header) == _HEADER.size:
            question, checksum, length = _HEADER.unpack(header)
            if question == asked and length <= self._size_bytes:
                body = self._file.read(length)
                if zlib.crc32(body) == checksum:
                    return _arrays(body)
        self._is_known = False
        self._file.seek(start)
        self._file.truncate()
        return None

    def _append(self, asked: int, answer: Sequence[NDArray[Any]]) -> None:
        if self._file is None:
            return
        body = io.BytesIO()
        # Features of other types than numbers are not stored, because reading them could run code; they are made anew.
        for part in answer if not any(part.dtype.hasobject for part in answer) else ():
            np.lib.format.write_array(body, np.asarray(part), allow_pickle=False)
        data = body.getvalue()
        try:
            self._file.write(_HEADER.pack(asked, zlib.crc32(data), len(data)) + data)
            self._file.flush()
        except OSError as error:
            _warn(error)
            self.close()


def _warn(error: OSError) -> None:
    _LOG.warning("If this build is interrupted, it will have to begin anew: %s.", error.strerror)


def _checksum(part: NDArray[Any], start: int) -> int:
    start = zlib.crc32(repr((part.shape, part.dtype)).encode(), start)
    return zlib.crc32(pickle.dumps(part) if part.dtype.hasobject else np.ascontiguousarray(part).data, start)


def _parts(seen: Observation) -> Iterator[NDArray[Any] | int]:
    yield seen.step
    yield seen.odometry
    yield seen.rgb
    if seen.depth is not None:
        yield seen.depth


def _arrays(body: bytes) -> list[NDArray[Any]]:
    stream = io.BytesIO(body)
    found = list[NDArray[Any]]()
    while stream.tell() < len(body):
        found.append(np.lib.format.read_array(stream, allow_pickle=False))
    return found
