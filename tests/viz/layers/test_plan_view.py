"""What the pages are told of the map from above, without a browser: nothing is missed, nothing is said twice."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core.analysis.map_history import EMPTY_GRAPH, GraphArrays
from ltvn_core.errors import SceneError
from ltvn_core.navigation.event_table import NavigationProgress
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.worlds import AS_MADE, PersonMoved, ThingKind, ThingPlaced, WorldState
from ltvn_viz.layers.first_view import Floor
from ltvn_viz.layers.map_changes import MapChanges
from ltvn_viz.layers.plan_view import PlanView
from ltvn_viz.layers.scene_assets import FloorPicture
from ltvn_viz.server.drive_socket import Newest
from ltvn_viz.session.inspection import Inspection, Overlay, QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.snapshot import DoorView, Snapshot, WorldView
from ltvn_viz.timeline.run_moment import RunMoment

Row = list[int]


class PageMap:
    """The map as a page keeps it (`static/plan_data.js`)."""

    def __init__(self) -> None:
        self.version = 0
        self.nodes: dict[int, Row] = {}
        self.edges: dict[tuple[int, int], Row] = {}

    def fetch(self, changes: MapChanges) -> dict[str, Any]:
        """Take what changed, and return what was said."""
        said = json.loads(changes.since(self.version))
        if said["whole"]:
            self.nodes, self.edges = {}, {}
        for node in said["goneNodes"]:
            self.nodes.pop(node, None)
        for source, target in said["goneEdges"]:
            self.edges.pop((source, target), None)
        self.nodes |= {row[0]: row[1:] for row in said["nodes"]}
        self.edges |= {(row[0], row[1]): row[2:] for row in said["edges"]}
        self.version = said["version"]
        return said


def graph_of(nodes: list[int], edges: dict[tuple[int, int], float]) -> GraphArrays:
    """Return a map whose nodes stand at their number in metres."""
    rows = {node: row for row, node in enumerate(nodes)}
    known = [(ends, p) for ends, p in edges.items() if ends[0] in rows and ends[1] in rows]
    return replace(
        EMPTY_GRAPH,
        ids=np.array(nodes, np.int64),
        poses=np.array([[node, 2.0 * node, 0.5] for node in nodes]).reshape(-1, 3),
        edges=np.array([[rows[a], rows[b]] for (a, b), _ in known], np.int64).reshape(-1, 2),
        p=np.array([p for _, p in known]),
        attempts=np.zeros(len(known), np.int64),
        acts=np.zeros(len(known), np.bool_),
        exits=np.zeros(len(nodes), np.bool_),
    )


NODES = st.lists(st.integers(0, 9), unique=True)
EDGES = st.dictionaries(st.tuples(st.integers(0, 9), st.integers(0, 9)), st.sampled_from((0.1, 0.5, 0.95)), max_size=30)


@given(st.lists(st.tuples(NODES, EDGES, st.booleans()), max_size=80))
def test_a_page_that_asks_now_and_then_has_the_map_of_a_page_that_comes_new(
    steps: list[tuple[list[int], dict[tuple[int, int], float], bool]],
) -> None:
    changes, early = MapChanges(), PageMap()
    for nodes, edges, asks in steps:
        changes.take(graph_of(nodes, edges))
        if asks:
            early.fetch(changes)
    early.fetch(changes)
    late = PageMap()
    late.fetch(changes)
    assert (early.nodes, early.edges, early.version) == (late.nodes, late.edges, late.version)


def test_a_changed_edge_of_a_large_map_costs_a_page_one_row() -> None:
    nodes = list(range(2000))
    edges = {(node, node + 1): 0.9 for node in range(1999)}
    changes, page = MapChanges(), PageMap()
    changes.take(graph_of(nodes, edges))
    page.fetch(changes)
    changes.take(graph_of(nodes, edges | {(5, 6): 0.2}))
    said = page.fetch(changes)
    assert (said["whole"], said["nodes"], said["edges"]) == (False, [], [[5, 6, 200, 0]])
    assert page.nodes[7] == [7000, 14000, 500, 0]
    changes.take(graph_of(nodes, {ends: p for ends, p in edges.items() if ends != (5, 6)}))
    assert page.fetch(changes)["goneEdges"] == [[5, 6]]


def test_the_same_map_is_no_new_version() -> None:
    changes = MapChanges()
    first = changes.take(graph_of([1, 2], {(1, 2): 0.5}))
    assert changes.take(graph_of([1, 2], {(1, 2): 0.5})) == first


class Told:
    """Keeps what pages are told."""

    def __init__(self, picture: FloorPicture | None = None) -> None:
        self.said: list[tuple[Newest, dict[str, Any]]] = []
        self.now = 0.0
        self.asked: list[tuple[str, WorldState]] = []
        self.picture = picture
        self.view = PlanView(self._tell, self._load, LOCOBOT, Floor((0.0, 0.0), (4.0, 3.0)), clock=lambda: self.now)

    def _tell(self, kind: Newest, message: str) -> None:
        self.said.append((kind, json.loads(message)))

    def _load(self, name: str, state: WorldState) -> FloorPicture | None:
        self.asked.append((name, state))
        if name == "foreign":
            raise SceneError("no such scene")
        return self.picture

    def after(self, snapshot: Snapshot) -> dict[Newest, dict[str, Any]]:
        """Show a snapshot a second later, and return what was said."""
        self.now += 1.0
        self.said.clear()
        self.view.show(snapshot)
        return dict(self.said)


def test_only_the_robot_is_spoken_of_while_only_the_robot_moves() -> None:
    told = Told()
    still = Snapshot(moment=RunMoment(robot=np.array([1.0, 2.0, 0.5]), graph=graph_of([1], {})))
    assert set(told.after(still)) >= {Newest.ROBOT, Newest.VIEW}
    assert told.after(still) == {}
    moved = replace(still, moment=replace(still.moment, robot=np.array([1.1, 2.0, 0.5])))
    assert told.after(moved) == {Newest.ROBOT: {"type": "robot", "pose": [1.1, 2.0, 0.5]}}


def test_pages_learn_of_goal_plan_selection_and_the_drawing_of_an_answer() -> None:
    told = Told()
    overlay = Overlay(nodes={2: (1, 2, 3)}, labels=(), is_of_likeness=True)  # type: ignore[dict-item]
    asked = Inspection(
        question=QuestionName.EDGE, answer=QuestionAnswer(overlay=overlay), selection=Selection(edge=(1, 2))
    )
    progress = NavigationProgress(plan=(1, 2), blocked=frozenset({(2, 1)}))
    moment = RunMoment(graph=graph_of([1, 2], {(1, 2): 0.9}), progress=progress)
    view = told.after(Snapshot(moment=moment, selected=2, inspection=asked))[Newest.VIEW]
    assert (view["goal"], view["plan"], view["blocked"], view["selected"]) == (2, [1, 2], [[2, 1]], [1, 2])
    assert view["marks"] == [[2, "rgb(1,2,3)"]]
    assert view["isOfLikeness"]
    assert view["asks"]


def test_the_floor_is_a_picture_where_the_scene_is_known_and_its_number_stays() -> None:
    picture = FloorPicture(np.full((6, 8, 3), 90, np.uint8), np.array([-1.0, 0.0]), np.array([3.0, 2.0]))
    told = Told(picture)
    told.after(Snapshot(scene="here"))
    view = told.after(Snapshot(scene="here"))[Newest.VIEW]
    assert (view["floor"]["low"], view["floor"]["high"]) == ([-1.0, 0.0], [3.0, 2.0])
    assert told.view.picture(view["floor"]["picture"]) is not None
    assert told.view.picture(99) is None
    told.after(Snapshot(scene="foreign"))
    assert told.after(Snapshot(scene="foreign", selected=1))[Newest.VIEW]["floor"] is None


def test_what_was_put_into_a_scene_lies_on_its_plan() -> None:
    told = Told()
    box = ThingPlaced("box-1", ThingKind.BOX, (2.0, 3.0, 0.5), (0.4, 0.6, 0.5))
    world = replace(AS_MADE, things=(box,), people=(PersonMoved("ann", (1.0, 1.0, 0.0)),), closed_doors=frozenset({0}))
    moment = RunMoment(progress=NavigationProgress(world=world))
    solids = told.after(Snapshot(scene="demo", moment=moment))[Newest.VIEW]["solids"]
    assert [2.0, 3.0, 0.5, 0.4, 0.6] in solids
    assert len(solids) == 3
    assert told.asked == [("demo", AS_MADE)], "the picture is of the bare scene"


def test_a_click_on_the_floor_is_asked_for_while_a_box_waits() -> None:
    told = Told()
    door = DoorView(0, "hall – study", 1.0, 2.0, along_x=True, width_m=0.9, is_open=False)
    world = WorldView((door,), (), aimed=0, light=1.0, undo="")
    view = told.after(Snapshot(world=world))[Newest.VIEW]
    assert view["aim"] == "put_box"
    assert view["doors"][0]["is_open"] is False
    assert told.after(Snapshot(world=replace(world, aimed=None)))[Newest.VIEW]["aim"] == ""


def test_pictures_of_a_floor_whose_light_changes_often_do_not_pile_up() -> None:
    told = Told()
    for bright in range(20):
        told.picture = FloorPicture(np.full((6, 8, 3), bright, np.uint8), np.zeros(2), np.ones(2))
        told.after(Snapshot(scene=f"scene-{bright}"))
        number = told.after(Snapshot(scene=f"scene-{bright}", selected=bright))[Newest.VIEW]["floor"]["picture"]
        assert told.view.picture(number) is not None
    assert sum(told.view.picture(number) is not None for number in range(20)) < 8
