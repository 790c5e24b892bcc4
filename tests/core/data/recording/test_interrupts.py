"""A signal that comes while a frame is being written."""

import signal
from pathlib import Path

import pytest

from ltvn_core.data.recording.durable_stream import interrupts_deferred
from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.writer import RecordingWriter
from tests.core.data.recording import example_recording


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]
)
def test_it_is_raised_behind_the_block_and_the_handler_stands_again(number: signal.Signals) -> None:
    reached = []

    def end(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(number, end)
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_deferred():  # noqa: PT012
            signal.raise_signal(number)
            reached.append("the end of the block")
        assert reached
        assert signal.getsignal(number) is end
    finally:
        signal.signal(number, before)


def test_a_frame_that_is_being_written_is_whole_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
            writer.write_frame(example_recording.observation(0))
            with pytest.raises(KeyboardInterrupt), writer._stream.together():  # noqa: PT012
                signal.raise_signal(signal.SIGINT)
                writer.write_frame(example_recording.observation(1))
    finally:
        signal.signal(signal.SIGINT, before)
    assert verify(path).frames == 2
