"""What is whole inside damaged messages, and in files that were put together wrongly, comes back frame by frame."""

import struct
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.integrity import RepairedRecording, repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrf2.file_check import walk_messages
from ltvn_core.data.recording.rrf2.layout import CHUNK_KIND, END_KIND, HEADER_BYTES, MESSAGE_HEADER, TAIL_BYTES, Tail
from ltvn_core.errors import RecordingError
from tests.core.data.recording import example_recording
from tests.repository import GOLDEN_RECORDING

FRAMES = 30


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.rrd"
    example_recording.write(path, frames=FRAMES)
    return path


@pytest.fixture(scope="module")
def other_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("other") / "other.rrd"
    example_recording.write(path, frames=7)
    return path


def spans(path: Path) -> list[tuple[int, int]]:
    """Return where each message of a whole file begins and ends."""
    found, begin = list[tuple[int, int]](), HEADER_BYTES
    with path.open("rb") as file:
        for _, _, length in walk_messages(file, path.stat().st_size):
            found.append((begin, begin + MESSAGE_HEADER.size + length))
            begin = found[-1][1]
    return found


def inside_largest(path: Path) -> int:
    """Return a place among the pictures of the largest message."""
    begin, end = max(spans(path), key=lambda span: span[1] - span[0])
    return begin + (end - begin) * 2 // 3


def patched(data: bytes, place: int, patch: bytes) -> bytes:
    return data[:place] + patch + data[place + len(patch) :]


def repaired(
    tmp_path: Path, data: bytes, recording_id: str | None = None, *, name: str = ""
) -> tuple[RepairedRecording, Recording]:
    """Repair these bytes, and require that whatever came back is as it was written."""
    damaged, output = tmp_path / "damaged.rrd", tmp_path / f"repaired-{recording_id}{name}.rrd"
    damaged.write_bytes(data)
    saved = repair(damaged, output, recording_id=recording_id)
    verify(output)
    return saved, Recording.open(output)


def with_ending_of_before(data: bytes, end: int) -> bytes:
    """Cut a file at the end of a message, and end it as files without a table are ended."""
    start = end + MESSAGE_HEADER.size
    return data[:end] + struct.pack("<QQ", END_KIND, 0) + Tail.of(start, b"").encoded()


def test_a_flipped_bit_costs_at_most_the_frames_of_its_message_and_is_told(drive: Path, tmp_path: Path) -> None:
    data, (begin, end) = drive.read_bytes(), max(spans(drive), key=lambda span: span[1] - span[0])
    for place in (begin + 9, begin + 40, begin + 300, inside_largest(drive), end - 1):
        saved, recording = repaired(tmp_path, patched(data, place, bytes([data[place] ^ 8])), name=str(place))
        assert saved.frames + saved.damaged_frames == FRAMES
        assert (saved.events, saved.damaged_events) == (len(example_recording.events()), 0)
        assert any("damaged bytes" in line for line in saved.left_out)
        assert recording.meta == Recording.open(drive).meta


def test_a_hole_in_a_message_costs_at_most_its_frames(drive: Path, tmp_path: Path) -> None:
    place = inside_largest(drive)
    saved, recording = repaired(tmp_path, patched(drive.read_bytes(), place, bytes(60)))
    assert saved.frames + saved.damaged_frames == FRAMES
    assert any(f"{saved.damaged_frames} frames" in line for line in saved.left_out)
    kept = Recording.open(drive)
    assert all(recording.stored_frame(each).frame.rgb == kept.stored_frame(each).frame.rgb for each in recording.frames)


def test_a_flipped_bit_in_a_recording_without_checksums_of_messages_costs_a_frame(tmp_path: Path) -> None:
    data, place = GOLDEN_RECORDING.read_bytes(), inside_largest(GOLDEN_RECORDING)
    saved, _ = repaired(tmp_path, patched(data, place, bytes([data[place] ^ 8])))
    assert (saved.frames, saved.damaged_frames) == (9, 1)


