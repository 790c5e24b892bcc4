"""Checks whether pruned edges were bad: by the ground truth, and by driving them.

Only for reports; the map does not use the result.
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
"""Attempts at each edge (ours)."""
_MAX_STARTS = 3 * ATTEMPTS_PER_EDGE
"""An attempt does not count if the robot does not localise at the source, so some more are allowed."""


def bad_edges(runner: EpisodeRunner, pruned: Iterable[Edge], seed: int) -> set[EdgeKey]:
    """Return the edges that are spurious, or at which fewer than half of the robot's attempts arrived.

    Attempts start at the exact pose of the source with errors within the controller's tolerance. Each edge has a random
    generator of its own, so that the result does not depend on the other edges.
    """
    bad = set[EdgeKey]()
    for edge in pruned:
        key = edge.source, edge.target
        if key not in bad and (runner.truth.is_spurious(key) or _mostly_fails(runner, edge, seed)):
            bad.add(key)
    return bad


def _mostly_fails(runner: EpisodeRunner, edge: Edge, seed: int) -> bool:
    """Return whether fewer than half of the attempts arrive; False if no attempt could start."""
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
            runner.imaged_scene,
            runner.map.predictor,
            runner.map.system.method,
            np.zeros((1, 3)),
            rng,
            noise=runner.noise,
            body=runner.body,
        )
    ) as attempts:
        for _ in range(_MAX_STARTS):
            attempted = attempts.drive(proposal)
            driven += attempted is not None
            arrived += attempted is not None and attempted.arrived
            if driven == ATTEMPTS_PER_EDGE:
                break
    return 2 * arrived < driven
