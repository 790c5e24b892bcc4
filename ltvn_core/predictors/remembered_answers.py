"""A predictor whose answers are kept in a file, so that an interrupted build of a map goes on where it was.

The file begins with all that the answers depend on; the answers of another predictor are not used. A build asks the
same questions in the same order each time. Each answer is kept with a checksum of its question; from the first question
that differs on, the file begins anew. What is read is checked, because anybody may have written it. Owns the file.
"""

import io
import logging
import math
import pickle
import stat
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.request import predictor_card
from ltvn_core.types import Features, HeldFeatures, Observation, Prediction, Predictor

_MAGIC = b"LTVN answers 1\n"
_HEADER = struct.Struct("<IIQ")
"""Checksum of the question, checksum and length of the answer."""
_PART = struct.Struct("<8sB")
"""Type and number of dimensions of an array, whose shape and contents follow."""
_KINDS = {np.dtype(kind).str for kind in "?bBhHiIlLqQefd"}
"""Types of arrays that are kept: plain numbers, because reading others could run code."""
_FARTHEST_M = 1e6
"""Largest number of a waypoint that can be an answer."""
_LOG = logging.getLogger(__name__)

_Arrays = list[NDArray[Any]]


class RememberedPredictor:
    """Answers as `predictor` does, and from the file where it holds the answer. Implements `types.Predictor`."""

    def __init__(self, predictor: Predictor, path: Path, *, named: Sequence[str]) -> None:
        """Keep the answers in the file `path`, which an interrupted build may have left; keep none if it cannot be
        opened.

        `named` are the names on which answers depend besides the predictor's card: its own and that of the scene.
        """
        self._predictor = predictor
        self._answers = _AnswerFile(path, _description(predictor, named))
        self._row: Features | None = None
        """The features of one image as they are on this machine."""

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

        def fits(found: _Arrays) -> bool:
            if self._row is None:
                self._row = self._predictor.encode(observations[:1])
            like = self._row
            return [(each.shape, each.dtype) for each in found] == [((len(observations), *like.shape[1:]), like.dtype)]

        return self._answers.answer("encode", question, lambda: [self._predictor.encode(observations)], fits)[0]

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, F) with targets (N, F) in one batch."""
        question = [sources, targets]
        count = max(len(sources), len(targets))
        found = self._answers.answer(
            "predict", question, lambda: self._predictor.predict(sources, targets), lambda each: _is_for(each, count)
        )
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
            count = len(held.rows)
            found = self._answers.answer(
                "among", question, lambda: predict_among(source, held), lambda each: _is_for(each, count)
            )
            return Prediction(*found)

        return remembered


class _AnswerFile:
    """Answers in the order of their questions: first those of an earlier build, then new ones."""

    def __init__(self, path: Path, description: bytes) -> None:
        self._file: io.BufferedRandom | None = None
        self._is_known = False
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._is_known = _has_answers(path, description)
            path.touch(mode=0o600)
            self._size_bytes = path.stat().st_size
            self._file = path.open("r+b")
            if self._is_known:
                self._file.seek(len(description))
            else:
                self._file.truncate()
                self._file.write(description)
        except OSError as error:
            self._is_known = False
            _warn(error)
            self.close()

    def answer(
        self,
        kind: str,
        question: Iterable[NDArray[Any]],
        compute: Callable[[], Iterable[NDArray[Any]]],
        fits: Callable[[_Arrays], bool],
    ) -> _Arrays:
        """Return the stored answer if the file goes on with this question and the answer `fits`; else compute and store
        it."""
        asked = zlib.crc32(kind.encode())
        for part in question:
            asked = _checksum(part, asked)
        known = self._next(asked, fits) if self._is_known else None
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

    def _next(self, asked: int, fits: Callable[[_Arrays], bool]) -> _Arrays | None:
        """Return the next stored answer, which may be empty, if it is for this question; else forget it and all that
        follow."""
        assert self._file is not None
        start = self._file.tell()
        header = self._file.read(_HEADER.size)
        if len(header) == _HEADER.size:
            question, checksum, length = _HEADER.unpack(header)
            if question == asked and length <= self._size_bytes:
                body = self._file.read(length)
                found = _arrays(body) if zlib.crc32(body) == checksum else None
                if found is not None and (not found or fits(found)):
                    return found
        self._is_known = False
        self._file.seek(start)
        self._file.truncate()
        return None

    def _append(self, asked: int, answer: Sequence[NDArray[Any]]) -> None:
        if self._file is None:
            return
        # Answers of other types than numbers are not stored; they are made anew.
        is_kept = all(part.dtype.str in _KINDS for part in answer)
        data = b"".join(_packed(part) for part in answer) if is_kept else b""
        try:
            self._file.write(_HEADER.pack(asked, zlib.crc32(data), len(data)) + data)
            self._file.flush()
        except OSError as error:
            _warn(error)
            self.close()


def _description(predictor: Predictor, named: Sequence[str]) -> bytes:
    """Return the first bytes of a file of answers: all that the answers to the same questions depend on."""
    card = predictor_card(predictor)
    told = repr((*named, card.fingerprint, card.camera, card.needs_depth, card.device, version("ltvn"))).encode(
        "utf-8", "replace"
    )
    return _MAGIC + struct.pack("<I", len(told)) + told


def _has_answers(path: Path, description: bytes) -> bool:
    """Tell whether a file begins with a description. One of other answers begins anew, and any other file is moved
    aside, so that nothing of the user's is overwritten. Raises OSError."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    if not stat.S_ISREG(mode):
        raise OSError(0, f"{path} is not a file")
    with path.open("rb") as file:
        begins = file.read(len(description))
    if begins == description:
        _LOG.warning("Going on with an interrupted build. To begin anew, delete %s.", path)
        return True
    if begins.startswith(_MAGIC):
        _LOG.warning("%s is of an interrupted build with another predictor, so this build begins anew.", path)
    elif begins:
        aside = next(each for k in range(1, 1000) if not (each := path.with_name(f"{path.name}.{k}")).exists())
        path.rename(aside)
        _LOG.warning("%s is not of an interrupted build; it is now %s, and this build begins anew.", path, aside)
    return False


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


def _is_for(found: _Arrays, count: int) -> bool:
    """Tell whether arrays are a prediction for a number of pairs."""
    if [each.shape for each in found] != [(count,), (count, 3)] or any(each.dtype.kind != "f" for each in found):
        return False
    reachability, waypoints = found
    return bool(((reachability >= 0) & (reachability <= 1)).all() and (np.abs(waypoints) <= _FARTHEST_M).all())


def _packed(part: NDArray[Any]) -> bytes:
    shape = struct.pack(f"<{part.ndim}Q", *part.shape)
    return _PART.pack(part.dtype.str.encode(), part.ndim) + shape + part.tobytes()


def _arrays(body: bytes) -> _Arrays | None:
    """Return the arrays of an answer; None if these are not the bytes of an answer."""
    found = _Arrays()
    place = 0
    try:
        while place < len(body):
            kind, dimensions = _PART.unpack_from(body, place)
            place += _PART.size
            shape = struct.unpack_from(f"<{dimensions}Q", body, place)
            place += 8 * dimensions
            name = kind.rstrip(b"\0").decode("ascii")
            if name not in _KINDS or math.prod(shape) * np.dtype(name).itemsize > len(body) - place:
                return None
            array = np.frombuffer(body, name, math.prod(shape), place).reshape(shape)
            found.append(array.copy())  # Callers may write to answers.
            place += array.nbytes
    except (struct.error, ValueError, TypeError, OverflowError):
        return None
    return found
