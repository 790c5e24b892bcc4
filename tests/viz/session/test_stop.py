"""Every way to stop ends whatever gives the robot its steps, so that it stays until somebody asks for a new goal."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ltvn_core.evaluation.door_story.story_map import WRONG_EDGE
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.types import Twist
from ltvn_viz.session.options import AppOptions
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.app_session import AppSession
from tests.viz.session_harness import InlineExecutor, SessionHarness
from tests.viz.two_floors import add_lift, nearest, open_two_rooms

TICKS = 60
FORWARD = Twist(0.4, 0.0)


class HeldExecutor(InlineExecutor):
    """Does its jobs at once, or when it is let go."""

    def __init__(self) -> None:
        self.is_held = False
        self._waiting: list[Callable[[], object]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        if not self.is_held:
            return super().submit(fn, *args, **kwargs)
        later: Future[Any] = Future()
        self._waiting.append(lambda: later.set_result(fn(*args, **kwargs)))
        return later

    def let_go(self) -> None:
        self.is_held = False
        for job in self._waiting:
            job()


def by_hand(harness: SessionHarness) -> None:
    harness.driver.twist = FORWARD
    harness.wait()
    harness.driver.twist = None


WAYS = {
    "stop": lambda harness: harness.do(c.Ask(c.Action.STOP)),
    "cancel": lambda harness: harness.do(c.Ask(c.Action.CANCEL)),
    "driving keys": by_hand,
}


def query(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.GOAL, harness.far_node), ticks=20)


def paused_query(harness: SessionHarness) -> None:
    query(harness)
    harness.do(c.Ask(c.Action.PAUSE), ticks=10)
    assert harness.now.mode is Mode.PAUSED


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("begin", [query, paused_query])
def test_a_query_is_over(harness: SessionHarness, begin: Callable[[SessionHarness], None], way: str) -> None:
    begin(harness)
    WAYS[way](harness)
    stays(harness)


@pytest.mark.parametrize("way", WAYS)
def test_an_image_whose_place_is_still_looked_for_sends_the_robot_nowhere(tmp_path: Path, way: str) -> None:
    executor = HeldExecutor()
    harness = SessionHarness(tmp_path, executor=executor)
    harness.wait()
    image = harness.state.live_map.keyframes.observation(harness.far_node).rgb
    executor.is_held = True
    harness.do(c.NavigateToImage(image))
    WAYS[way](harness)
    executor.let_go()
    stays(harness)
    assert harness.state.queries == 0
    assert harness.now.upload is not None, "its places are still offered"


def test_an_image_sends_the_robot_where_nobody_stops_it(harness: SessionHarness) -> None:
    harness.do(c.NavigateToImage(harness.state.live_map.keyframes.observation(harness.far_node).rgb), ticks=2)
    assert harness.state.queries == 1


def test_an_answer_about_an_action_does_not_move_the_robot_in_a_later_query(tmp_path: Path) -> None:
    harness = open_two_rooms(tmp_path)
    harness.do(add_lift(harness))
    harness.do(c.Ask(c.Action.GOAL, nearest(harness, 5.0, 3.0)))
    harness.until(lambda _: harness.state.actions.state() is ActionState.PENDING)
    harness.do(c.Ask(c.Action.END_ACTION, 1), c.Ask(c.Action.STOP), ticks=3)
    assert harness.session.state.activity.mode is Mode.TELEOP
    harness.do(c.Ask(c.Action.GOAL, nearest(harness, 1.0, 1.0)))
    carried: list[int] = []
    harness.state.actions.settle(carried.append)
    assert carried == []


def test_an_error_of_the_app_ends_the_query_for_good(harness: SessionHarness) -> None:
    query(harness)
    harness.state.fail("the app has a fault")
    stays(harness)


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppSession]:
    """The shipped map, in which the story plays."""
    pytest.importorskip("embreex")
    with ExitStack() as stack:
        yield AppSession(stack, AppOptions(recordings=tmp_path_factory.mktemp("demo")))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "is_driving"),
    [
        (c.Ask(c.Action.STOP), False),
        (c.Ask(c.Action.STOP), True),
        (c.Ask(c.Action.CANCEL), False),
        (c.Ask(c.Action.TAKE_OVER), True),
    ],
)
def test_the_story_is_over_and_leaves_the_door_open_and_begins_anew(
    demo: AppSession, way: c.Command, is_driving: bool
) -> None:
    state, system = demo.state, demo.state.live_map.system
    demo.do(c.Ask(c.Action.WATCH_IT_LEARN))
    story = state.story
    assert story is not None
    assert not story.is_over
    if is_driving:
        demo.until(lambda _: demo.session.state.activity.mode is Mode.NAVIGATING)
    else:
        demo.until(lambda _: story.captions)
        assert demo.session.state.activity.mode is Mode.TELEOP
    demo.do(way)
    assert story.is_over
    demo.until(lambda _: state.live_map.system is system)
    where, queries = state.live.robot.drawn_pose.copy(), state.queries
    for _ in range(TICKS):
        demo.do()
    np.testing.assert_allclose(state.live.robot.drawn_pose, where, atol=1e-3)
    assert (demo.session.state.activity.mode, state.queries) == (Mode.TELEOP, queries)
    assert state.world is not None
    assert all(door.is_open for door in state.world.view.doors)
    assert WRONG_EDGE not in state.live_map.graph.edges


def stays(harness: SessionHarness) -> None:
    """Let time pass and see that the robot stays where it is, once it stands."""
    harness.wait(3)
    where = harness.robot.pose.copy()
    harness.wait(TICKS)
    np.testing.assert_array_equal(harness.robot.pose, where)
    assert harness.session.state.activity.mode is Mode.TELEOP
