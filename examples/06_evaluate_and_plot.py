"""Test navigation systems as the paper does, and plot how often they reach their goals.

`ltvn evaluate` is the same from the command line. The `oracle` predictor, few episodes and a small apartment make it
quick; leave `predictor` out for the network, and take 100 episodes, three seeds and several scenes, by name or as mesh
files of your own, for figures that you want to publish.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

from ltvn_core.verbs.evaluate import EvaluateSummary, EvaluateVerb

SYSTEMS = ("ltvn", "sptm")


def evaluate(system: str, folder: Path, episodes: int, scene: str) -> EvaluateSummary:
    """Map the scene with a system and drive random episodes; results that lie in `folder` are read."""
    summary = EvaluateVerb(
        scene=(scene,),
        system=system,
        predictor="oracle",
        finetune_steps=0,
        loops=1,
        goals=4,
        episodes=episodes,
        folder=folder / "evaluation",
    ).run()
    assert isinstance(summary, EvaluateSummary)  # A `part` of the work has another summary.
    return summary


def main(folder: Path, episodes: int, scene: str) -> None:
    """Evaluate two systems and save a bar plot with 95 % intervals."""
    found = [evaluate(system, folder, episodes, scene) for system in SYSTEMS]
    for system, summary in zip(SYSTEMS, found, strict=True):
        print(f"{system}: {summary.success_rate:.0%} of {summary.episodes} episodes, {summary.nodes:.0f} nodes")

    heights = [summary.success_rate for summary in found]
    below = [summary.success_rate - summary.success_low for summary in found]
    above = [summary.success_high - summary.success_rate for summary in found]
    figure, axes = plt.subplots(figsize=(4, 3), layout="constrained")
    axes.bar(SYSTEMS, heights, yerr=[below, above], capsize=6)
    axes.set_ylim(0, 1.05)
    axes.set_ylabel("goals reached")
    figure.savefig(folder / "success.png", dpi=150)


if __name__ == "__main__":
    folder, episodes, scene = [*sys.argv[1:], *(".", "10", "demo")[len(sys.argv) - 1 :]]
    main(Path(folder), int(episodes), scene)
