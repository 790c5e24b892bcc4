"""What a person may ask when, and what becomes of it; without a browser."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.nav.events import Outcome, Severity
from ltvn_core.types import STILL, Twist
from ltvn_viz import commands as c
from ltvn_viz.modes import LEGAL, Mode, refusal
from tests.viz.theatre import Theatre

FORWARD = Twist(0.4, 0.0)


@pytest.fixture
def theatre(tmp_path: Path) -> Theatre:
    theatre = Theatre(tmp_path)
    theatre.wait()
    return theatre


def a_far_node(theatre: Theatre) -> int:
    graph = theatre.now.moment.graph
    away = np.hypot(*(graph.poses[:, :2] - theatre.robot.pose[:2]).T)
    return int(graph.ids[np.argmax(away)])


def test_a_node_is_reached_and_the_verdict_is_shown(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(a_far_node(theatre)))
    assert theatre.session.mode is Mode.NAVIGATING
    shown = theatre.until(lambda now: now.mode is Mode.TELEOP)
    assert shown.moment.progress.ended is not None
    assert shown.moment.progress.ended.outcome is Outcome.ARRIVED
    assert shown.moment.progress.judged is not None
    assert shown.moment.progress.judged.reached


def test_driving_keys_take_the_robot_over_from_navigation(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(a_far_node(theatre)), ticks=20)
    theatre.driver.twist = FORWARD
    shown = theatre.until(lambda now: now.mode is Mode.TELEOP, ticks=10)
    assert shown.moment.progress.ended is not None
    assert shown.moment.progress.ended.outcome is Outcome.CANCELLED
    assert shown.message is not None
    assert "took over" in shown.message.text
    theatre.wait()
    assert theatre.robot.twist == FORWARD


def test_letting_go_stops_the_robot_at_once(theatre: Theatre) -> None:
    theatre.driver.twist = FORWARD
    theatre.wait(5)
    assert theatre.robot.twist == FORWARD
    theatre.driver.twist = None
    theatre.wait()
    assert theatre.robot.twist == STILL


def test_stop_ends_a_navigation_task(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(a_far_node(theatre)), ticks=20)
    theatre.do(c.Stop(), ticks=3)
    assert theatre.session.mode is Mode.TELEOP
    assert theatre.robot.twist == STILL


def test_a_paused_robot_stands_until_it_is_told_to_go_on(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(a_far_node(theatre)), ticks=10)
    theatre.do(c.Pause(), ticks=10)
    assert theatre.now.mode is Mode.PAUSED
    where = theatre.robot.pose.copy()
    theatre.wait(30)
    np.testing.assert_array_equal(theatre.robot.pose, where)
    theatre.do(c.Pause())
    theatre.until(lambda now: now.mode is Mode.TELEOP)
    assert not np.array_equal(theatre.robot.pose, where)


def test_a_step_is_one_control_step_and_then_a_pause(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(a_far_node(theatre)), ticks=10)
    theatre.do(c.Pause(), ticks=10)
    before = theatre.robot.step
    theatre.do(c.StepOnce(), ticks=30)
    assert theatre.now.mode is Mode.PAUSED
    assert theatre.robot.step == before + 1


def test_cancelling_a_paused_task_ends_it(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(a_far_node(theatre)), ticks=10)
    theatre.do(c.Pause(), ticks=10)
    shown = theatre.do(c.Cancel(), ticks=5)
    assert shown.mode is Mode.TELEOP
    assert shown.moment.progress.query is None


def test_picking_a_node_goes_there_when_idle_and_only_chooses_it_on_the_way(theatre: Theatre) -> None:
    first, second = a_far_node(theatre), int(theatre.now.moment.graph.ids[0])
    theatre.do(c.Pick(first))
    shown = theatre.do(c.Pick(second))
    assert shown.mode is Mode.NAVIGATING
    assert shown.moment.progress.goal == first
    assert shown.selected == second


def test_an_illegal_command_is_refused_with_the_legal_ones_named(theatre: Theatre) -> None:
    shown = theatre.do(c.Pause())
    assert shown.message is not None
    assert shown.message.severity is Severity.WARN
    assert "pause" in shown.message.text
    assert "record" in shown.message.text


@pytest.mark.parametrize("mode", Mode)
def test_every_mode_has_a_way_on(mode: Mode) -> None:
    assert any(mode in modes for kind, modes in LEGAL.items() if kind not in (c.Stop, c.Report))


def test_every_command_has_a_place_in_the_table() -> None:
    assert {kind.__name__ for kind in c.Command.__subclasses__()} == {kind.__name__ for kind in LEGAL}


def test_a_goal_outside_the_map_is_a_clear_error(theatre: Theatre) -> None:
    shown = theatre.do(c.NavigateTo(99_999))
    assert shown.mode is Mode.TELEOP
    assert shown.message is not None
    assert "99999" in shown.message.text


def test_navigating_without_a_goal_says_how_to_choose_one(theatre: Theatre) -> None:
    shown = theatre.do(c.NavigateTo())
    assert shown.message is not None
    assert "Choose a goal" in shown.message.text


def test_a_failing_robot_is_stopped_and_the_page_says_so(theatre: Theatre, caplog: pytest.LogCaptureFixture) -> None:
    theatre.do(c.NavigateTo(a_far_node(theatre)), ticks=10)
    theatre.do(c.StartRecording(), ticks=5)
    stops = theatre.robot.stops
    theatre.robot.broken = RuntimeError("wheel fell off")
    theatre.wait(5)
    theatre.robot.broken = None
    shown = theatre.wait()
    assert theatre.robot.stops > stops
    assert shown.mode is Mode.TELEOP
    assert shown.message is not None
    assert "wheel fell off" in shown.message.text
    assert shown.recording.name is not None
    assert "the session failed" in caplog.text


def test_hammering_all_commands_breaks_nothing(theatre: Theatre) -> None:
    rng = np.random.default_rng(3)
    nodes = theatre.now.moment.graph.ids
    for _ in range(60):
        made = [
            c.NavigateTo(int(rng.choice(nodes))),
            c.Pick(int(rng.choice(nodes))),
            c.Select(int(rng.choice(nodes))),
            c.NavigateToPicture(np.zeros((72, 96, 3), np.uint8)),
            c.OpenRecording("nothing.rrd"),
            c.Seek(1.0),
            c.SeekBy(-1.0),
            c.Report("broken upload"),
            *(kind() for kind in (c.Stop, c.Pause, c.StepOnce, c.Cancel, c.TakeOver, c.BuildMap, c.CloseRecording)),
            *(kind() for kind in (c.StartRecording, c.KeepRecording, c.DiscardRecording)),
        ]
        theatre.driver.twist = FORWARD if rng.random() < 0.1 else None
        picked = rng.choice(len(made), size=3)
        shown = theatre.do(*(made[k] for k in picked), ticks=int(rng.integers(1, 4)))
        assert shown.message is None or "went wrong" not in shown.message.text
    theatre.driver.twist = None
    theatre.do(c.Stop(), c.CloseRecording(), ticks=5)
    assert theatre.session.mode is Mode.TELEOP


def test_a_flood_of_commands_is_bounded(theatre: Theatre, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(10_000):
        theatre.session.send(c.Stop())
    assert "too many commands" in caplog.text
    theatre.wait()
    assert theatre.session.mode is Mode.TELEOP


def test_the_refusal_of_a_command_names_its_modes() -> None:
    text = refusal(c.Pause(), Mode.BUILDING)
    assert text is not None
    assert "navigating" in text


def test_the_session_runs_in_real_time_until_told_to_stop(theatre: Theatre) -> None:
    theatre.session.run(max_ticks=3)
    assert len(theatre.shown) >= 4
    assert theatre.robot.twist == STILL
