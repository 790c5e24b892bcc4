"""Learning from the page: it disturbs nothing, changes nothing unasked, and says what came of it."""

import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.trajectory_pairs import TrajectoryPairs
from ltvn_core.errors import WeightsError
from ltvn_core.lessons.data import Tell
from ltvn_core.model.finetuning import FineTuningData
from ltvn_core.model.weights import read_card, weights_fingerprint
from ltvn_core.nav.events import Severity
from ltvn_core.types import STILL, Twist
from ltvn_core.verbs.finetune import FineTunedWeights
from ltvn_core.verbs.tuning import DriveAtHand, Lesson, Tuner
from ltvn_viz import commands as c
from ltvn_viz.keymap import FOR_EVERYBODY, Action
from ltvn_viz.learning import Learning, Tune
from ltvn_viz.learning_words import false_links_grew, result_lines
from ltvn_viz.modes import Mode
from ltvn_viz.snapshot import Phase
from tests.viz.lessons import PLAN, TUNER, drive, record_drive, show_drive, simulated, tiny_weights
from tests.viz.theatre import Inline, Theatre


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "recordings").mkdir()
    return tmp_path / "recordings"


@pytest.fixture
def executor() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


def school(folder: Path, tune: Tune | None = TUNER, executor: Executor | None = None) -> Theatre:
    """A theatre with a drive at hand and tiny weights to teach."""
    weights = tiny_weights(folder.parent)
    theatre = Theatre(folder, mapped=False, learning=Learning(tune, weights, executor or Inline()))
    show_drive(theatre)
    theatre.wait()
    return theatre


def figures(false_links: float, error_m: float = 0.07) -> dict[str, float]:
    return {
        f"{place}_{name}": value
        for place in ("own", "simulated")
        for name, value in (("far_pairs", 5000), ("far_fpr_at_half", false_links), ("position_median_m", error_m))
    }


def learned(
    before: dict[str, float], after: dict[str, float], weights: Path = Path("new.safetensors")
) -> FineTunedWeights:
    return FineTunedWeights(weights, "new", "old", 30, 1, 3, 0.1, before, after)


def school_with_an_offer(folder: Path) -> Theatre:
    """A theatre in which new weights wait to be used."""
    offer = learned(figures(0.004), figures(0.002), tiny_weights(folder.parent))
    theatre = school(folder, lambda *_: offer)
    assert theatre.do(c.Learn(3), ticks=2).learning.phase is Phase.LEARNED
    return theatre


class GatedSimulation:
    """Adds simulated data once the test lets it."""

    def __init__(self) -> None:
        self.entered, self.open = threading.Event(), threading.Event()

    def __call__(self, drive: TrajectoryPairs, tell: Tell) -> FineTuningData:
        tell(0.0, "drawing simulated rooms")
        self.entered.set()
        assert self.open.wait(30)
        return simulated(drive, tell)


def test_a_lesson_saves_weights_with_a_card_and_changes_nothing_else(folder: Path) -> None:
    theatre = school(folder)
    nodes, start = set(theatre.stage.mapping.graph.nodes), theatre.stage.learning.weights
    assert theatre.now.learning.drive.endswith("images of the map")
    now = theatre.do(c.Learn(3), ticks=2)
    assert now.learning.phase is Phase.LEARNED
    assert start is not None
    [weights] = folder.glob("*.safetensors")
    assert now.learning.path == str(weights)
    assert weights.name.startswith("images-at-hand-learned-")
    assert read_card(weights)["parent"] == weights_fingerprint(start)
    assert read_card(weights)["fingerprint"] == weights_fingerprint(weights) != weights_fingerprint(start)
    assert len(list(folder.iterdir())) == 2
    assert theatre.now.weights == "flat"
    assert set(theatre.stage.mapping.graph.nodes) == nodes


