"""Training and fine-tuning plans of the baselines: ours without everything that needs poses or maps.

A baseline knows only time, so a pair far apart in space is not certainly a negative for it. Therefore nothing is mined,
and no pair of one scene counts as far because of its poses.
"""

from dataclasses import replace

from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan
from ltvn_core.network.optimization.hard_negative_mining import FarCriterion
from ltvn_core.network.optimization.hyperparameters import Hyperparameters
from ltvn_core.network.optimization.training_loop import TrainingPlan

_ONLY_OTHER_SCENES = FarCriterion(distance_m=1e6, yaw_rad=4.0)
"""Larger than any scene, so that only pairs of different scenes are far."""


def baseline_hyperparameters(learning: Hyperparameters, *, even_distances: bool) -> Hyperparameters:
    """Return what of a plan suits a baseline; without `even_distances` it learns from pairs as often as they occur."""
    evened = even_distances and learning.evened
    return replace(learning, far=_ONLY_OTHER_SCENES, confusions=0, hardness=0.0, evened=evened)


def baseline_training_plan(
    *, even_distances: bool, minutes: float, steps: int | None, seed: int, fresh: bool = False
) -> TrainingPlan:
    """Return how a baseline's network is trained (all ours), from trained weights or `fresh`, for steps or minutes."""
    rate = 2e-3 if fresh else 5e-4
    learning = Hyperparameters(
        seed=seed, groups=6, pairs_per_group=30, hard=24, random=0, rate=rate, warm_up=0.1, average=0.99
    )
    plan = TrainingPlan(
        learning=baseline_hyperparameters(learning, even_distances=even_distances),
        architecture=PairArchitecture(),
        minutes=minutes,
        validations=3,
        minings=0,
    )
    return plan if steps is None else replace(plan, minutes=None, steps=steps)


def baseline_fine_tuning_plan(plan: FineTuningPlan, *, even_distances: bool) -> FineTuningPlan:
    """Return a plan of fine-tuning without what a baseline does not know."""
    return replace(plan, learning=baseline_hyperparameters(plan.learning, even_distances=even_distances), minings=0)
