"""Learning from the page: it disturbs nothing, changes nothing unasked, and says what came of it."""

import threading
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import WeightsError
from ltvn_core.navigation.events import Severity
from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData
from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule, TrajectoryPairs
from ltvn_core.network.weights_file import read_card, weights_fingerprint
from ltvn_core.training.fine_tuning import FineTunedWeights
from ltvn_core.training.fine_tuning_data import DriveSource, ProgressReporter
from ltvn_core.types import ZERO_TWIST, Twist
from ltvn_viz.session import fine_tuning as tuning
from ltvn_viz.session.fine_tuner import FineTuner, FineTuningRequest
from ltvn_viz.session.snapshot import FineTuningPhase
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.session_harness import InlineExecutor, SessionHarness, said
from tests.viz.tiny_fine_tuning import PLAN, TUNER, TinyRehearsal, drive, record_drive, show_drive, tiny_weights
from tests.waiting import PATIENCE_S


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "recordings").mkdir()
    return tmp_path / "recordings"


def fine_tuning_harness(
    folder: Path, tune: tuning.Tune | None = TUNER, executor: Executor | None = None
) -> SessionHarness:
    """A session with a drive at hand and tiny weights to fine-tune."""
    weights = tiny_weights(folder.parent)
    harness = SessionHarness(
        folder, mapped=False, fine_tuning=tuning.FineTuning(tune, weights, executor or InlineExecutor())
    )
    show_drive(harness)
    harness.wait()
    return harness


def drive_metrics(far_fpr: float, error_m: float = 0.07) -> dict[str, float]:
    return {
        f"{place}_{name}": value
        for place in ("own", "simulated")
        for name, value in (("far_pairs", 5000), ("far_fpr_at_half", far_fpr), ("position_median_m", error_m))
    }


def learned(
    before: dict[str, float], after: dict[str, float], weights: Path = Path("new.safetensors")
) -> FineTunedWeights:
    return FineTunedWeights(weights, "new", "old", 30, 1, 3, 0.1, before, after)


def harness_with_new_weights(folder: Path) -> SessionHarness:
    """A session in which new weights wait to be used."""
    offer = learned(drive_metrics(0.004), drive_metrics(0.002), tiny_weights(folder.parent))
    harness = fine_tuning_harness(folder, lambda *_: offer)
    assert harness.do(c.Ask(c.Action.LEARN, 3), ticks=2).fine_tuning.phase is FineTuningPhase.LEARNED
    return harness


@dataclass(frozen=True)
class GatedSimulation(TinyRehearsal):
    """Adds simulated data once the test lets it."""

    entered: threading.Event = field(default_factory=threading.Event)
    open: threading.Event = field(default_factory=threading.Event)

    def load(
        self, drive: TrajectoryPairs, on_progress: ProgressReporter, *, with_validation_drives: bool
    ) -> FineTuningData:
        on_progress(0.0, "drawing simulated rooms")
        self.entered.set()
        assert self.open.wait(PATIENCE_S)
        return super().load(drive, on_progress, with_validation_drives=with_validation_drives)


@pytest.mark.slow
def test_a_fine_tuning_saves_weights_with_a_card_that_come_into_use_with_a_map_built_by_them(folder: Path) -> None:
    told: list[tuple[float, str]] = []

    def tune(
        request: FineTuningRequest, on_progress: ProgressReporter, stop: threading.Event
    ) -> FineTunedWeights | None:
        def hear(share: float, doing: str) -> None:
            told.append((share, doing))
            on_progress(share, doing)

        return TUNER(request, hear, stop)

    harness = fine_tuning_harness(folder, tune)
    nodes, start = set(harness.state.live_map.graph.nodes), harness.state.fine_tuning.weights
    assert harness.now.fine_tuning.drive.endswith("images of the map")
    now = harness.do(c.Ask(c.Action.LEARN, 3), ticks=2)
    assert now.fine_tuning.phase is FineTuningPhase.LEARNED
    assert start is not None
    [weights] = folder.glob("*.safetensors")
    assert now.fine_tuning.path == str(weights) == str(harness.state.fine_tuning.offer)
    assert now.fine_tuning.besides_s is not None  # All parts of the lesson were heard and measured.
    assert weights.name.startswith("images-at-hand-learned-")
    assert read_card(weights)["parent"] == weights_fingerprint(start)
    assert read_card(weights)["fingerprint"] == weights_fingerprint(weights) != weights_fingerprint(start)
    assert len(list(folder.iterdir())) == 2
    assert harness.now.weights == "flat"
    assert set(harness.state.live_map.graph.nodes) == nodes
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert 0 <= shares[0] < shares[-1] <= 1
    assert [told[0][1], told[-1][1]] == ["reading and labelling the drive", "judging the weights after"]
    assert {"looking at boxes", "learning"} <= {doing for _, doing in told}
    now = harness.do(c.Ask(c.Action.USE_WEIGHTS), ticks=3)
    assert now.mode is Mode.TELEOP
    assert now.weights == harness.state.live_map.fingerprint == weights_fingerprint(weights)
    assert now.fine_tuning.phase is FineTuningPhase.IDLE
    assert str(weights) in said(now)
    assert harness.state.live_map.graph.nodes
    assert now.moment.graph.ids.tolist() == list(harness.state.live_map.graph.nodes)
    assert harness.state.fine_tuning.weights == weights  # The next lesson goes on from these.


