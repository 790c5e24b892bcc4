"""A script of a world is the same for the same seed, keeps its promise, and leaves the robot its routes."""

import json
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import WorldError
from ltvn_core.simulation.changes.script_registry import SCRIPT_NAMES, OpenRoutes, make_script
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, WorldScript, read_script, write_script
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.worlds import AS_MADE, DoorMoved, LightChanged, PicturesExchanged, ThingKind, ThingPlaced, WorldState

TWO_DAYS_S = 2 * DAY_S


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("demo")


def state_at(script: WorldScript, at_s: float) -> WorldState:
    state = AS_MADE
    for timed in script.changes:
        if timed.at_s <= at_s:
            state = state.after(timed.change)
    return state


@pytest.mark.parametrize("name", SCRIPT_NAMES)
def test_a_seed_gives_one_script_and_another_seed_another(scene: Scene, name: str) -> None:
    script = make_script(name, scene, seed=3, duration_s=TWO_DAYS_S)
    assert script == make_script(name, scene, seed=3, duration_s=TWO_DAYS_S)
    times = [timed.at_s for timed in script.changes]
    assert times == sorted(times)
    if name not in ("static", "people", "crowd"):
        assert script.changes != make_script(name, scene, seed=4, duration_s=TWO_DAYS_S).changes


@pytest.mark.parametrize("name", SCRIPT_NAMES)
def test_every_change_of_a_script_can_be_carried_out(scene: Scene, name: str) -> None:
    script = make_script(name, scene, seed=1, duration_s=TWO_DAYS_S)
    world = World(scene, script, start_s=0.0)
    world.skip(TWO_DAYS_S)
    assert world.state == state_at(script, TWO_DAYS_S)


def test_doors_that_keep_hours_are_open_at_noon_and_some_are_closed_at_night(scene: Scene) -> None:
    script = make_script("daily", scene, duration_s=TWO_DAYS_S)
    for day in range(2):
        assert state_at(script, day * DAY_S + 12 * HOUR_S).closed_doors == frozenset()
        assert len(state_at(script, day * DAY_S + 23 * HOUR_S).closed_doors) >= 2


def test_doors_that_move_at_random_are_open_three_quarters_of_the_time(scene: Scene) -> None:
    script = make_script("telegraph", scene, duration_s=7 * DAY_S)
    closings = [timed.at_s for timed in script.changes if timed.change == DoorMoved(2, is_open=False)]
    openings = [timed.at_s for timed in script.changes if timed.change == DoorMoved(2, is_open=True)]
    closed_s = np.array(openings) - closings[: len(openings)]
    assert closed_s.mean() == pytest.approx(600, rel=0.25)
    assert (np.array(closings[1:]) - openings[: len(closings) - 1]).mean() == pytest.approx(1800, rel=0.35)


@pytest.mark.parametrize("name", ["doors", "daily", "telegraph", "all"])
def test_most_rooms_can_be_reached_from_each_other_whatever_is_closed(scene: Scene, name: str) -> None:
    routes, state = OpenRoutes(scene), AS_MADE
    for timed in make_script(name, scene, seed=2, duration_s=TWO_DAYS_S).changes:
        state = state.after(timed.change)
        assert routes.remain(state.closed_doors)


def test_one_door_closes_for_good_half_way(scene: Scene) -> None:
    script = make_script("doors", scene, duration_s=7 * DAY_S)
    last = {timed.change.door: timed for timed in script.changes if isinstance(timed.change, DoorMoved)}
    for_good = [door for door, timed in last.items() if timed.at_s == 3.5 * DAY_S]
    assert len(for_good) == 1
    assert last[for_good[0]].change == DoorMoved(for_good[0], is_open=False)


def test_where_furniture_and_things_stand_the_robot_still_gets_everywhere(scene: Scene) -> None:
    script = make_script("moving", scene, seed=5, duration_s=TWO_DAYS_S)
    kinds = {timed.change.kind for timed in script.changes if isinstance(timed.change, ThingPlaced)}
    assert ThingKind.FURNITURE in kinds
    assert len(kinds) >= 3
    world = World(scene, script, start_s=0.0)
    for _ in range(4):
        world.skip(TWO_DAYS_S / 4)
        clearance = world.scene.clearance
        places = clearance.sample_poses(np.random.default_rng(0), 60)
        lengths = clearance.path_lengths(clearance.sample_poses(np.random.default_rng(1), 1)[0], places[:, :2])
        assert np.isfinite(lengths).mean() > 0.95
        assert np.count_nonzero(clearance.navigable) > 0.85 * np.count_nonzero(scene.clearance.navigable)


