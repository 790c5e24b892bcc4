"""Open a recording and ask what happened in it: the queries, what failed, and what the map believed of one edge.

No network and no simulator is needed.
"""

import sys
from pathlib import Path

import ltvn_core as ltvn

DEMO = Path(__file__).parents[1] / "recordings" / "demo-fault.rrd"


def main(path: Path) -> None:
    """Print the queries of a recording, its failures, and the life of the edge that was driven most."""
    recording = ltvn.Recording.open(path)
    timeline = recording.timeline
    print(f"{path.name}: {len(recording.frames)} images, {len(recording.events)} events in {recording.meta.scene}")

    for query in timeline.queries:
        print(f"query {query.id}: to node {query.goal}, {len(query.attempts)} attempts, {query.outcome}")
    for failure in ltvn.analysis.failed_queries(timeline):
        print(
            f"query {failure.query.id} failed ({failure.ending}, {failure.failure_mode}) at step "
            f"{failure.instant.step}: {failure.text}"
        )

    source, target = max(timeline.graph_at().edges, key=lambda ends: len(timeline.attempts_of_edge(*ends)))
    for instant, edge in ltvn.analysis.edge_story(timeline, source, target).beliefs:
        print(f"edge {source} -> {target}: p {edge.belief.p:.2f} from step {instant.step} on")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DEMO)
