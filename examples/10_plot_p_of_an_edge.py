"""Plot p of an edge over time, read from a recording with Rerun's own reader and nothing of this package.

`python examples/10_plot_p_of_an_edge.py edge.png` plots an edge of `recordings/demo-fault.rrd` that leads through a
wall. It ends at 0, where the edge was pruned. `recordings/README.md` lists what else a recording holds.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
from rerun.chunk import RrdReader

DEMO = Path(__file__).parents[1] / "recordings" / "demo-fault.rrd"
EDGE = (1489, 2621)


def read_beliefs(path: Path, source: int, target: int) -> list[tuple[int, float, float]]:
    """Return the number of the event, seconds on the robot's clock and p, whenever p was set."""
    rows: list[tuple[int, float, float]] = []
    for chunk in RrdReader(str(path)).stream().filter(content=f"/beliefs/p/{source}_{target}"):
        batch = chunk.to_record_batch()
        event, nanoseconds = (batch.column(name).to_numpy(zero_copy_only=False) for name in ("event", "sim_time"))
        p = batch.column("Scalars:scalars").flatten().to_numpy(zero_copy_only=False)
        rows += zip(event.tolist(), (nanoseconds.astype(float) / 1e9).tolist(), p.tolist(), strict=True)
    return sorted(rows)


def main(output: Path, recording: Path = DEMO) -> None:
    """Print p and save the plot."""
    rows = read_beliefs(recording, *EDGE)
    for _, seconds, p in rows:
        print(f"{seconds:6.1f} s  p = {p:.3f}")

    figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
    axes.step([seconds for _, seconds, _ in rows], [p for _, _, p in rows], where="post", marker="o")
    axes.set(xlabel="robot's clock, s", ylabel="p", ylim=(-0.05, 1.05), title=f"edge {EDGE[0]} to {EDGE[1]}")
    figure.savefig(output, dpi=150)
    print(f"plotted in {output}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "edge.png"))
