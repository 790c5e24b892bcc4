"""`python -m benchmarks.rules`: what each departure from the paper is worth, one left out at a time.

Every rule drives the same episodes as the whole method, on a map of the same drive, so differences are paired. It goes
on from what its folder holds. Owns the scenes, none of which is a test scene, and the table.
"""

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.evaluation.plans import RunPlan
    from ltvn_core.evaluation.results import MapTruthMetrics, TestedMap

SCENES: Mapping[str, tuple[str, ...]] = {
    "tune-0": (),
    "tune-1": ("slip", "one-loop"),
    "tune-2": ("half-light", "one-loop"),
    "tune-narrow-0": ("one-loop",),
    "tune-twin-0": ("one-loop",),
    "tune-plain-0": ("one-loop",),
    "tune-office-0": ("one-loop",),
    "tune-hall-0": ("one-loop",),
}
"""Scene -> what is harder there than usual. Thresholds may be chosen on these: none is in a table of results."""
LEARNED_ONLY = ("believing", "expanding")
"""Groups of rules that act only where the map learns, which it does not in these episodes."""
SPL_WORTH = 0.02
"""Smallest gain of SPL for which a rule that wins no goal is kept."""
_RESAMPLES = 2_000


@dataclass(frozen=True)
class Achieved:
    """What a method came to in one scene."""

    scene: str
    episodes: int
    reached: int
    spl: float
    collisions: float
    """Per episode."""
    map: "MapTruthMetrics"


@dataclass(frozen=True)
class RuleWorth:
    """What one rule is worth in one scene: the whole method minus the method without it."""

    scene: str
    rule: str
    episodes: int
    goals: int
    """Goals reached with the rule and not without it, minus those reached only without it."""
    spl: float
    spl_low: float
    """95 % interval over paired episodes, by bootstrap."""
    spl_high: float
    told_apart: float
    """Smallest true difference of SPL that this number of episodes detects with a power of 80 %."""
    collisions: float
    """Per episode; below 0 the rule avoids some."""
    spurious_edges: int
    """Below 0 the rule keeps some out of the map."""
    seconds_ratio: float
    """Time of the episodes with the rule over the time without it."""


@dataclass(frozen=True)
class RulesSummary:
    """The worth of all rules in all scenes that are done."""

    whole: list[Achieved]
    """What the whole method came to in each scene."""
    rules: list[RuleWorth]
    without_worth: list[str]
    """Rules that win no goal and no 0.02 SPL in any scene."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class RulesVerb(Verb):
    """Drive the same episodes with the whole method and without one rule at a time; resumable."""

    scene: tuple[str, ...] = tuple(SCENES)
    """Scenes by name."""
    rule: tuple[str, ...] = ()
    """Rules by their names in config.py, for instance driving.swerve; by default all that a frozen map can show."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Episodes for each scene and rule."""
    folder: Path = Path("runs/rules")
    """Where drives, weights, maps and results are kept, and found again by the next call."""
    page: Path | None = None
    """Write the tables into this Markdown page, between the lines of its block `rules`."""

    def run(self) -> Summary:
        """Run what is missing, scene after scene, and sum up."""
        from ltvn_core.evaluation.method_parts import RULES
        from tools.results_page import fill_blocks

        started = time.monotonic()
        rules = self.rule or tuple(rule for rule in RULES if rule.split(".")[0] not in LEARNED_ONLY)
        whole: list[Achieved] = []
        worth: list[RuleWorth] = []
        for scene in self.scene:
            with_all, *without = self._trials(scene, rules)
            whole.append(summed_up(with_all))
            worth += [_worth(with_all, trial, rule) for rule, trial in zip(rules, without, strict=True)]
            if self.page is not None:
                fill_blocks(self.page, {"rules": markdown(whole, worth)})
        useless = [rule for rule in rules if not any(_is_worth_it(row) for row in worth if row.rule == rule)]
        return RulesSummary(whole, worth, useless, round(time.monotonic() - started, 1))

    def _trials(self, scene: str, rules: Sequence[str]) -> "Iterator[TestedMap]":
        """Yield the trial of the whole method and those without each rule, one process, one after the other."""
        from tqdm import tqdm

        from ltvn_core.evaluation.runner import run_plans
        from ltvn_core.evaluation.workers import workers
        from ltvn_core.verbs.evaluate import shown_on

        with workers(1, None, self.folder) as parallel:
            for parts in tqdm([(), *((rule,) for rule in rules)], desc=scene, unit="rule"):
                plan = self._plan(scene, parts)
                with tqdm(desc=" ".join(parts) or "whole", leave=False) as bar:
                    command = f"python -m benchmarks.rules --scene {scene}"
                    (run,) = run_plans([plan], self.folder, command=command, parallel=parallel, tell=shown_on(bar))
                    yield run.maps[0]

    def _plan(self, scene: str, parts: tuple[str, ...]) -> "RunPlan":
        from ltvn_core.evaluation.plans import RunPlan
        from ltvn_core.evaluation.protocol import EvaluationProtocol, protocol_under
        from ltvn_core.simulation.body_selection import choose_body

        conditions = SCENES.get(scene, ())
        protocol = protocol_under(EvaluationProtocol(episodes=self.episodes, body=choose_body("planar")), conditions)
        return RunPlan(scene=scene, seed=0, parts_off=parts, conditions=conditions, protocol=protocol)


