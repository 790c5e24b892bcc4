"""Was it right to prune an edge? The simulator says whether it can be driven, and a robot tries.

Owns that verdict, which nothing in the map depends on: it is for the report alone.
"""

from collections.abc import Iterable
from contextlib import closing

import numpy as np

from ltvn_core.evaluate.attempts import Attempts
from ltvn_core.evaluate.course import Course
from ltvn_core.evaluate.proposals import Proposal
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topograph import EdgeKey

TRIES = 4
"""How often a robot drives an edge to find out (ours)."""
_BEGINNINGS = 3 * TRIES
"""A try does not count if the robot does not recognise where it begins, so a few more are granted."""


def bad_edges(course: Course, pruned: Iterable[Edge], seed: int) -> set[EdgeKey]:
    """Return the edges that nobody can drive, or that the robot could not drive: fewer than half of its tries arrived.

    Tries begin at the exact pose of the source but for the controller's tolerance. Each edge has dice of its own, so
    that it makes no difference which others are looked at.
    """
    bad = set[EdgeKey]()
    for edge in pruned:
        key = edge.source, edge.target
        if key not in bad and (course.truth.is_spurious(key) or _defeats_robot(course, edge, seed)):
            bad.add(key)
    return bad


def _defeats_robot(course: Course, edge: Edge, seed: int) -> bool:
    """Tell whether fewer than half of the tries arrive; an edge that no try began with is given the benefit."""
    rng = np.random.default_rng([seed, 6, edge.source, edge.target])
    proposal = Proposal(edge.source, edge.target, np.array(edge.waypoint), edge.belief.p, true=True, connected=True)
    driven, arrived = 0, 0
    with closing(
        Attempts(course.ground, course.predictor, course.system.method, np.zeros((1, 3)), rng, noise=course.noise)
    ) as attempts:
        for _ in range(_BEGINNINGS):
            attempted = attempts.drive(proposal)
            driven += attempted is not None
            arrived += attempted is not None and attempted.arrived
            if driven == TRIES:
                break
    return 2 * arrived < driven
