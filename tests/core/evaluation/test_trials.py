"""Trials: resumable, the same however they are cut into pieces, and never mixed with those of other settings."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from joblib import Parallel

from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.map_drawing import load_drawing
from ltvn_core.evaluation.method_parts import RULES
from ltvn_core.evaluation.plans import RunFiles, RunPlan
from ltvn_core.evaluation.protocol import EvaluationProtocol, light_under, protocol_under
from ltvn_core.evaluation.reports.result_rows import setup_of
from ltvn_core.evaluation.results import Run, TestedMap
from ltvn_core.evaluation.runner import Progress, record_failures, run_plans
from ltvn_core.navigation.events import QueryEnded
from tests.core.simulation.two_room_mesh import box_house, save

EPISODES = 4


def _plan(folder: Path, *, seed: int = 0, step_limit: int = 250, goals: int = 4, preset: str = "robust") -> RunPlan:
    """Plan a trial in a house of two rooms."""
    if not (house := folder / "house.glb").exists():
        save(box_house(), house)
    protocol = EvaluationProtocol(loops=1, goals=goals, episodes=EPISODES, step_limit=step_limit)
    return RunPlan(scene=str(house), seed=seed, preset=preset, predictor="oracle", protocol=protocol)


def _run(plan: RunPlan, folder: Path, episodes: int = EPISODES) -> TestedMap:
    parallel = Parallel(n_jobs=1, return_as="generator_unordered")
    told: list[Progress] = []
    plan = replace(plan, protocol=replace(plan.protocol, episodes=episodes))
    (run,) = run_plans([plan], folder, command="test", parallel=parallel, tell=told.append)
    assert told[-1] == Progress(drives=1, weights=1, maps=1, all_maps=1, rows=episodes, all_rows=episodes)
    assert told == sorted(told)
    return run.maps[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("evaluation")


@pytest.fixture(scope="module")
def trial(folder: Path) -> TestedMap:
    return _run(_plan(folder), folder)


def test_an_episode_goes_the_same_way_when_it_is_run_again_alone(trial: TestedMap, folder: Path) -> None:
    again = _run(_plan(folder), folder, episodes=2)

    assert again.episodes == trial.episodes[:2]


def test_more_episodes_begin_with_the_same_ones(trial: TestedMap, folder: Path) -> None:
    more = _run(_plan(folder), folder, episodes=EPISODES + 1)

    assert more.episodes[:EPISODES] == trial.episodes
    assert len(more.episodes) == EPISODES + 1


def test_what_is_done_is_not_done_again(trial: TestedMap, folder: Path) -> None:
    files = RunFiles.of(_plan(folder), folder)
    made = {path: path.stat().st_mtime_ns for path in (files.drive, files.map(), files.map_row(), files.episodes(0, 0))}

    _run(_plan(folder), folder)

    assert {path: path.stat().st_mtime_ns for path in made} == made


def test_results_of_other_settings_are_refused_and_not_overwritten(trial: TestedMap, folder: Path) -> None:
    with pytest.raises(OptionError, match=r"made with other settings \(protocol\)"):
        _run(_plan(folder, step_limit=300), folder)


def test_a_drive_of_other_settings_is_not_taken_for_ones_own(trial: TestedMap, folder: Path) -> None:
    with pytest.raises(OptionError, match=r"made with other settings \(goals\)"):
        _run(_plan(folder, preset="paper", goals=5), folder)


def test_the_oracle_reaches_its_goals_and_its_map_has_no_spurious_edge(trial: TestedMap) -> None:
    assert sum(episode.reached for episode in trial.episodes) >= EPISODES - 1
    assert trial.map.spurious_edges == 0
    assert all(0 < episode.spl <= 1 for episode in trial.episodes if episode.reached)


def test_a_goal_that_was_reached_had_all_its_way_crossed(trial: TestedMap) -> None:
    reached = [episode for episode in trial.episodes if episode.reached]

    assert all(episode.checkpoints and episode.crossed == episode.checkpoints for episode in reached)
    assert all(episode.localised and episode.mislocalised == 0 for episode in reached)


def test_methods_that_build_alike_share_a_map_as_either_would_build_it(
    trial: TestedMap, folder: Path, tmp_path: Path
) -> None:
    other = ("our-localising", "our-driving", "our-judging", "our-expanding", "our-recovering")
    plan = _plan(folder)
    _run(replace(plan, parts_off=other), folder, episodes=1)
    shared = list(RunFiles.of(plan, folder).folder.glob("built-*.rrd"))
    alone = replace(plan, parts_off=other)
    _run(alone, tmp_path, episodes=1)
    _run(replace(plan, parts_off=("merging",)), tmp_path, episodes=1)

    assert len(shared) == 1
    assert len(list(RunFiles.of(plan, tmp_path).folder.glob("built-*.rrd"))) == 2
    ours, theirs = (
        load_map(RunFiles.of(each, place).map()).graph for each, place in ((plan, folder), (alone, tmp_path))
    )
    assert ours.edges == theirs.edges
    assert list(ours.nodes) == list(theirs.nodes)


def test_a_failed_episode_is_recorded_as_it_went(folder: Path) -> None:
    hasty = _plan(folder, seed=1, step_limit=5)
    files, failed = RunFiles.of(hasty, folder), _run(hasty, folder, episodes=2)

    assert record_failures(files, Run(failed.columns, (failed,)), 1) == 1
    assert all((episode.crossed or 0) < (episode.checkpoints or 0) for episode in failed.episodes)

    recording = Recording.open(files.failure(0))
    ended = [stamped.event for stamped in recording.events if isinstance(stamped.event, QueryEnded)]
    assert [end.steps for end in ended] == [failed.episodes[0].steps]


def test_episodes_with_a_spoiled_camera_are_kept_apart_from_others(trial: TestedMap, folder: Path) -> None:
    plan = replace(_plan(folder), perturbations=("exposure",))
    spoiled = _run(plan, folder, episodes=1)

    assert (spoiled.columns.perturbations, trial.columns.perturbations) == (("exposure",), ())
    assert setup_of(spoiled).method == f"{setup_of(trial).method}, camera with exposure"
    assert RunFiles.of(plan, folder).run != RunFiles.of(_plan(folder), folder).run
    # The oracle does not look at pictures, so nothing else may have changed.
    assert spoiled.episodes == trial.episodes[:1]


def test_the_drawing_of_the_map_lies_beside_the_result(trial: TestedMap, folder: Path) -> None:
    drawing = load_drawing(RunFiles.of(_plan(folder), folder).drawing())

    assert trial.floorplan is None
    assert len(drawing.nodes) == trial.map.nodes
    assert len(drawing.edges) == trial.map.edges
    assert any("." in row for row in drawing.free)


def test_harder_conditions_have_files_of_their_own(folder: Path) -> None:
    plan = _plan(folder)
    usual, slip = RunFiles.of(plan, folder), RunFiles.of(replace(plan, conditions=("slip",)), folder)
    dark = RunFiles.of(replace(plan, conditions=("half-light",)), folder)

    assert slip.drive.parent.name == "house-slip-0"
    assert (dark.drive, dark.map().parent.name) == (usual.drive, "ltvn-oracle-with-half-light")
    assert protocol_under(EvaluationProtocol(), ["slip"]).odometry_noise.slips > 0
    assert protocol_under(EvaluationProtocol(), ["one-loop"]).loops == 1
    assert max(light_under(["half-light"])) == 0.5


def test_however_many_rules_are_left_out_their_files_have_names_that_a_file_system_takes(folder: Path) -> None:
    plan = _plan(folder)
    many = [replace(plan, parts_off=tuple(RULES)[first:]) for first in (0, 1)]

    labels = {RunFiles.of(each, folder).run.name for each in many}

    assert len(labels) == 2
    assert all(len(f"{label}-lifelong") < 200 for label in labels)


def test_an_evaluation_under_harder_conditions_says_so(tmp_path: Path) -> None:
    plan = _plan(tmp_path)
    conditions = ("half-light", "slip")
    plan = replace(plan, conditions=conditions, protocol=protocol_under(plan.protocol, conditions))

    trial = _run(plan, tmp_path, episodes=1)

    assert trial.columns.conditions == ("slip", "half-light", "1 mapping loop")
    assert setup_of(trial).scene == "house, slip, half-light, 1 mapping loop"
    noted = json.loads((tmp_path / "house-slip-0" / plan.label / "run.json").read_text(encoding="utf-8"))
    assert (noted["conditions"], noted["protocol"]["slips_per_m"]) == (["half-light", "slip"], 0.2)


def test_a_folder_of_an_older_version_is_refused_and_left_as_it_was(tmp_path: Path) -> None:
    plan = _plan(tmp_path)
    older = RunFiles.of(plan, tmp_path).run / "plan.json"
    older.parent.mkdir(parents=True)
    older.write_text("{}", encoding="utf-8")

    with pytest.raises(OptionError, match=r"older version.*--folder"):
        _run(plan, tmp_path)

    assert list(older.parent.iterdir()) == [older]
