"""Killed, cut, foreign and full: what verify says and what repair gives back."""

import signal
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest
import rerun as rr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_core.graph.topological_graph import TopologicalGraph
from tests.core.data.recording import example_recording
from tests.platforms import needs_posix
from tests.repository import GOLDEN_RECORDING, ROOT
from tests.waiting import until

RECORD_FOR_EVER = """
import signal, sys, time
from pathlib import Path
from ltvn_core.data.recording.writer import RecordingWriter
from tests.core.data.recording import example_recording

# Whoever runs the tests in the background hands on that interrupts are ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
with RecordingWriter(Path(sys.argv[1]), scene="demo", config={}, fingerprint="") as writer:
    for step in range(10**6):
        writer.write_frame(example_recording.observation(step))
        print(step, time.monotonic(), flush=True)
        time.sleep(0.01)
"""


def test_a_finished_recording_is_accepted(whole: Path) -> None:
    verified = verify(whole)
    assert (verified.frames, verified.events) == (10, len(example_recording.events()))


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 0.999))
def test_a_cut_recording_is_refused_and_its_whole_frames_come_back(whole: Path, tmp_path: Path, share: float) -> None:
    data = whole.read_bytes()
    cut, repaired = tmp_path / "cut.rrd", tmp_path / "repaired.rrd"
    cut.write_bytes(data[: int(share * len(data))])
    repaired.unlink(missing_ok=True)
    with pytest.raises(RecordingError):
        verify(cut)
    try:
        saved = repair(cut, repaired)
    except RecordingError:
        # Only where no message with images is whole.
        assert cut.stat().st_size < data.rindex(b"camera/depth")
        assert not repaired.exists()
        return
    assert verify(repaired).frames == saved.frames
    recording = Recording.open(repaired)
    assert list(recording.frames) == list(range(saved.frames))
    for frame in recording.frames:
        assert (recording.observation(frame).odometry == example_recording.observation(frame).odometry).all()
    assert cut.read_bytes() == data[: int(share * len(data))]


def test_a_drive_cut_before_its_first_whole_frame_is_not_said_to_be_repaired(tmp_path: Path) -> None:
    cut, repaired = tmp_path / "cut.rrd", tmp_path / "repaired.rrd"
    cut.write_bytes((ROOT / "recordings/demo-drive.rrd").read_bytes()[:300_000])
    with pytest.raises(RecordingError, match="again"):
        repair(cut, repaired)
    assert not repaired.exists()


