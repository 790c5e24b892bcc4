"""Compare the maps of two recordings: their sizes, the edges that only one of them has, and the beliefs that differ.

`python examples/11_compare_two_maps.py` compares a good map with the same map after faults were planted in it. Give two
files of your own instead: nodes are matched by their images, or by their poses if the maps come from two drives.
"""

import sys
from pathlib import Path

import ltvn_core as ltvn

RECORDINGS = Path(__file__).parents[1] / "recordings"
DEMO = RECORDINGS / "demo-map.rrd", RECORDINGS / "demo-fault.rrd"
SHOWN = 5


def main(first: Path, second: Path) -> None:
    """Print the sizes of both maps and their differences, those that matter most for plans first."""
    graphs = [ltvn.Recording.open(path).final_graph() for path in (first, second)]
    for path, graph in zip((first, second), graphs, strict=True):
        sizes = ltvn.analysis.map_metrics(graph)
        print(f"{path.name}: {sizes.nodes} nodes, {sizes.edges} edges, mean p {sizes.mean_p or 0:.2f}")

    found = ltvn.analysis.compare_maps(*graphs)
    print(f"{len(found.nodes)} nodes are in both, matched by {found.matched_by}")
    print(f"{len(found.nodes_only_a)} nodes are only in {first.name}, {len(found.nodes_only_b)} only in {second.name}")

    for path, edges in ((first, found.edges_only_a), (second, found.edges_only_b)):
        named = ", ".join(f"{source} -> {target}" for source, target in edges[:SHOWN])
        print(f"{len(edges)} edges are only in {path.name}: {named}")

    changed = [(each.a, each.b) for each in found.differing if each.a and each.b]
    print(f"{len(changed)} edges are in both with another belief or more attempts")
    for before, after in changed[:SHOWN]:
        print(
            f"  {before.source} -> {before.target}: p {before.belief.p:.2f}, length {before.belief.mu:.2f} became "
            f"p {after.belief.p:.2f}, length {after.belief.mu:.2f}; attempts {before.attempts} to {after.attempts}"
        )


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3] or DEMO))
