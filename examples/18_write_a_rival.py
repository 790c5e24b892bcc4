"""Write a rival: a navigation system that keeps images of the drive and joins them by rules of your own.

This one keeps every third image, joins it to the next and to all that the predictor calls reachable, takes the plan
with the fewest edges, and stands at the most reachable image. To compare it by `ltvn evaluate --system every-third`,
name `EVERY_THIRD` in your package's entry points `ltvn.systems`.
"""

import itertools
import sys
from collections.abc import Iterator

import numpy as np

import ltvn_core as ltvn
from ltvn_core.simulation.scripted_tour import drive_tour
from ltvn_core.systems.rival import DriveImages, EdgeCandidate, hop_cost, localise_at_most_reachable, rival

LEAST_REACHABILITY = 0.9


def keep_every_third(drive: DriveImages) -> tuple[list[int], Iterator[EdgeCandidate]]:
    """Return the rows that become nodes, goals among them, and the edges between them."""
    kept = sorted({*drive.rows[::3], *drive.goals})
    onward = set(itertools.pairwise(range(len(kept))))
    return kept, (
        EdgeCandidate(kept[a], kept[b], found.reachability[b], found.waypoints[b])
        for a, found in enumerate(drive.predictions(kept))
        for b in range(len(kept))
        if a != b and ((a, b) in onward or found.reachability[b] >= LEAST_REACHABILITY)
    )


EVERY_THIRD = rival(
    "every-third", "Every third", keeps=keep_every_third, weighs=hop_cost, localises=localise_at_most_reachable
)


def main(scene: str, queries: int = 2) -> None:
    """Map a scene with it, given by its name or as a mesh file, and drive to a few places."""
    simulation = ltvn.open_simulation(scene, seed=0)
    rng = np.random.default_rng(0)
    drive = list(drive_tour(simulation.robot, simulation.scene, rng, loops=1))
    oracle = ltvn.open_predictor("oracle", scene)
    known = ltvn.build_map(drive, predictor=oracle, system=EVERY_THIRD.factory(ltvn.ROBUST), scene=scene)

    navigator = known.navigator(simulation.robot)
    for number, goal in enumerate(rng.choice(list(known.graph.nodes), queries, replace=False).tolist()):
        ended = navigator.drive_to(goal, query=number)
        print(f"query {number} to node {goal}: {ended.outcome} after {ended.path_m:.1f} m")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "demo")
