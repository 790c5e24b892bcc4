"""An interrupted build goes on from the answers that were kept, and gives the map of an uninterrupted one."""

import os
import pickle
import struct
import sys
import zlib
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.maps.built_map import build_map
from ltvn_core.predictors.remembered_answers import RememberedPredictor
from ltvn_core.robots.robot_spec import LOCOBOT
from tests.core.flat_world import FlatPredictor, one_room, tour

WAY = ((1.0, 1.0), (4.0, 1.0), (4.0, 3.0), (1.0, 3.0))
SHORT_WAY = ((1.0, 1.0), (2.0, 1.0))


def built(
    answers: Path | None,
    progress: ProgressCallback = lambda _done, _total: None,
    way: Sequence[tuple[float, float]] = WAY,
    *,
    predictor: FlatPredictor | None = None,
    named: Sequence[str] = ("flat", "room"),
) -> tuple[tuple[GraphDelta, ...], int]:
    """Build a map; return its contents, and how many pairs the predictor had to compare."""
    predictor = predictor or FlatPredictor(one_room())
    with nullcontext(predictor) if answers is None else RememberedPredictor(predictor, answers, named=named) as asked:
        graph = build_map(list(tour(way)), predictor=asked, progress=progress).graph
    return graph.deltas(), predictor.compared


def interrupt(answers: Path, share: float = 0.6) -> None:
    """Interrupt a build after a share of its images."""

    def progress(done: int, total: int) -> None:
        if done > share * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        built(answers, progress)


def untouched(data: bytes) -> bytes:
    return data


@pytest.mark.parametrize(
    "damage",
    [untouched, lambda data: data[:-7], lambda data: data[: len(data) // 2] + b"?" + data[len(data) // 2 + 1 :]],
    ids=["as it was left", "cut off by the kill", "a byte changed"],
)
def test_an_interrupted_build_goes_on_to_the_same_map(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    whole, comparisons = built(None)
    answers = tmp_path / "map.rrd.unfinished"
    interrupt(answers)
    answers.write_bytes(damage(answers.read_bytes()))
    again, fewer = built(answers)
    assert again == whole
    assert 0 < fewer < comparisons


def test_the_answers_of_another_drive_are_not_used(tmp_path: Path) -> None:
    answers = tmp_path / "map.rrd.unfinished"
    interrupt(answers)
    there = ((2.0, 1.0), (4.5, 1.0), (4.5, 2.5))
    assert built(answers, way=there) == built(None, way=there)


def test_a_finished_build_asks_nothing_again(tmp_path: Path) -> None:
    answers = tmp_path / "map.rrd.unfinished"
    whole, _ = built(answers)
    assert built(answers) == (whole, 0)


def test_a_build_whose_answers_cannot_be_kept_goes_on_without_them(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert built(tmp_path / "file" / "map.rrd.unfinished") == built(None)


def test_a_folder_that_is_not_there_is_made(tmp_path: Path) -> None:
    answers = tmp_path / "new" / "folder" / "map.rrd.unfinished"
    assert built(answers) == built(None)
    assert answers.exists()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[tuple[GraphDelta, ...], int, bytes]:
    """Return the map of a short drive, how many pairs it takes, and the answers that a build of it keeps."""
    answers = tmp_path_factory.mktemp("short") / "answers"
    return (*built(answers, way=SHORT_WAY), answers.read_bytes())


@pytest.mark.parametrize(
    ("predictor", "named"),
    [
        (FlatPredictor(one_room(), fingerprint="other weights"), ("flat", "room")),
        (FlatPredictor(one_room(), camera=replace(LOCOBOT.camera, height_m=0.3)), ("flat", "room")),
        (FlatPredictor(one_room()), ("other predictor", "room")),
        (FlatPredictor(one_room()), ("flat", "other scene")),
    ],
    ids=["weights", "camera", "predictor", "scene"],
)
def test_the_answers_of_another_predictor_are_not_used(
    tmp_path: Path,
    short: tuple[tuple[GraphDelta, ...], int, bytes],
    predictor: FlatPredictor,
    named: Sequence[str],
) -> None:
    whole, pairs, kept = short
    answers = tmp_path / "map.rrd.unfinished"
    answers.write_bytes(kept)
    assert built(answers, way=SHORT_WAY, predictor=predictor, named=named) == (whole, pairs)


def forged(answers: Path, body: bytes | Callable[[bytes], bytes], number: int) -> None:
    """Replace an answer, with a checksum that fits."""
    data = answers.read_bytes()
    place = data.index(b"\n") + 1
    place += 4 + int.from_bytes(data[place : place + 4], "little")
    header = struct.Struct("<IIQ")
    for _ in range(number):
        place += header.size + header.unpack_from(data, place)[2]
    asked, _, length = header.unpack_from(data, place)
    rest = place + header.size + length
    new = body if isinstance(body, bytes) else body(data[place + header.size : rest])
    answers.write_bytes(data[:place] + header.pack(asked, zlib.crc32(new), len(new)) + new + data[rest:])


@pytest.mark.parametrize("number", [0, 5], ids=["features", "pairs"])
@pytest.mark.parametrize(
    "body",
    [
        b"\0",
        b"?" * 64,
        pickle.dumps(np.zeros(3)),
        struct.pack("<8sBQ", b"<f8", 1, 2**60),
        struct.pack("<8sBQ", b"|V0", 1, 2**60),
        struct.pack("<8sBQQ", b"|O", 2, 1, 1) + bytes(8),
        struct.pack("<8sBQ", b"<f8", 1, 3) + bytes(24),
        lambda body: body.replace(np.float64(0.95).tobytes(), np.float64(np.nan).tobytes()) + b"\1",
        lambda body: body + body,
    ],
    ids=["byte", "text", "pickle", "huge", "void", "object", "shape", "not a number", "twice"],
)
def test_forged_answers_are_made_anew(
    tmp_path: Path,
    short: tuple[tuple[GraphDelta, ...], int, bytes],
    body: bytes | Callable[[bytes], bytes],
    number: int,
) -> None:
    whole, _, kept = short
    answers = tmp_path / "map.rrd.unfinished"
    answers.write_bytes(kept)
    forged(answers, body, number)
    assert built(answers, way=SHORT_WAY)[0] == whole


@pytest.mark.parametrize("content", [b"my own notes", b"LTVN answers 0\n", bytes(5000)])
def test_a_file_that_holds_no_answers_is_moved_aside(
    tmp_path: Path, short: tuple[tuple[GraphDelta, ...], int, bytes], content: bytes
) -> None:
    answers = tmp_path / "map.rrd.unfinished"
    answers.write_bytes(content)
    assert built(answers, way=SHORT_WAY)[0] == short[0]
    assert content in {path.read_bytes() for path in tmp_path.iterdir()}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such pipes")
def test_a_pipe_in_the_place_of_the_answers_is_left_alone(tmp_path: Path) -> None:
    answers = tmp_path / "map.rrd.unfinished"
    os.mkfifo(answers)
    built(answers, way=SHORT_WAY)
    assert answers.is_fifo()