def test_cancelling_the_rebuilding_keeps_map_weights_and_offer(folder: Path, executor: ThreadPoolExecutor) -> None:
    harness = harness_with_new_weights(folder)
    before = harness.state.live_map.graph
    harness.state.worker._executor = executor
    gate = threading.Event()
    executor.submit(gate.wait, PATIENCE_S)
    harness.do(c.Ask(c.Action.USE_WEIGHTS))
    harness.do(c.Ask(c.Action.CANCEL))
    gate.set()
    harness.until(lambda now: now.mode is Mode.TELEOP)
    assert harness.state.live_map.graph is before
    assert harness.now.weights == "flat"
    assert harness.now.fine_tuning.phase is FineTuningPhase.LEARNED


def test_the_kept_recording_is_what_one_learns_from(folder: Path) -> None:
    requests: list[FineTuningRequest] = []
    harness = fine_tuning_harness(folder, lambda request, *_: requests.append(request))
    harness.state.last_recording = record_drive(folder / "drive.rrd").name
    assert harness.wait().fine_tuning.drive == "drive.rrd"
    harness.do(c.Ask(c.Action.LEARN, 5), ticks=2)
    [request] = requests
    assert (request.drive.source, request.minutes) == (folder / "drive.rrd", 5)
    assert request.output.name.startswith("drive-learned-")
    assert len(request.drive.label(OdometryLabelRule()).poses) > 40


@pytest.mark.slow
def test_a_person_drives_and_stops_while_the_network_learns(folder: Path, executor: ThreadPoolExecutor) -> None:
    gate = GatedSimulation()
    harness = fine_tuning_harness(folder, FineTuner(plan=PLAN, rehearsal=gate), executor)
    harness.do(c.Ask(c.Action.LEARN, 3))
    assert gate.entered.wait(PATIENCE_S)
    harness.driver.twist = Twist(0.4, 0.0)
    before = harness.robot.pose.copy()
    now = harness.wait(30)
    assert now.fine_tuning.phase is FineTuningPhase.LEARNING
    assert "drawing simulated rooms" in now.fine_tuning.doing
    assert not np.array_equal(harness.robot.pose, before)
    harness.driver.twist = None
    harness.do(c.Ask(c.Action.STOP))
    assert harness.robot.twist == ZERO_TWIST
    harness.do(c.Ask(c.Action.RECORD), ticks=2)
    harness.do(c.Ask(c.Action.KEEP))
    gate.open.set()
    harness.session.close()


def test_a_fine_tuning_that_is_stopped_leaves_nothing(folder: Path, executor: ThreadPoolExecutor) -> None:
    gate = GatedSimulation()
    harness = fine_tuning_harness(folder, FineTuner(plan=PLAN, rehearsal=gate), executor)
    harness.do(c.Ask(c.Action.LEARN, 3))
    assert gate.entered.wait(PATIENCE_S)
    assert harness.do(c.Ask(c.Action.STOP_LEARNING)).fine_tuning.doing == "stopping"
    gate.open.set()
    now = harness.until(lambda now: now.fine_tuning.phase is not FineTuningPhase.LEARNING)
    assert now.fine_tuning.phase is FineTuningPhase.IDLE
    assert now.fine_tuning.lines == ("Stopped; the network is as it was.",)
    assert list(folder.iterdir()) == []


@pytest.mark.slow
def test_a_second_fine_tuning_waits_for_the_first(folder: Path, executor: ThreadPoolExecutor) -> None:
    gate = GatedSimulation()
    harness = fine_tuning_harness(folder, FineTuner(plan=PLAN, rehearsal=gate), executor)
    now = harness.do(c.Ask(c.Action.LEARN, 3), c.Ask(c.Action.LEAVE_WEIGHTS), c.Ask(c.Action.LEARN, 3))
    assert "learning already" in said(now)
    gate.open.set()
    harness.session.close()


