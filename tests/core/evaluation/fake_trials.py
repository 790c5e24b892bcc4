"""Trials that nobody drove, for tests of figures. Owns no assertion."""

from collections.abc import Sequence

import numpy as np

from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.evaluation.results import MapTruthMetrics, RunColumns, TestedMap


def episode(number: int, *, reached: bool, steps: int = 200, collisions: int = 0) -> QueryResult:
    """Return an episode over 4 m that took 5 m."""
    return QueryResult(
        query=number,
        start=10 + number,
        goal=5,
        reached=reached,
        outcome="arrived" if reached else "step limit",
        failure=None if reached else FailureCause.SPURIOUS_EDGE,
        trigger=None if reached else FailureCause.SPURIOUS_EDGE,
        steps=steps,
        collisions=collisions,
        path_m=5.0,
        shortest_m=4.0,
        position_error_m=0.1,
        yaw_error_rad=0.1,
    )


def trial(reached: Sequence[bool], *, scene: str = "tune-1", seed: int = 0, method: str = "ltvn") -> TestedMap:
    """Return a trial whose episodes went like this."""
    return TestedMap(
        columns=RunColumns(scene=scene, seed=seed, method=method, preset="robust", finetuned=True, predictor="network"),
        images=1000,
        fingerprint="none",
        map=MapTruthMetrics(nodes=100 + seed, edges=400, spurious_edges=4, pieces=1, goals_connected=10),
        episodes=tuple(
            episode(k, reached=bool(well), steps=200 + k, collisions=k % 3) for k, well in enumerate(reached)
        ),
        version="0",
        command="none",
    )


def random_trials(
    rates: Sequence[float], *, episodes: int = 50, method: str = "ltvn", scenes: Sequence[str] = ("tune-1", "tune-2")
) -> list[TestedMap]:
    """Return a trial for each scene and rate, which is its share of success but for chance."""
    rng = np.random.default_rng(7)
    return [
        trial((rng.random(episodes) < rate).tolist(), scene=scene, seed=seed, method=method)
        for scene in scenes
        for seed, rate in enumerate(rates)
    ]