def test_new_weights_come_into_use_with_a_map_built_by_them(folder: Path) -> None:
    theatre = school(folder)
    theatre.do(c.Learn(3), ticks=2)
    weights = theatre.stage.learning.offer
    now = theatre.do(c.UseWeights(), ticks=3)
    assert now.mode is Mode.TELEOP
    assert now.weights == theatre.stage.mapping.fingerprint == weights_fingerprint(weights)
    assert now.learning.phase is Phase.IDLE
    assert now.message is not None
    assert str(weights) in now.message.text
    assert theatre.stage.mapping.graph.nodes
    assert now.moment.graph.ids.tolist() == list(theatre.stage.mapping.graph.nodes)
    theatre.do(c.Learn(3), ticks=2)
    assert read_card(theatre.stage.learning.offer)["parent"] == now.weights


def test_cancelling_the_rebuilding_keeps_map_weights_and_offer(folder: Path, executor: ThreadPoolExecutor) -> None:
    theatre = school_with_an_offer(folder)
    before = theatre.stage.mapping.graph
    theatre.stage.worker._executor = executor
    gate = threading.Event()
    executor.submit(gate.wait, 30)
    theatre.do(c.UseWeights())
    theatre.do(c.Cancel())
    gate.set()
    theatre.until(lambda now: now.mode is Mode.TELEOP)
    assert theatre.stage.mapping.graph is before
    assert theatre.now.weights == "flat"
    assert theatre.now.learning.phase is Phase.LEARNED


def test_the_kept_recording_is_what_one_learns_from(folder: Path) -> None:
    lessons: list[Lesson] = []
    theatre = school(folder, lambda lesson, *_: lessons.append(lesson))
    theatre.stage.kept = record_drive(folder / "drive.rrd").name
    assert theatre.wait().learning.drive == "drive.rrd"
    theatre.do(c.Learn(5), ticks=2)
    [lesson] = lessons
    assert (lesson.drive.images, lesson.minutes) == (folder / "drive.rrd", 5)
    assert lesson.output.name.startswith("drive-learned-")
    assert len(lesson.drive.label(horizon=15).poses) > 40


def test_a_person_drives_and_stops_while_the_network_learns(folder: Path, executor: ThreadPoolExecutor) -> None:
    gate = GatedSimulation()
    theatre = school(folder, Tuner(PLAN, gate), executor)
    theatre.do(c.Learn(3))
    assert gate.entered.wait(30)
    theatre.driver.twist = Twist(0.4, 0.0)
    before = theatre.robot.pose.copy()
    now = theatre.wait(30)
    assert now.learning.phase is Phase.LEARNING
    assert "drawing simulated rooms" in now.learning.doing
    assert not np.array_equal(theatre.robot.pose, before)
    theatre.driver.twist = None
    theatre.do(c.Stop())
    assert theatre.robot.twist == STILL
    theatre.do(c.StartRecording(), ticks=2)
    theatre.do(c.KeepRecording())
    gate.open.set()
    theatre.session.close()


def test_a_lesson_that_is_stopped_leaves_nothing(folder: Path, executor: ThreadPoolExecutor) -> None:
    gate = GatedSimulation()
    theatre = school(folder, Tuner(PLAN, gate), executor)
    theatre.do(c.Learn(3))
    assert gate.entered.wait(30)
    assert theatre.do(c.StopLearning()).learning.doing == "stopping"
    gate.open.set()
    now = theatre.until(lambda now: now.learning.phase is not Phase.LEARNING, ticks=10**6)
    assert now.learning.phase is Phase.IDLE
    assert now.learning.lines == ("Stopped; the network is as it was.",)
    assert list(folder.iterdir()) == []


def test_a_second_lesson_waits_for_the_first(folder: Path, executor: ThreadPoolExecutor) -> None:
    gate = GatedSimulation()
    theatre = school(folder, Tuner(PLAN, gate), executor)
    now = theatre.do(c.Learn(3), c.Learn(3))
    assert now.message is not None
    assert "learning already" in now.message.text
    gate.open.set()
    theatre.session.close()


def test_a_drive_that_teaches_nothing_is_one_clear_line_and_no_alarm(folder: Path) -> None:
    theatre = school(folder)
    theatre.stage.kept = record_drive(folder / "short.rrd", images=6).name
    now = theatre.do(c.Learn(3), ticks=2)
    assert now.learning.phase is Phase.FAILED
    assert "short.rrd: holds 6 images; fine-tuning needs 20" in now.learning.lines[0]
    assert now.message is None
    assert [path.name for path in folder.iterdir()] == ["short.rrd"]


