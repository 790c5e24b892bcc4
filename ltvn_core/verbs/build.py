"""`ltvn build`: makes a map from one recording, or from several of the same place."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.option_types import AUTO, PredictorName, SystemName
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class BuildVerb(Verb):
    """Build a map from one or more recordings by Algorithm 1, or as one of the paper's rivals does."""

    job = "ltvn_core.verbs.jobs.build:build_map"

    recordings: Positional[tuple[Path, ...]]
    """The recordings to build from: one, or several drives of one place on other days or from other starts. Name the
    parts of one run in the order in which they were driven."""
    output: NewRecording
    """The map to write; must not exist yet."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    system: SystemName = DEFAULT_SYSTEM
    """The navigation system that builds the map and is to drive by it: ltvn is the paper's, the others are rivals."""
    predictor: PredictorName = AUTO
    """Predictor that compares images: network is the trained one, geometric needs no training and supports any camera,
    oracle is the simulator's own geometry; auto is the network for simulated images and geometric for real ones.
    """
    weights: Path | None = None
    """Weights to use instead of those that come with the system."""
    goals: tuple[int, ...] = ()
    """Images, by their frame numbers, that must become nodes, because you will want to drive to them. If no other image
    recognises one, odometry joins it to the map; the command reports those that the map still does not hold."""
    seed: int = 0
    """Seed of the order in which images are sampled."""