def test_a_drive_that_teaches_nothing_is_one_clear_line_and_no_alarm(folder: Path) -> None:
    harness = fine_tuning_harness(folder)
    harness.state.last_recording = record_drive(folder / "short.rrd", images=6).name
    now = harness.do(c.Ask(c.Action.LEARN, 3), ticks=2)
    assert now.fine_tuning.phase is FineTuningPhase.FAILED
    assert "short.rrd: holds 6 images; fine-tuning needs 20" in now.fine_tuning.lines[0]
    assert now.message is None
    assert [path.name for path in folder.iterdir()] == ["short.rrd"]


def test_the_oracle_cannot_be_taught(folder: Path) -> None:
    now = fine_tuning_harness(folder, None).do(c.Ask(c.Action.LEARN, 3))
    assert now.message is not None
    assert (now.message.severity, "--predictor network" in now.message.text) == (Severity.WARN, True)
    assert now.fine_tuning.phase is FineTuningPhase.IDLE


def test_a_folder_that_cannot_hold_weights_is_found_out_before_learning(folder: Path) -> None:
    request = FineTuningRequest(
        DriveSource("images", drive()), tiny_weights(folder), folder / "gone" / "new.safetensors", 3
    )
    told: list[str] = []
    with pytest.raises(WeightsError, match=r"Training ended without a result .* free some space"):
        TUNER(request, lambda _share, doing: told.append(doing), threading.Event())
    assert told == ["reading and labelling the drive"]


def test_weights_that_see_more_far_false_positives_are_kept_but_not_offered(folder: Path) -> None:
    worse = learned(drive_metrics(0.002), drive_metrics(0.004))
    harness = fine_tuning_harness(folder, lambda *_: worse)
    now = harness.do(c.Ask(c.Action.LEARN, 3), ticks=2)
    assert (now.fine_tuning.phase, now.fine_tuning.path) == (FineTuningPhase.WORSE, "new.safetensors")
    now = harness.do(c.Ask(c.Action.USE_WEIGHTS))
    assert "no new weights" in said(now)
    assert now.weights == "flat"


def test_far_false_positives_within_chance_are_no_more_than_before() -> None:
    assert not tuning.far_false_positives_grew(learned(drive_metrics(0.0), drive_metrics(0.0004)))
    assert not tuning.far_false_positives_grew(learned(drive_metrics(float("nan")), drive_metrics(float("nan"))))
    assert not tuning.far_false_positives_grew(learned({}, {}))
    assert tuning.far_false_positives_grew(learned(drive_metrics(0.0), drive_metrics(0.001)))


def test_the_result_is_two_plain_lines() -> None:
    here, simulation = tuning.result_lines(learned(drive_metrics(0.004, 0.0738), drive_metrics(0.002, 0.0689)))
    assert here == "Here: false links 0.40 → 0.20 %, waypoint error 7.4 → 6.9 cm."
    assert simulation.startswith("Simulated: false links")
    assert "nothing to evaluate" in tuning.result_lines(learned({}, {}))[0]


def test_weights_are_not_exchanged_within_a_recording(folder: Path) -> None:
    harness = harness_with_new_weights(folder)
    harness.do(c.Ask(c.Action.RECORD), ticks=2)
    now = harness.do(c.Ask(c.Action.USE_WEIGHTS))
    assert "Keep this recording" in said(now)
    assert now.weights == "flat"


def test_names_of_weights_are_never_taken_twice(folder: Path) -> None:
    library, now = fine_tuning_harness(folder).library, datetime(2030, 1, 2)
    first = library.new_weights("drive.rrd", now)
    first.touch()
    assert library.new_weights("drive.rrd", now) != first
    assert first.name not in library.names()


class Clock:
    """A clock that stands until it is told."""

    def __init__(self) -> None:
        self.now = 50.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_one_minute_of_learning_on_a_slow_computer_is_said_to_take_what_it_takes(clock: Clock) -> None:
    lesson = tuning.LearningTime(1, clock)
    said = [lesson.left]
    for doing, seconds in (
        ("drawing simulated rooms", 90),
        (tuning.JUDGING, 150),
        (tuning.LEARNING, 60),
        (tuning.CALIBRATING, 170),
    ):
        lesson.hear(doing)
        said.append(lesson.left)
        clock.now += seconds
    assert said == [
        "more than 1 min left",
        "more than 1 min left",
        "more than 1 min left",
        "about 4 to 6 min left",
        "about 3 to 5 min left",
    ]
    assert lesson.left == "about 3 min left"
    assert lesson.besides_s == 410
    assert "took 7 min more" in tuning.besides_words(lesson.besides_s)


def test_a_lesson_that_was_stopped_while_it_learned_says_nothing_of_the_whole(clock: Clock) -> None:
    lesson = tuning.LearningTime(3, clock)
    lesson.hear(tuning.LEARNING)
    clock.now += 60
    assert lesson.left == "about 2 min left"
    assert lesson.besides_s is None
    assert "after the first run" in tuning.besides_words(lesson.besides_s)