def markdown(whole: Sequence["Achieved"], worth: Sequence[RuleWorth]) -> str:
    """Return two tables of all scenes that are done: the whole method, then each rule over all scenes."""
    scenes = [_scene_row(each) for each in whole]
    rules = [
        _rule_row(rule, [row for row in worth if row.rule == rule]) for rule in dict.fromkeys(r.rule for r in worth)
    ]
    head = ["rule", "ours", "paper's", "goals", "SPL", "most SPL in", "collisions", "spurious edges", "time"]
    return (
        table(["scene", "reached", "SPL", "collisions", "spurious edges"], scenes)
        + "\nWith the rule minus without it:\n\n"
        + table(head, rules)
    )


def _scene_row(found: Achieved) -> list[str]:
    reached = f"{found.reached} of {found.episodes}"
    spurious = f"{found.map.spurious_edges} of {found.map.edges}"
    return [found.scene, reached, f"{found.spl:.2f}", f"{found.collisions:.2f}", spurious]


def _rule_row(rule: str, rows: Sequence[RuleWorth]) -> list[str]:
    from operator import attrgetter

    from ltvn_core.config import PAPER, ROBUST

    best = max(rows, key=lambda row: row.spl)
    episodes = sum(row.episodes for row in rows)
    ratio = sum(row.seconds_ratio for row in rows) / len(rows)
    return [
        f"`{rule}`",
        f"{attrgetter(rule)(ROBUST):g}",
        f"{attrgetter(rule)(PAPER):g}",
        f"{sum(row.goals for row in rows):+d} of {episodes}",
        f"{sum(row.spl * row.episodes for row in rows) / episodes:+.3f}",
        f"{best.scene} {best.spl:+.2f} ({best.spl_low:+.2f} to {best.spl_high:+.2f})",
        f"{sum(row.collisions * row.episodes for row in rows) / episodes:+.2f}",
        f"{sum(row.spurious_edges for row in rows):+d}",
        f"{ratio:.2f}",
    ]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)


def summed_up(trial: "TestedMap") -> Achieved:
    """Return what a trial came to."""
    from ltvn_core.evaluation.metrics import compute_metrics

    found = compute_metrics([trial])
    return Achieved(
        scene=trial.columns.scene,
        episodes=found.episodes,
        reached=sum(each.reached for each in trial.episodes),
        spl=round(found.spl.mean, 3),
        collisions=round(found.collisions_per_episode.mean, 3),
        map=trial.map,
    )


def _seconds(trial: "TestedMap") -> float:
    return sum(each.seconds or 0.0 for each in trial.episodes)


def _worth(whole: "TestedMap", without: "TestedMap", rule: str) -> RuleWorth:
    """Compare two trials episode by episode."""
    import numpy as np

    def column(name: str) -> "np.ndarray":
        return np.array([[getattr(each, name) for each in trial.episodes] for trial in (whole, without)], dtype=float)

    won = np.subtract(*column("spl"))
    rng = np.random.default_rng(0)
    means = won[rng.integers(len(won), size=(_RESAMPLES, len(won)))].mean(1)
    low, high = np.quantile(means, (0.025, 0.975))
    return RuleWorth(
        scene=whole.columns.scene,
        rule=rule,
        episodes=len(won),
        goals=int(np.subtract(*column("reached")).sum()),
        spl=round(float(won.mean()), 4),
        spl_low=round(float(low), 4),
        spl_high=round(float(high), 4),
        # Two-sided at 5 %, with a power of 80 %.
        told_apart=round(float((1.96 + 0.84) * means.std()), 4),
        collisions=round(float(np.subtract(*column("collisions")).mean()), 3),
        spurious_edges=whole.map.spurious_edges - without.map.spurious_edges,
        seconds_ratio=round(_seconds(whole) / max(_seconds(without), 1e-9), 2),
    )


def _is_worth_it(row: RuleWorth) -> bool:
    return row.goals > 0 or row.spl >= SPL_WORTH


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.rules", RulesVerb))