def test_evenings_are_warm_nights_dark_and_pictures_are_exchanged(scene: Scene) -> None:
    script = make_script("light", scene, duration_s=TWO_DAYS_S)
    noon, evening, night = (state_at(script, hour * HOUR_S).light for hour in (12, 21, 2))
    assert noon.level > evening.level > night.level
    assert evening.warmth > noon.warmth
    assert all(0.2 < timed.change.level < 1.2 for timed in script.changes if isinstance(timed.change, LightChanged))
    assert sum(isinstance(timed.change, PicturesExchanged) for timed in script.changes) == 2


def test_a_script_returns_from_a_file(scene: Scene, tmp_path: Path) -> None:
    script = make_script("all", scene, seed=6, duration_s=DAY_S)
    write_script(script, tmp_path / "all.json")
    assert make_script(str(tmp_path / "all.json"), scene) == script


def test_scripts_run_together_as_they_do_alone(scene: Scene) -> None:
    both = make_script("doors+moving", scene, seed=2, duration_s=DAY_S).changes
    alone = [make_script(name, scene, seed=2, duration_s=DAY_S).changes for name in ("doors", "moving")]
    assert sorted(map(str, both)) == sorted(map(str, (*alone[0], *alone[1])))
    assert [timed.at_s for timed in both] == sorted(timed.at_s for timed in both)


@pytest.mark.parametrize("name", ["doors+daily", "moving+moving", "all+light"])
def test_scripts_that_would_change_the_same_things_do_not_run_together(scene: Scene, name: str) -> None:
    with pytest.raises(WorldError, match="the same things twice"):
        make_script(name, scene)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "cannot be read as JSON"),
        ("[" * 900 + "]" * 900, "levels deep"),
        ("[]", 'object with a list "changes"'),
        ('{"changes": [], "speed": 2}', "unknown keys: speed"),
        ('{"changes": [], "people": -1}', "from 0 to 20"),
        ('{"changes": [{"at_s": 1, "change": "Earthquake"}]}', "one of DoorMoved, ThingPlaced"),
        ('{"changes": [{"at_s": 1, "change": "DoorMoved", "door": 1}]}', "not a valid DoorMoved"),
        ('{"changes": [{"at_s": 1, "change": "DoorMoved", "door": 1, "is_open": "false"}]}', "expected bool"),
        (
            '{"changes": [{"at_s": 1, "change": "DoorMoved", "door": 1, "is_open": false, "by": 3}]}',
            "not a valid DoorMoved",
        ),
        ('{"changes": [{"at_s": -1, "change": "DoorMoved", "door": 1, "is_open": false}]}', "0 s or later"),
        ('{"changes": [{"at_s": NaN, "change": "DoorMoved", "door": 1, "is_open": false}]}', "0 s or later"),
        ('{"changes": [{"at_s": 5, "change": "DoorMoved", "door": 77, "is_open": false}]}', "at 5 s: .* no door 77"),
        ('{"changes": [{"at_s": 5, "change": "ThingRemoved", "thing": "ghost"}]}', "nothing of that name"),
    ],
)
def test_a_file_that_cannot_be_right_is_refused_with_the_place(
    scene: Scene, tmp_path: Path, text: str, why: str
) -> None:
    path = tmp_path / "script.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(WorldError, match=why):
        read_script(path, scene)


def test_a_file_by_hand_may_leave_out_everything_but_its_changes(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "evening.json"
    path.write_text(
        json.dumps({"changes": [{"at_s": 68400, "change": "DoorMoved", "door": 2, "is_open": False}]}), encoding="utf-8"
    )
    script = read_script(path, scene)
    assert (script.name, script.people) == ("evening", 0)
    assert state_at(script, 68400).closed_doors == {2}


def test_an_unknown_world_is_refused_with_the_names_that_exist(scene: Scene) -> None:
    with pytest.raises(WorldError, match="static, doors, daily"):
        make_script("quake", scene)
