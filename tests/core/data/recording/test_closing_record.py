"""A finished recording knows every one of its bytes, and how many rows were written."""

from dataclasses import replace
from pathlib import Path

import pytest
import rerun.chunk

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrf2.closing_record import closing_bytes, last_closing_record
from ltvn_core.data.recording.rrf2.file_check import check_file
from ltvn_core.errors import RecordingError
from tests.core.data.recording import example_recording
from tests.repository import DEMO_DRIVE, DEMO_FAULT, DEMO_MAP, GOLDEN_RECORDING
from tools.redraw import redraw


def test_a_finished_recording_counts_its_rows_and_messages(whole: Path) -> None:
    found = check_file(whole)
    assert found.record is not None
    assert found.whole_bytes == found.record.messages_end
    assert found.record.rows[schema.RGB] == found.record.rows[schema.DEPTH] == 10
    assert found.record.rows[schema.EVENTS] == len(example_recording.events())
    assert verify(whole).checksummed


def test_every_changed_byte_is_found_before_the_file_is_read(whole: Path, tmp_path: Path) -> None:
    data, changed = whole.read_bytes(), tmp_path / "changed.rrd"
    step = 397  # A prime, so that headers, names, pictures, the record and the tail are all met.
    for place in [*range(0, len(data), step), *range(20), *range(len(data) - 40, len(data))]:
        damaged = bytearray(data)
        damaged[place] ^= 1 << place % 8
        changed.write_bytes(damaged)
        found = check_file(changed)
        assert found.damage is not None or not found.finished, place
    with pytest.raises(RecordingError, match="ltvn repair"):
        Recording.open(changed)


def test_bytes_added_or_taken_away_anywhere_are_found(whole: Path, tmp_path: Path) -> None:
    data, changed = whole.read_bytes(), tmp_path / "changed.rrd"
    for place in range(0, len(data), len(data) // 60):
        for damaged in (data[:place] + b"\0" + data[place:], data[:place] + data[place + 1 :]):
            changed.write_bytes(damaged)
            found = check_file(changed)
            assert found.damage is not None or not found.finished, place


def test_rerun_reads_a_recording_with_a_closing_record(whole: Path) -> None:
    reader = rerun.chunk.RrdReader(whole)
    assert [store.application_id for store in reader.recordings()] == [schema.APPLICATION_ID]
    assert len(list(reader.stream())) > 10
    assert reader.blueprints()


def test_a_recording_that_lost_rows_before_it_was_finished_is_refused(whole: Path, tmp_path: Path) -> None:
    record = check_file(whole).record
    assert record is not None
    fewer = tmp_path / "fewer.rrd"
    data = whole.read_bytes()[: record.messages_end]
    rows = {**record.rows, schema.EVENTS: record.rows[schema.EVENTS] + 1}
    fewer.write_bytes(data + closing_bytes(replace(record, rows=rows)))
    with pytest.raises(RecordingError, match="rows of events were written"):
        verify(fewer)


def test_the_record_is_found_in_a_file_that_is_damaged_elsewhere(whole: Path) -> None:
    data, record = whole.read_bytes(), check_file(whole).record
    found = last_closing_record(data[len(data) // 2 + 5 :])
    assert found is not None
    assert record is not None
    assert (found.messages == record.messages).all()
    assert found.rows == record.rows
    assert last_closing_record(data[:-40]) is None
    assert last_closing_record(b"") is None


def test_an_older_recording_can_be_drawn_anew_and_holds_the_same(tmp_path: Path) -> None:
    redraw(GOLDEN_RECORDING, tmp_path / "new.rrd")
    assert verify(tmp_path / "new.rrd").checksummed
    old, new = Recording.open(GOLDEN_RECORDING), Recording.open(tmp_path / "new.rrd")
    assert new.events == old.events
    assert new.frames == old.frames
    assert all(new.stored_frame(each).frame.rgb == old.stored_frame(each).frame.rgb for each in old.frames)
    with pytest.raises(RecordingError, match="exists"):
        redraw(GOLDEN_RECORDING, tmp_path / "new.rrd")


@pytest.mark.parametrize("path", [DEMO_DRIVE, DEMO_FAULT, DEMO_MAP], ids=lambda path: path.stem)
def test_the_recordings_that_come_with_the_toolkit_have_checksums(path: Path) -> None:
    record = check_file(path).record
    assert record is not None
    assert record.rows[schema.EVENTS] > 0


def test_the_bit_of_the_demo_drive_that_once_hid_all_its_frames_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    data = bytearray(DEMO_DRIVE.read_bytes())
    data[53_580] ^= 1 << 7
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="ltvn repair"):
        verify(path)
    saved = repair(path, tmp_path / "repaired.rrd")
    assert saved.frames + saved.damaged_frames == 878
    assert saved.damaged_frames <= 250  # Those of one message.
    assert saved.left_out
