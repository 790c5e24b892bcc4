"""`ltvn evaluate-robot`: the paper's test on a robot (its Table II)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class EvaluateRobotVerb(Verb):
    """Test what your own robot learns, in real time: episodes without maintenance, queries with it, and the same
    episodes again."""

    job = "ltvn_core.verbs.jobs.robot_evaluation:evaluate_robot"

    robot: Positional[str]
    """The robot: the name of an installed one, path/to/file.py:factory, or PROFILE@ADDRESS (ROS 2)."""
    map: Path
    """The map of the robot's surroundings; it is read, never changed."""
    episodes: int = 20
    """Number of random episodes before the queries; the same ones follow after the queries."""
    queries: int = 30
    """Number of queries with maintenance, between the episodes."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; must be the one that built the map, which auto finds."""
    weights: Path | None = None
    """Weights to use instead of those that come with the map's system; must be those that built the map."""
    seed: int = 0
    """Seed of the goals."""
    folder: FilledFolder = Path("runs/evaluation/robot")
    """Folder of episodes, recordings and maps; the next call continues from them."""
