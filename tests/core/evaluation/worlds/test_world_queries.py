"""Queries in a house of two rooms, between which a box stands for a while; an oracle drives."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("embreex")

from ltvn_core.data.recording.map_file import load_map
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.plans import RunFiles, Schedule
from ltvn_core.evaluation.results import load_results, read_queries
from ltvn_core.evaluation.runner import run_query_batch
from ltvn_core.evaluation.worlds.world_schedule import WorldSchedule
from ltvn_core.simulation.changes.world_script import MORNING_S
from ltvn_core.verbs.evaluate import run_plans_of
from ltvn_core.verbs.lifelong import LifelongVerb, WorldSummary
from ltvn_core.verbs.verb import to_json
from tests.core.simulation.two_room_mesh import box_house, save

WALL_X = 3.0
DAYS = 0.02
MAINTENANCES = ("static", "persistent")
CONTRACT = {
    "success_rate",
    "spl",
    "blocked_tries_per_100",
    "door_tries_per_100",
    "reopened_after_queries",
    "brier",
    "lost_edges_share",
    "nodes",
    "edges",
    "collisions_per_episode",
}


def verb(folder: Path) -> LifelongVerb:
    return LifelongVerb(
        scene=(str(folder / "house.glb"),),
        predictor="oracle",
        world=str(folder / "box.json"),
        maintenance=MAINTENANCES,
        queries=4,
        days=DAYS,
        loops=1,
        goals=3,
        step_limit=300,
        folder=folder / "runs",
        processes=1,
    )


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("house")
    save(box_house(), folder / "house.glb")
    box = {"thing": "crate", "kind": "box", "pose": [WALL_X, 2.0, 0.0], "size": [0.4, 0.9, 0.8]}
    half_way_s = MORNING_S + DAYS * 86400 / 2
    changes = [{"at_s": MORNING_S, "change": "ThingPlaced", **box}]
    changes += [{"at_s": half_way_s, "change": "ThingRemoved", "thing": "crate"}]
    (folder / "box.json").write_text(json.dumps({"name": "box", "changes": changes}), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def summary(house: Path) -> WorldSummary:
    found = verb(house).run()
    assert isinstance(found, WorldSummary)
    return found


def files(house: Path, maintenance: str) -> RunFiles:
    options = verb(house)
    schedule = Schedule(queries=4, world=str(options.world), days=DAYS)
    (plan,) = run_plans_of(options, "ltvn", options.episodes)
    plan = replace(plan, maintenance=maintenance, schedule=schedule)
    return RunFiles.of(plan, options.folder)


def test_the_summary_has_what_the_design_promises_for_each_maintenance(summary: WorldSummary) -> None:
    found = json.loads(to_json(summary))
    assert found.keys() >= CONTRACT
    assert tuple(found["by_maintenance"]) == MAINTENANCES
    assert found["by_maintenance"]["static"].keys() >= CONTRACT
    assert found["queries"] == 4
    assert found["success_low"] <= found["success_rate"] <= found["success_high"]


def test_each_goal_can_be_reached_when_its_query_begins(house: Path, summary: WorldSummary) -> None:
    where = files(house, "static")
    schedule = load_results(where.world_queries, WorldSchedule)
    begins = [query.at_s for query in schedule.queries]
    assert begins == sorted(begins)
    closed = [query for query in schedule.queries if query.closed]
    assert len(closed) == 2
    for query in closed:
        start, goal = query.episode.start_pose, query.episode.goal_pose
        assert (start[0] < WALL_X) == (goal[0] < WALL_X)
        assert query.closed_later == ()
    assert set(closed[0].closed) == set(schedule.changing) < set(schedule.edges)


def test_every_maintenance_gets_the_same_queries(house: Path, summary: WorldSummary) -> None:
    asked = [
        [
            (query.at_s, query.start, query.goal, query.shortest_m)
            for query in read_queries(files(house, name).query_batch(0, 4))
        ]
        for name in MAINTENANCES
    ]
    assert asked[0] == asked[1]
    assert summary.by_maintenance["static"].success_rate == summary.by_maintenance["persistent"].success_rate == 1.0


def test_queries_in_two_batches_come_to_the_same_as_in_one(house: Path, summary: WorldSummary, tmp_path: Path) -> None:
    where = files(house, "persistent")
    again = replace(where, run=where.run.with_name("again"))
    again.run.mkdir()
    shutil.copyfile(where.map(), again.map())
    for first in (0, 2):
        run_query_batch(again, first, first + 2)
    in_two = [query for ends in ((0, 2), (2, 4)) for query in read_queries(again.query_batch(*ends))]
    assert in_two == read_queries(where.query_batch(0, 4))
    assert load_map(again.map(4)).graph == load_map(where.map(4)).graph


def test_results_of_another_script_are_not_mixed_with_these(house: Path, summary: WorldSummary) -> None:
    script = house / "box.json"
    before = script.read_text(encoding="utf-8")
    try:
        script.write_text(before.replace('"box", "changes"', '"other", "changes"'), encoding="utf-8")
        with pytest.raises(OptionError, match="script"):
            verb(house).run()
    finally:
        script.write_text(before, encoding="utf-8")


def test_more_queries_than_the_days_have_room_for_are_refused(house: Path) -> None:
    with pytest.raises(OptionError, match="--days"):
        replace(verb(house), queries=40).run()


def test_without_a_world_there_is_no_truth_and_nothing_to_compare() -> None:
    with pytest.raises(OptionError, match="--world"):
        LifelongVerb(maintenance=("truth",)).run()
    with pytest.raises(OptionError, match="--world"):
        LifelongVerb(maintenance=("static", "robust")).run()