def test_two_recordings_one_behind_the_other_both_come_back(drive: Path, other_drive: Path, tmp_path: Path) -> None:
    data = drive.read_bytes() + other_drive.read_bytes()
    ids = [Recording.open(path).meta.recording_id for path in (drive, other_drive)]
    with pytest.raises(RecordingError, match=f"{ids[0]} and {ids[1]}"):
        repaired(tmp_path, data)
    for recording_id, frames in zip(ids, (FRAMES, 7), strict=True):
        saved, _ = repaired(tmp_path, data, recording_id)
        assert (saved.frames, saved.events) == (frames, len(example_recording.events()))
        assert saved.left_out


def test_the_end_of_another_recording_is_never_saved_under_the_id_of_the_first(
    drive: Path, other_drive: Path, tmp_path: Path
) -> None:
    end, other = spans(drive)[-1][1], other_drive.read_bytes()
    chunks = [begin for begin, _ in spans(other_drive) if MESSAGE_HEADER.unpack_from(other, begin)[0] == CHUNK_KIND]
    # The description of the second one's store is lost, and the ending is that of the second one.
    data = drive.read_bytes()[:end] + other[chunks[0] :]
    both = [Recording.open(path) for path in (drive, other_drive)]
    with pytest.raises(RecordingError, match=f"{both[0].meta.recording_id}.*--recording-id"):
        repaired(tmp_path, data)
    for each in both:
        saved, recording = repaired(tmp_path, data, each.meta.recording_id)
        assert recording.frames == each.frames
        assert recording.meta == each.meta or any("description" in line for line in saved.left_out)
        for frame in recording.frames:
            assert recording.stored_frame(frame).rgb_checksum == each.stored_frame(frame).rgb_checksum
        assert recording.events == each.events


def test_the_same_recording_twice_in_a_file_is_saved_once(drive: Path, tmp_path: Path) -> None:
    data, place = drive.read_bytes(), inside_largest(drive)
    saved, _ = repaired(tmp_path, patched(data, place, bytes(60)) + data)
    assert (saved.frames, saved.events) == (FRAMES, len(example_recording.events()))


def test_whole_messages_with_another_files_ending_come_back(drive: Path, other_drive: Path, tmp_path: Path) -> None:
    end, other_end = spans(drive)[-1][1], spans(other_drive)[-1][1]
    saved, _ = repaired(tmp_path, drive.read_bytes()[:end] + other_drive.read_bytes()[other_end:])
    assert (saved.frames, saved.events) == (FRAMES, len(example_recording.events()))
    assert any("last part" in line for line in saved.left_out)


def test_messages_in_another_order_come_back(drive: Path, tmp_path: Path) -> None:
    data, (first, *others) = drive.read_bytes(), spans(drive)
    order = [others[number] for number in np.random.default_rng(5).permutation(len(others))]
    shuffled = b"".join(data[slice(*span)] for span in [(0, first[1]), *order, (others[-1][1], len(data))])
    saved, _ = repaired(tmp_path, shuffled)
    assert (saved.frames, saved.events, saved.left_out) == (FRAMES, len(example_recording.events()), ())


@pytest.mark.parametrize("share", [0.3, 0.7, 1.0])
def test_a_file_cut_between_messages_and_ended_without_a_table_is_refused(
    drive: Path, tmp_path: Path, share: float
) -> None:
    found = spans(drive)
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(with_ending_of_before(drive.read_bytes(), found[int(share * (len(found) - 1))][1]))
    for look in (verify, Recording.open):
        with pytest.raises(RecordingError, match="ltvn repair"):
            look(cut)
    assert not read_info(cut).whole


def test_a_table_of_other_chunks_is_refused(tmp_path: Path) -> None:
    data, (*kept, (begin, end)) = GOLDEN_RECORDING.read_bytes(), spans(GOLDEN_RECORDING)
    tail = Tail.read(data[-TAIL_BYTES:])
    assert tail is not None
    assert kept
    shorter = tmp_path / "shorter.rrd"
    moved = tail._replace(footer_start=tail.footer_start - (end - begin))
    shorter.write_bytes(data[:begin] + data[end:-TAIL_BYTES] + moved.encoded())
    with pytest.raises(RecordingError, match="same chunks"):
        verify(shorter)
