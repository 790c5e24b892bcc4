"""A failed episode is shown from shortly before the moment at which it went wrong."""

from pathlib import Path

import pytest

from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.evaluation.reports.evaluation_files import BEFORE_S, moment_s
from ltvn_core.navigation.events import (
    AttemptEnd,
    AttemptEnded,
    Collided,
    Event,
    Outcome,
    QueryEnded,
    QueryStarted,
    StampedEvent,
)
from ltvn_core.types import CONTROL_STEP_S
from tests.core.data.recording.example_recording import observation

FIRST = 400
"""Control step at which driving begins."""


def a_leg(*, succeeded: bool) -> AttemptEnded:
    end = AttemptEnd.REACHED if succeeded else AttemptEnd.TIMEOUT
    return AttemptEnded(0, 1, 0, 4, FIRST, end, 0.5, 0.5, succeeded, "made up")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A query of half a minute: a wrong turn after 10 s, a collision after 20 s, the end after 30 s."""
    story: dict[int, Event] = {
        0: QueryStarted(0, 8),
        100: a_leg(succeeded=False),
        150: a_leg(succeeded=True),
        200: Collided(0, 1),
        300: QueryEnded(0, 8, Outcome.ARRIVED, 300, 1, 4.0),
    }
    path = tmp_path / "failure.rrd"
    with RecordingWriter(path, scene="somewhere", config={}, fingerprint="flat") as writer:
        for step, event in story.items():
            writer.write_frame(observation(FIRST + step))
            writer.write_event(StampedEvent(FIRST + step, (FIRST + step) * CONTROL_STEP_S, event))
    return path


@pytest.mark.parametrize(
    ("failure", "when_s"),
    [
        (FailureCause.SPURIOUS_EDGE, 10.0),
        (FailureCause.MISLOCALISED, 10.0),
        (FailureCause.COLLISION, 20.0),
        (FailureCause.WRONG_ARRIVAL, 30.0),
        (FailureCause.NO_PATH, 30.0),
        (None, 30.0),
    ],
)
def test_the_moment_depends_on_the_cause(recording: Path, failure: FailureCause | None, when_s: float) -> None:
    assert moment_s(recording, failure) == pytest.approx(when_s - BEFORE_S)


def test_without_a_readable_recording_there_is_no_moment(tmp_path: Path) -> None:
    (tmp_path / "cut.rrd").write_bytes(b"RRF2")
    assert moment_s(tmp_path / "cut.rrd", FailureCause.COLLISION) is None
    assert moment_s(tmp_path / "gone.rrd", FailureCause.COLLISION) is None
