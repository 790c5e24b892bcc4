"""The paper's test: the same goals and episodes for all methods, over the major places."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.protocol import EvaluationProtocol, choose_goals, draw_episodes
from ltvn_core.simulation.scene_registry import load_scene


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """(200, 3) places in the demo apartment."""
    return load_scene("demo").clearance.sample_poses(np.random.default_rng(0), 200)


def test_goals_lie_in_as_many_rooms_as_possible_and_apart_from_each_other(poses: np.ndarray) -> None:
    scene, frames = load_scene("demo"), list(range(len(poses)))

    goals = choose_goals(scene, frames, poses, 10, np.random.default_rng(3))

    at = poses[list(goals)]
    visited = {
        k for k, room in enumerate(scene.rooms) for x, y, _ in at if room.x0 < x < room.x1 and room.y0 < y < room.y1
    }
    gaps = np.linalg.norm(at[:, None, :2] - at[None, :, :2], axis=-1)[~np.eye(10, dtype=bool)]
    assert len(set(goals)) == 10
    assert len(visited) == min(10, len(scene.rooms))
    assert gaps.min() > 0.5


def test_more_goals_than_images_are_refused(poses: np.ndarray) -> None:
    with pytest.raises(OptionError, match="10 goals need as many images, but the drive has 4"):
        choose_goals(load_scene("demo"), list(range(4)), poses[:4], 10, np.random.default_rng(0))


def test_where_rooms_have_too_few_images_goals_are_taken_between_them_too() -> None:
    scene = load_scene("demo")
    largest = max(scene.rooms, key=lambda room: room.area_m2)
    inside = [[(largest.x0 + largest.x1) / 2 + 0.1 * k, (largest.y0 + largest.y1) / 2, 0.0] for k in range(2)]
    outside = [[-10.0 - k, -10.0, 0.0] for k in range(4)]

    goals = choose_goals(scene, range(6), np.array(inside + outside), 5, np.random.default_rng(0))

    assert len(set(goals)) == 5
    assert {0, 1} < set(goals)


def test_a_drive_that_leads_nowhere_is_refused() -> None:
    poses = np.array([[0.0, 0.0, yaw] for yaw in range(3)])
    with pytest.raises(OptionError, match="too short"):
        draw_episodes(range(3), poses, (0, 1), 5, np.random.default_rng(0))


def test_more_episodes_begin_with_the_same_ones_and_each_leads_somewhere_else(poses: np.ndarray) -> None:
    frames = list(range(100, 300))

    few = draw_episodes(frames, poses, (100, 150), 20, np.random.default_rng(1))
    many = draw_episodes(frames, poses, (100, 150), 60, np.random.default_rng(1))

    assert many[:20] == few
    ends = [(np.array(plan.start_pose), np.array(plan.goal_pose)) for plan in many]
    assert all(np.hypot(*(goal - start)[:2]) > 1 for start, goal in ends)
    assert {plan.goal for plan in many} == {100, 150}


def test_the_step_limit_is_the_papers_for_small_and_large_scenes_unless_a_person_chooses() -> None:
    small, large = load_scene("demo"), replace(load_scene("demo"), area_m2=124.0)

    assert (EvaluationProtocol().steps_in(small), EvaluationProtocol().steps_in(large)) == (1000, 2000)
    assert EvaluationProtocol().steps_in(replace(large, area_m2=1000.0)) == 4000
    assert EvaluationProtocol(step_limit=77).steps_in(large) == 77


@pytest.mark.parametrize(
    "wrong", [{"loops": 0}, {"goals": 1}, {"episodes": 0}, {"step_limit": 0}, {"angle_noise": 1.0}]
)
def test_impossible_protocols_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(OptionError):
        EvaluationProtocol(**wrong)  # type: ignore[arg-type]
