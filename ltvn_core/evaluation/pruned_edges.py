"""Was it right to prune an edge? The simulator says whether it can be driven, and a robot tries.

Owns that verdict, which nothing in the map depends on: it is for the report alone.
"""

from collections.abc import Iterable
from contextlib import closing

import numpy as np

from ltvn_core.evaluation.edge_driver import EdgeDriver
from ltvn_core.evaluation.edge_proposals import EdgeProposal
from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import EdgeKey

ATTEMPTS_PER_EDGE = 4
"""How often a robot drives an edge to find out (ours)."""
_MAX_STARTS = 3 * ATTEMPTS_PER_EDGE
"""A try does not count if the robot does not recognise where it begins, so a few more are granted."""


def bad_edges(runner: EpisodeRunner, pruned: Iterable[Edge], seed: int) -> set[EdgeKey]:
    """Return the edges that nobody can drive, or that the robot could not drive: fewer than half of its tries arrived.

    Tries begin at the exact pose of the source but for the controller's tolerance. Each edge has dice of its own, so
    that it makes no difference which others are looked at.
    """
    bad = set[EdgeKey]()
    for edge in pruned:
        key = edge.source, edge.target
        if key not in bad and (runner.truth.is_spurious(key) or _mostly_fails(runner, edge, seed)):
            bad.add(key)
    return bad


def _mostly_fails(runner: EpisodeRunner, edge: Edge, seed: int) -> bool:
    """Tell whether fewer than half of the tries arrive; an edge that no try began with is given the benefit."""
    rng = np.random.default_rng([seed, 6, edge.source, edge.target])
    proposal = EdgeProposal(
        source=edge.source,
        target=edge.target,
        waypoint=np.array(edge.waypoint),
        reachability=edge.belief.p,
        true=True,
        connected=True,
    )
    driven = 0
    arrived = 0
    with closing(
        EdgeDriver(
            runner.imaged_scene, runner.predictor, runner.system.method, np.zeros((1, 3)), rng, noise=runner.noise
        )
    ) as attempts:
        for _ in range(_MAX_STARTS):
            attempted = attempts.drive(proposal)
            driven += attempted is not None
            arrived += attempted is not None and attempted.arrived
            if driven == ATTEMPTS_PER_EDGE:
                break
    return 2 * arrived < driven
