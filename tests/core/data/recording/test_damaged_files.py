"""Damaged files, new and old: noticed, read without danger to the program, and saved message by message."""

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrf2.file_check import check_file
from ltvn_core.data.recording.rrf2.layout import END_KIND, HEADER_BYTES
from ltvn_core.data.recording.salvage import open_salvage
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from tests.core.data.recording import example_recording
from tests.repository import GOLDEN_RECORDING, ROOT


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "drive.rrd"
    example_recording.write(path, frames=40)
    return path


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    return tmp_path / "damaged.rrd"


@pytest.fixture
def repaired(tmp_path: Path) -> Path:
    return tmp_path / "repaired.rrd"


def messages(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield where each message of a whole file begins, and where it ends."""
    position = HEADER_BYTES
    while struct.unpack_from("<Q", data, position)[0] != END_KIND:
        end = position + 16 + struct.unpack_from("<Q", data, position + 8)[0]
        yield position, end
        position = end


def flipped(data: bytes, place: int, bit: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


def blanked(data: bytes, what: bytes) -> bytes:
    """Overwrite each message in which some bytes stand, but for its beginning."""
    for begin, end in messages(data):
        if what in data[begin:end]:
            left = begin + min(70, (end - begin) // 2)
            data = data[:left] + b"\xff" * (end - left) + data[end:]
    return data


def test_a_bit_that_ends_reruns_reader_is_an_error_like_any_other(damaged: Path, repaired: Path) -> None:
    damaged.write_bytes(flipped(GOLDEN_RECORDING.read_bytes(), 54_327, 5))  # A length inside an Arrow table.
    for look in (Recording.open, verify):
        with pytest.raises(RecordingError, match="ltvn repair"):
            look(damaged)
    saved = repair(damaged, repaired)
    assert (saved.frames, saved.events) == (10, len(example_recording.events()))
    assert any("description" in line for line in saved.left_out)
    assert any("54,222" in line for line in saved.left_out)
    assert not read_info(damaged).whole


def test_a_wrong_length_in_an_older_recording_is_noticed_and_costs_nothing(damaged: Path, repaired: Path) -> None:
    data = GOLDEN_RECORDING.read_bytes()
    for number, (begin, _) in enumerate(messages(data)):
        damaged.write_bytes(flipped(data, begin + 8 + number % 8, number * 3 % 8))
        assert not check_file(damaged).finished
    with pytest.raises(RecordingError, match="damaged"):
        verify(damaged)
    assert repair(damaged, repaired).frames == 10


def test_an_older_recording_has_fewer_checksums_but_rows_of_another_recording_are_told(damaged: Path) -> None:
    assert not verify(GOLDEN_RECORDING).checksummed
    data = GOLDEN_RECORDING.read_bytes()
    begin, _ = list(messages(data))[-1]
    name = data.index(b"step", begin) - begin  # The number of a field is at 16, the recording's id around 24.
    for place, bit, told in ((24, 0, "belong to no recording"), (16, 5, "lacks a part"), (name, 7, "is no text")):
        damaged.write_bytes(flipped(data, begin + place, bit))
        with pytest.raises(RecordingError, match=told):
            verify(damaged)


def test_what_is_left_out_is_named(whole: Path, damaged: Path, repaired: Path) -> None:
    damaged.write_bytes(blanked(whole.read_bytes(), b"camera/rgb"))
    saved = repair(damaged, repaired)
    lost = saved.damaged_frames
    assert (saved.frames, saved.events) == (40 - lost, len(example_recording.events()) - saved.damaged_events)
    assert lost > 0
    assert any(line.startswith(f"{lost} frames: ") for line in saved.left_out)


def test_a_lost_description_and_scene_are_named_and_the_frames_saved(
    tmp_path: Path, damaged: Path, repaired: Path
) -> None:
    path = tmp_path / "scene.rrd"
    glb = b"glTF" + bytes(range(256)) * 4
    with RecordingWriter(path, scene="demo", config={}, fingerprint="", scene_glb=glb) as writer:
        writer.write_frame(example_recording.observation(0))
    damaged.write_bytes(blanked(blanked(path.read_bytes(), b"/__properties/ltvn"), b"Asset3D"))
    saved = repair(damaged, repaired)
    assert saved.frames == 1
    assert "the drawn scene" in saved.left_out
    assert any(line.startswith("the description") for line in saved.left_out)
    verify(repaired)


def test_one_of_the_two_descriptions_is_enough(whole: Path, damaged: Path, repaired: Path) -> None:
    data = whole.read_bytes()
    first = next(span for span in messages(data) if b"/__properties/ltvn" in data[slice(*span)])
    damaged.write_bytes(data[: first[1] - 8] + bytes(8) + data[first[1] :])
    assert repair(damaged, repaired).frames == 40
    assert Recording.open(repaired).meta.config == {"seed": 7}


def test_when_no_frame_and_no_event_is_left_nothing_is_written(whole: Path, damaged: Path, repaired: Path) -> None:
    damaged.write_bytes(blanked(whole.read_bytes(), b""))
    with pytest.raises(RecordingError, match="nothing can be recovered"):
        repair(damaged, repaired)
    assert not repaired.exists()


def test_reruns_reader_gets_no_file_whose_damage_could_end_it() -> None:
    modules = [path for package in ("ltvn_core", "ltvn_viz") for path in (ROOT / package).rglob("*.py")]
    assert not [path.name for path in modules if "RrdReader" in path.read_text(encoding="utf-8")]


def test_rows_of_a_user_that_rerun_would_not_take_back_are_left_out(tmp_path: Path, damaged: Path) -> None:
    with RecordingWriter(tmp_path / "drive.rrd") as writer:
        writer.write_frame(example_recording.observation(0))
        writer.log("my/score", 0.7)
    data = (tmp_path / "drive.rrd").read_bytes()
    spans = list(messages(data))
    begin, end = next(span for span in spans if b"my/score" in data[slice(*span)])
    for written, changed in ((b"entity_path", b"antity_path"), (b"Scalars:", b"\xffcalars:"), (b"@inde", b"@onde")):
        row = data[begin:end].replace(written, changed, 1)
        damaged.write_bytes(data[:begin] + row + data[end : spans[-1][1]])  # Without checksums, which are at the end.
        repaired = tmp_path / f"{written.hex()}.rrd"
        assert any("damaged bytes" in line for line in repair(damaged, repaired).left_out)
        assert (Recording.open(repaired).frames, [*Recording.open(repaired).user_rows()]) == ((0,), [])


@pytest.mark.parametrize("inserted", [b"", bytes(700)], ids=["a hole", "a hole and bytes put in"])
def test_messages_before_and_behind_a_large_hole_are_saved(
    inserted: bytes, tmp_path: Path, damaged: Path, repaired: Path
) -> None:
    path = tmp_path / "drive.rrd"
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        for step in range(12):
            writer.write_frame(example_recording.observation(step))
            writer._stream.flush()
    data = path.read_bytes()
    rgb = [begin for begin, end in messages(data) if b"camera/rgb" in data[begin:end] and end - begin > 3_000]
    begin, end = rgb[3], rgb[6]
    damaged.write_bytes(data[:begin] + bytes(end - begin) + inserted + data[end:])
    saved = repair(damaged, repaired)
    assert saved.frames + saved.damaged_frames == 12
    assert saved.damaged_frames in (3, 4)  # The depth of a neighbour may stand in the hole.
    assert saved.lost_bytes >= end - begin


def test_every_bit_of_a_header_costs_at_most_its_message_and_is_told(whole: Path, damaged: Path) -> None:
    data = whole.read_bytes()
    spans = list(messages(data))
    begin, end = max(spans, key=lambda span: span[1] - span[0])
    for place in range(begin, begin + 16):
        damaged.write_bytes(flipped(data, place, place % 8))
        found = open_salvage(damaged)
        assert found.lost_places, place
        assert found.lost_bytes <= end - begin, place