def test_a_recording_cut_inside_the_name_of_a_message_is_still_one_recording(whole: Path, tmp_path: Path) -> None:
    data = whole.read_bytes()
    recording = Recording.open(whole)
    store = recording.meta.recording_id.encode()
    last = data.rindex(store)
    for end in (last - 1, last, last + 1, last + len(store) // 2, last + len(store), last + len(store) + 1):
        cut, repaired = tmp_path / "cut.rrd", tmp_path / f"{end}.rrd"
        cut.write_bytes(data[:end])
        assert repair(cut, repaired).frames == len(recording.frames)


def test_the_message_for_a_cut_file_names_the_repair(whole: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(whole.read_bytes()[:-200])
    with pytest.raises(RecordingError, match=r"ltvn repair .*cut\.rrd --output"):
        verify(cut)


def test_a_recording_is_repaired_while_it_is_written_and_goes_on_unharmed(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        for step in range(5):
            writer.write_frame(example_recording.observation(step))
        last = example_recording.observation(5)
        writer.draw_graph(TopologicalGraph(), 5, last.stamp)
        outputs = (tmp_path / f"{number}.rrd" for number in count())
        until(lambda: repair(path, next(outputs)).frames == 5)
        writer.write_frame(last)
    assert verify(path).frames == 6


def recording_for_ever(path: Path) -> "subprocess.Popen[str]":
    """Start a process that records until it is ended, and says each step and when it was written."""
    return subprocess.Popen(
        [sys.executable, "-c", RECORD_FOR_EVER, str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=ROOT,
    )


@pytest.mark.slow
def test_a_killed_recording_loses_at_most_half_a_second(tmp_path: Path) -> None:
    path, written = tmp_path / "killed.rrd", dict[int, float]()
    with recording_for_ever(path) as recorder:
        assert recorder.stdout is not None
        for line in recorder.stdout:
            if len(line.split()) == 2:
                written[int(line.split()[0])] = float(line.split()[1])
            if max(written.values()) - written[0] > 2.0 and recorder.poll() is None:
                recorder.kill()
    with pytest.raises(RecordingError, match="ltvn repair"):
        verify(path)
    saved = repair(path, tmp_path / "repaired.rrd")
    assert saved.last_step is not None
    assert max(written.values()) - written[saved.last_step] <= 0.5
    assert verify(tmp_path / "repaired.rrd").frames == saved.last_step + 1


@needs_posix
def test_an_interrupted_recording_is_finished(tmp_path: Path) -> None:
    path = tmp_path / "interrupted.rrd"
    with recording_for_ever(path) as recorder:
        assert recorder.stdout is not None
        for line in recorder.stdout:
            if line.split()[0] == "5":
                break
        recorder.send_signal(signal.SIGINT)
        last = [line.split()[0] for line in recorder.stdout if len(line.split()) == 2]
    assert verify(path).frames >= int(last[-1] if last else 5)


def test_repair_never_overwrites(whole: Path, tmp_path: Path) -> None:
    there = tmp_path / "there.rrd"
    there.write_bytes(b"mine")
    with pytest.raises(RecordingError, match="exists"):
        repair(whole, there)
    assert there.read_bytes() == b"mine"


@pytest.mark.parametrize("content", [b"", b"RRF2", b"a letter to somebody", bytes(5000)])
def test_a_file_that_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "strange.rrd"
    path.write_bytes(content)
    for look in (verify, read_info, Recording.open):
        with pytest.raises(RecordingError, match="strange"):
            look(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.rrd", tmp_path):
        with pytest.raises(RecordingError):
            verify(path)


def test_a_recording_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "foreign.rrd"
    foreign = rr.RecordingStream("somebody_else")
    foreign.save(path)
    foreign.log("thing", rr.TextLog("hello"))
    foreign.flush()
    foreign.disconnect()
    with pytest.raises(RecordingError, match=r"foreign\.rrd"):
        verify(path)


def test_a_recording_of_a_newer_schema_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "newer.rrd"
    with monkeypatch.context() as newer:
        newer.setattr(schema, "SCHEMA_VERSION", schema.SCHEMA_VERSION + 1)
        example_recording.write(path)
    with pytest.raises(RecordingError, match="schema"):
        verify(path)


def test_the_golden_recording_of_schema_1_still_opens() -> None:
    recording = Recording.open(GOLDEN_RECORDING)
    assert [stamped.event for stamped in recording.events] == example_recording.events()
    assert list(recording.frames) == list(range(10))
    verify(GOLDEN_RECORDING)


def test_a_full_disk_is_said_before_anything_is_recorded(tmp_path: Path) -> None:
    path = tmp_path / "full.rrd"
    with pytest.raises(RecordingError, match="full"):
        RecordingWriter(path, scene="demo", config={}, fingerprint="", min_free_bytes=1 << 62)
    assert not path.exists()


FILL_THE_DISK = """
import resource, sys, time
from pathlib import Path
from ltvn_core.errors import RecordingError
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.data.recording.writer import RecordingWriter
from tests.core.data.recording import example_recording
import signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))
path = Path(sys.argv[1])
writer = RecordingWriter(path, scene="demo", config={}, fingerprint="")
empty = path.stat().st_size
for step in range(30):
    writer.write_frame(example_recording.observation(step))
while path.stat().st_size < empty + 40_000:  # Until the disk has them.
    time.sleep(0.01)
told = 0
for step in range(30, 3000):
    try:
        writer.write_frame(example_recording.observation(step))
    except RecordingError as error:
        told += 1
        message = str(error)
try:
    writer.close()
except RecordingError as error:
    told += 1
    message = str(error)
print(told, message)
"""


@needs_posix
@pytest.mark.slow
def test_a_disk_that_fills_up_is_said_once_and_the_beginning_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "filled.rrd"
    run = subprocess.run(
        [sys.executable, "-c", FILL_THE_DISK, str(path)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert run.stdout.startswith("1 "), run.stdout + run.stderr
    assert "limit" in run.stdout
    saved = repair(path, tmp_path / "repaired.rrd")
    assert saved.frames >= 10
