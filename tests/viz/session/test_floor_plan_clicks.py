"""A person aligns the floor plan by clicks: what moves, what is told, and that no click starts the robot."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.importing.floor_plan_alignment import align_floor_plan
from ltvn_core.geometry import compose
from ltvn_core.types import NodeId, Pose
from ltvn_viz.session.floor_plan_clicks import FloorPlanClicks
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import FloorPlanView, Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.core.data.importing.plan_files import laid_room
from tests.viz.session_harness import SessionHarness, said

TRUE_FRAME = np.array([0.6, -0.3, 0.2])
"""Pose of the plan's frame in that of the map, which the person finds."""


class Aligning:
    """A session with a floor plan, and a person who knows where the nodes are on it."""

    def __init__(self, folder: Path) -> None:
        self.harness = SessionHarness(folder)
        self.harness.state.alignment = FloorPlanClicks(laid_room())
        graph = self.harness.wait().moment.graph
        self.poses: dict[NodeId, Pose] = {int(node): pose for node, pose in zip(graph.ids, graph.poses, strict=True)}
        first, *_, last = self.poses
        middle = max(self.poses, key=lambda node: min(self.apart_m(node, first), self.apart_m(node, last)))
        self.nodes = (first, last, middle)

    def apart_m(self, node: NodeId, other: NodeId) -> float:
        return float(np.hypot(*(self.poses[node] - self.poses[other])[:2]))

    @property
    def view(self) -> FloorPlanView:
        view = self.harness.now.floor_plan
        assert view is not None
        return view

    @property
    def frame(self) -> Pose:
        """Pose of the plan's own frame as it is drawn."""
        return compose(self.view.plan.corner, np.array([1.0, 1.0, 0.0]))

    def click(self, node: NodeId, wrong_by_m: float = 0.0) -> Snapshot:
        """Click a node, and its true place on the plan as it is drawn now, or one that is wrong along x."""
        self.harness.do(c.Ask(c.Action.PICK, node))
        assert self.view.node == node
        on_plan = compose(np.array([-wrong_by_m, 0, 0]), _relative(TRUE_FRAME, self.poses[node]))
        x, y, _ = compose(self.frame, on_plan).tolist()
        return self.harness.do(c.Ask(c.Action.POINT_ON_PLAN, (x, y)))


def _relative(frame: Pose, pose: Pose) -> Pose:
    turn = -frame[2]
    return compose(np.array([0, 0, turn]), np.array([*(pose - frame)[:2], 0.0]))


@pytest.fixture
def aligning(tmp_path: Path) -> Aligning:
    aligning = Aligning(tmp_path)
    aligning.harness.do(c.Ask(c.Action.ALIGN_PLAN))
    return aligning


def test_pairs_move_the_plan_to_where_it_lies_and_no_click_starts_the_robot(aligning: Aligning) -> None:
    first, last, middle = aligning.nodes
    assert "Click a node" in aligning.harness.now.hint
    aligning.click(first)
    np.testing.assert_array_equal(aligning.frame, np.zeros(3))
    shown = aligning.click(last)
    np.testing.assert_allclose(aligning.frame, TRUE_FRAME, atol=0.02)
    assert "fits to 0.0" in shown.hint
    # The third place is clicked on the plan that has moved already.
    shown = aligning.click(middle)
    np.testing.assert_allclose(aligning.frame, TRUE_FRAME, atol=0.02)
    assert (shown.mode, shown.selected, aligning.view.pairs) == (Mode.TELEOP, None, 3)


def test_the_option_that_is_told_gives_the_same_alignment(aligning: Aligning) -> None:
    for node in aligning.nodes:
        aligning.click(node)
    aligning.harness.do(c.Ask(c.Action.USE_ALIGNMENT))
    option, *pairs = aligning.view.align.split()
    assert option == "--align"
    np.testing.assert_allclose(align_floor_plan(pairs, aligning.poses).pose, aligning.frame, atol=1e-9)
    shown = aligning.harness.do(c.Ask(c.Action.PICK, aligning.nodes[1]))
    assert shown.mode is Mode.NAVIGATING, "afterwards a click on a node is a goal again"


def test_an_alignment_that_is_left_changes_nothing_and_one_in_use_is_kept(aligning: Aligning) -> None:
    first, last, _ = aligning.nodes
    aligning.click(first)
    aligning.click(last)
    aligning.harness.do(c.Ask(c.Action.USE_ALIGNMENT))
    used, option = aligning.frame, aligning.view.align
    aligning.harness.do(c.Ask(c.Action.ALIGN_PLAN))
    aligning.click(first)
    aligning.click(last, wrong_by_m=0.4)
    assert not np.allclose(aligning.frame, used)
    aligning.harness.do(c.Ask(c.Action.CANCEL))
    assert not aligning.view.is_aligning
    np.testing.assert_allclose(aligning.frame, used)
    assert aligning.view.align == option


def test_clicks_are_taken_back_one_by_one(aligning: Aligning) -> None:
    first, last, _ = aligning.nodes
    aligning.click(first)
    aligning.click(last)
    seen = []
    for _ in range(5):
        aligning.harness.do(c.Ask(c.Action.UNDO_PLAN_CLICK))
        seen.append((aligning.view.pairs, aligning.view.node))
    assert seen == [(1, last), (1, None), (0, first), (0, None), (0, None)]
    np.testing.assert_array_equal(aligning.frame, np.zeros(3))


def test_pairs_that_contradict_each_other_are_told(aligning: Aligning) -> None:
    first, last, _ = aligning.nodes
    aligning.click(first)
    shown = aligning.click(last, wrong_by_m=2.0)
    assert "disagree" in shown.hint


def test_a_pair_at_the_same_place_is_left_out_with_the_reason(aligning: Aligning) -> None:
    first, last, _ = aligning.nodes
    aligning.click(first)
    shown = aligning.click(first)
    assert "too near" in said(shown)
    assert aligning.view.pairs == 1
    aligning.click(last)
    np.testing.assert_allclose(aligning.frame, TRUE_FRAME, atol=0.02)


def test_a_click_that_comes_too_late_or_names_no_node_changes_nothing(aligning: Aligning) -> None:
    aligning.harness.do(c.Ask(c.Action.POINT_ON_PLAN, (1.0, 1.0)))
    assert aligning.view.pairs == 0
    shown = aligning.harness.do(c.Ask(c.Action.PICK, 10**6))
    assert "not in the map" in said(shown)
    assert aligning.view.node is None


def test_a_click_on_a_node_aligns_the_plan_while_a_question_is_on_show_too(aligning: Aligning) -> None:
    aligning.harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), c.Ask(c.Action.PICK, aligning.nodes[0]))
    assert aligning.view.node == aligning.nodes[0]