def test_without_odometry_one_learns_nothing_and_reads_why(folder: Path) -> None:
    theatre = school(folder)
    theatre.stage.mapping.views.keep_only([])
    theatre.stage.mapping.views.add([replace(seen, odometry=np.zeros(3)) for seen in drive()])
    now = theatre.do(c.Learn(3), ticks=2)
    assert "the same for all of them" in now.learning.lines[0]


def test_the_oracle_cannot_be_taught(folder: Path) -> None:
    now = school(folder, None).do(c.Learn(3))
    assert now.message is not None
    assert (now.message.severity, "without --predictor oracle" in now.message.text) == (Severity.ERROR, True)
    assert now.learning.phase is Phase.IDLE


def test_a_folder_that_cannot_hold_weights_is_found_out_before_learning(folder: Path) -> None:
    lesson = Lesson(DriveAtHand("images", drive()), tiny_weights(folder), folder / "gone" / "new.safetensors", 3)
    told: list[str] = []
    with pytest.raises(WeightsError, match=r"Learning ended without a result .* free some space"):
        TUNER(lesson, lambda _share, doing: told.append(doing), threading.Event())
    assert told == ["reading and labelling the drive"]


def test_progress_runs_from_reading_to_the_last_judgement_and_never_back(folder: Path) -> None:
    told: list[tuple[float, str]] = []
    lesson = Lesson(DriveAtHand("images", drive()), tiny_weights(folder), folder / "new.safetensors", 3)
    assert TUNER(lesson, lambda *each: told.append(each), threading.Event()) is not None
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert 0 <= shares[0] < shares[-1] <= 1
    assert [told[0][1], told[-1][1]] == ["reading and labelling the drive", "judging the weights after"]
    assert {"looking at boxes", "learning"} <= {doing for _, doing in told}


def test_weights_that_see_more_false_links_are_kept_but_not_offered(folder: Path) -> None:
    worse = learned(figures(0.002), figures(0.004))
    theatre = school(folder, lambda *_: worse)
    now = theatre.do(c.Learn(3), ticks=2)
    assert (now.learning.phase, now.learning.path) == (Phase.WORSE, "new.safetensors")
    now = theatre.do(c.UseWeights())
    assert now.message is not None
    assert "no new weights" in now.message.text
    assert now.weights == "flat"


def test_false_links_within_chance_are_no_more_than_before() -> None:
    assert not false_links_grew(learned(figures(0.0), figures(0.0004)))
    assert not false_links_grew(learned(figures(float("nan")), figures(float("nan"))))
    assert not false_links_grew(learned({}, {}))
    assert false_links_grew(learned(figures(0.0), figures(0.001)))


def test_the_result_is_two_plain_lines() -> None:
    here, simulation = result_lines(learned(figures(0.004, 0.0738), figures(0.002, 0.0689)))
    assert here == "Here: false links 0.40 → 0.20 %, waypoint error 7.4 → 6.9 cm."
    assert simulation.startswith("Simulated: false links")
    assert "nothing to judge by" in result_lines(learned({}, {}))[0]


def test_weights_are_not_exchanged_within_a_recording(folder: Path) -> None:
    theatre = school_with_an_offer(folder)
    theatre.do(c.StartRecording(), ticks=2)
    now = theatre.do(c.UseWeights())
    assert now.message is not None
    assert "Keep this recording" in now.message.text
    assert now.weights == "flat"


@pytest.mark.parametrize("minutes", [0, 61])
def test_a_time_without_sense_is_refused(folder: Path, minutes: int) -> None:
    now = school(folder).do(c.Learn(minutes))
    assert now.message is not None
    assert "1 to 60 minutes" in now.message.text


def test_names_of_weights_are_never_taken_twice(folder: Path) -> None:
    library, now = school(folder).library, datetime(2030, 1, 2)
    first = library.new_weights("drive.rrd", now)
    first.touch()
    assert library.new_weights("drive.rrd", now) != first
    assert first.name not in library.names()


def test_learning_belongs_to_whoever_drives() -> None:
    assert not FOR_EVERYBODY & {Action.LEARN, Action.STOP_LEARNING, Action.USE_WEIGHTS, Action.LEAVE_WEIGHTS}
