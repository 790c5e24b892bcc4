"""A building that is open to one side: images that look out of it have no depth, and end no evaluation."""

from dataclasses import replace
from pathlib import Path

import pytest
import trimesh
from joblib import Parallel

from ltvn_core.data.recording.reader import Recording
from ltvn_core.evaluation.plans import RunFiles, RunPlan
from ltvn_core.evaluation.preparation import DriveGroundTruth
from ltvn_core.evaluation.protocol import EvaluationProtocol
from ltvn_core.evaluation.results import TestedMap, append_rows, load_results
from ltvn_core.evaluation.runner import run_plans
from ltvn_core.navigation.events import Note
from ltvn_core.verbs.collect import CollectSummary, CollectVerb
from tests.core.simulation.two_room_mesh import box_house, save

EPISODES = 3


def open_house(path: Path) -> Path:
    """Save the house of two rooms without the east room's outer wall."""
    house = box_house()
    walls = [name for name, part in house.geometry.items() if part.bounds[0, 0] > 5.9]
    house.delete_geometry(walls)
    assert isinstance(house, trimesh.Scene)
    return save(house, path)


def run(plan: RunPlan, folder: Path) -> TestedMap:
    parallel = Parallel(n_jobs=1, return_as="generator_unordered")
    (run,) = run_plans([plan], folder, command="test", parallel=parallel)
    return run.maps[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("open")


@pytest.fixture(scope="module")
def plan(folder: Path) -> RunPlan:
    protocol = EvaluationProtocol(loops=1, goals=3, episodes=EPISODES, step_limit=150)
    return RunPlan(scene=str(open_house(folder / "open.glb")), seed=0, predictor="oracle", protocol=protocol)


@pytest.fixture(scope="module")
def trial(plan: RunPlan, folder: Path) -> TestedMap:
    return run(plan, folder)


def test_the_evaluation_ends_and_counts_the_images_without_depth(trial: TestedMap, plan: RunPlan, folder: Path) -> None:
    files = RunFiles.of(plan, folder)
    drive = Recording.open(files.drive)
    blind = [frame for frame in drive.frames if not drive.observation(frame).has_depth]

    assert len(trial.episodes) == EPISODES
    assert blind
    assert trial.without_depth == len(blind)
    assert not set(load_results(files.drive_truth, DriveGroundTruth).goals) & set(blind)
    notes = [stamped.event.text for stamped in drive.events if isinstance(stamped.event, Note)]
    assert any(f"Image {blind[0]} has no depth" in note for note in notes)


def test_a_collected_drive_says_how_many_images_have_no_depth(plan: RunPlan, tmp_path: Path) -> None:
    collected = CollectVerb(output=tmp_path / "tour.rrd", scene=plan.scene, loops=1).run()
    assert isinstance(collected, CollectSummary)
    assert 0 < collected.without_depth < collected.frames
    assert collected.doubts == ()


def test_an_interrupted_batch_goes_on_after_its_last_episode(trial: TestedMap, plan: RunPlan, folder: Path) -> None:
    batch = RunFiles.of(plan, folder).episodes(0, 0)
    batch.unlink()
    append_rows(batch, trial.columns, [replace(trial.episodes[0], steps=77)])
    with batch.open("ab") as file:
        file.write(b'\n{"scene":"open","se')

    again = run(plan, folder)

    assert again.episodes[0].steps == 77, "the episode that was done is not run again"
    assert again.episodes[1:] == trial.episodes[1:]
