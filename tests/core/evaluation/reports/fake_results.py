"""Small made-up results of an evaluation, for tests of its report."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.evaluation.map_drawing import MapDrawing, save_drawing
from ltvn_core.evaluation.query_result import FailureCause, PresenceBin, PresenceScore, QueryResult
from ltvn_core.evaluation.results import (
    EdgeCalibrationBin,
    MapTruthMetrics,
    Run,
    RunColumns,
    TestedMap,
    append_rows,
    drawing_path,
)

ODDS = {"ltvn": 0.88, "sptm": 0.45, "ving": 0.55}
"""Made-up success of each method."""


def make_episode(number: int, odds: float, rng: np.random.Generator) -> QueryResult:
    """One episode that reaches its goal with these odds."""
    reached = bool(rng.random() < odds)
    failure = None if reached else list(FailureCause)[int(rng.choice(6, p=[0.1, 0.3, 0.25, 0.2, 0.05, 0.1]))]
    shortest = float(rng.uniform(2, 12))
    return QueryResult(
        query=number,
        start=int(rng.integers(2000)),
        goal=int(rng.integers(2000)),
        reached=reached,
        outcome="arrived" if reached or failure is FailureCause.WRONG_ARRIVAL else "step limit",
        failure=failure,
        trigger=failure,
        steps=int(rng.integers(60, 900)),
        collisions=int(rng.poisson(0.4 if reached else 4)),
        path_m=shortest * float(rng.uniform(1, 1.6)),
        shortest_m=shortest,
        position_error_m=float(rng.uniform(0, 0.7)) if reached else float(rng.uniform(0.8, 6)),
        yaw_error_rad=float(rng.uniform(0, 0.4)),
        checkpoints=int(shortest) + 1,
        crossed=int(shortest) + 1 if reached else int(shortest) // 2,
        localised=20,
        mislocalised=0 if reached else 5,
    )


def make_floorplan(nodes: int, spurious: int, rng: np.random.Generator) -> MapDrawing:
    """A ring-shaped corridor with nodes along it."""
    free = tuple(
        "".join("." if 3 < x < 77 and 3 < y < 57 and not (20 < x < 60 and 20 < y < 40) else "#" for x in range(81))
        for y in range(61)
    )
    way = np.linspace(0, 2 * np.pi, nodes, endpoint=False)
    x, y = 4 + 3 * np.cos(way) + rng.normal(0, 0.15, nodes), 3 + 2.2 * np.sin(way) + rng.normal(0, 0.15, nodes)
    edges = [
        (i, (i + hop) % nodes, float(rng.beta(8, 1.5)), False) for i in range(nodes) for hop in (1, 2, -1) if nodes > 2
    ]
    bad = [
        (int(i), int(i + nodes // 2) % nodes, float(rng.uniform(0.2, 0.9)), True)
        for i in rng.integers(0, nodes, spurious)
    ]
    rows = tuple((i, float(x[i]), float(y[i]), float(way[i] + np.pi / 2)) for i in range(nodes))
    return MapDrawing((0.0, 0.0), 0.1, free, rows, (*edges, *bad))


def make_trial(
    scene: str = "tune-1",
    method: str = "ltvn",
    seed: int = 0,
    *,
    finetuned: bool = True,
    preset: str = "robust",
    without: tuple[str, ...] = (),
    queries: int = 0,
    episodes: int = 20,
    odds: float | None = None,
    nodes: int | None = None,
    spurious: int = 3,
    plan: bool = True,
    maintenance: str | None = None,
) -> TestedMap:
    """One trial of made-up episodes."""
    rng = np.random.default_rng([seed, episodes, len(method), queries, finetuned])
    odds = ODDS[method] * (1.0 if finetuned else 0.7) * (0.7 if preset == "paper" else 1) if odds is None else odds
    nodes = (90 if method == "ltvn" else 1200) + int(rng.integers(20)) if nodes is None else nodes
    return TestedMap(
        columns=RunColumns(
            scene=scene,
            seed=seed,
            method=method,
            preset=preset,
            without=without,
            finetuned=finetuned,
            predictor="network",
            maintenance=maintenance,
        ),
        after=queries,
        images=1200 + seed,
        fingerprint="0123abcd",
        map=MapTruthMetrics(
            nodes=nodes, edges=3 * nodes + spurious, spurious_edges=spurious, pieces=1, goals_connected=10
        ),
        floorplan=make_floorplan(nodes, spurious, rng) if plan else None,
        episodes=tuple(replace(make_episode(number, odds, rng), after=queries) for number in range(episodes)),
        version="0.1.0",
        command=f"ltvn evaluate --scene {scene} --system {method} --episodes {episodes} --seed {seed}",
    )


def with_columns(known: TestedMap, **changed: Any) -> TestedMap:
    """Return a map with other columns."""
    return replace(known, columns=replace(known.columns, **changed))


def run_of(known: TestedMap) -> Run:
    """Return a static test of a map."""
    return Run(known.columns, (known,))


def runs_of(*maps: TestedMap) -> tuple[Run, ...]:
    """Return a static test of each map."""
    return tuple(Run(known.columns, (known,)) for known in maps)


def keep(folder: Path, run: Run, label: str = "") -> Path:
    """Write a run as an evaluation leaves it, into a folder of its scene and seed, and return its file."""
    columns = run.columns
    name = label or "-".join([columns.method, *columns.without, *filter(None, (columns.maintenance, columns.world))])
    path = folder / f"{columns.scene}-{columns.seed}" / name / "rows.jsonl"
    for known in run.maps:
        append_rows(path, columns, [known, *known.episodes])
        if known.floorplan is not None:
            save_drawing(drawing_path(path.parent, known.after), known.floorplan)
    append_rows(path, columns, run.queries)
    return path


def make_lifelong_result(scene: str = "tune-1", seed: int = 0, *, points: int = 4, episodes: int = 20) -> Run:
    """A run of queries that gets better."""
    rng = np.random.default_rng(seed)
    command = f"ltvn lifelong --scene {scene} --seed {seed} --queries {100 * (points - 1)}"
    maps = [_a_point(scene, seed, 100 * number, episodes, rng) for number in range(points)]
    return Run(
        columns=maps[0].columns,
        maps=tuple(replace(known, command=command) for known in maps),
        queries=tuple(_a_query(number, rng) for number in range(100 * (points - 1))),
    )


def _a_point(scene: str, seed: int, queries: int, episodes: int, rng: np.random.Generator) -> TestedMap:
    odds = 0.97 - 0.12 * np.exp(-queries / 150)
    nodes, spurious = 90 + queries // 50, int(12 * np.exp(-queries / 120))
    known = make_trial(
        scene,
        seed=seed,
        queries=queries,
        episodes=episodes,
        odds=float(odds),
        nodes=nodes,
        spurious=spurious,
        maintenance="own",
    )
    bins = np.linspace(0, 1, 6)
    cells = [
        EdgeCalibrationBin(
            low, low + 0.2, int(10 ** (1 + 2 * low)), low + 0.12, min(1.0, low + float(rng.uniform(0, 0.2)))
        )
        for low in bins[:-1]
    ]
    return replace(known, calibration=tuple(cells))


def _a_query(number: int, rng: np.random.Generator) -> QueryResult:
    fading = np.exp(-number / 120)
    pruned = int(rng.poisson(0.35 * fading))
    return QueryResult(
        query=number,
        reached=bool(rng.random() < 0.9),
        outcome="arrived",
        steps=200,
        collisions=int(rng.poisson(0.3)),
        pruned=pruned,
        pruned_bad=int(rng.binomial(pruned, 0.9)),
        added_nodes=int(rng.random() < 0.02),
        added_edges=(added := int(rng.poisson(0.1))),
        added_spurious=int(rng.binomial(added, 0.05)),
        nodes=90 + number // 50,
        edges=273 + number // 10,
        spurious_edges=int(12 * fading),
    )


def few_results() -> tuple[Run, ...]:
    """Results of two methods in two scenes with two seeds, one without fine-tuning, and of two lifelong runs."""
    trials = [
        trial
        for scene in ("tune-1", "tune-2")
        for seed in (0, 1)
        for trial in (make_trial(scene, seed=seed), make_trial(scene, "sptm", seed=seed, nodes=200))
    ]
    before = make_trial("tune-1", finetuned=False, without=("fine-tuning",))
    return (*runs_of(*trials, before), *(make_lifelong_result(seed=seed, points=3) for seed in (0, 1)))


def make_world_result(world: str = "doors", maintenance: str = "persistent") -> Run:
    """Two queries in a changing world, one of which reached its goal."""
    score = PresenceScore(4, 0.25, (*[PresenceBin(0, 0.0, 0.0)] * 9, PresenceBin(4, 1.0, 0.75)))
    queries = tuple(
        QueryResult(
            query=number,
            at_s=36000.0 + 600 * number,
            start=0,
            goal=5,
            reached=number == 0,
            outcome="arrived" if number == 0 else "step limit",
            failure=None if number == 0 else FailureCause.STEP_LIMIT,
            cut_off=False,
            steps=200,
            collisions=0,
            path_m=5.0,
            shortest_m=4.0,
            blocked_tries=number,
            doors_tried=(),
            doors_wanted=(),
            doors_used=(),
            now=score,
            later=score,
            nodes=40,
            edges=100,
            lost_edges=0,
            detour_m=1.5,
        )
        for number in range(2)
    )
    columns = RunColumns(
        scene="demo",
        seed=0,
        method="ltvn",
        preset="robust",
        finetuned=True,
        predictor="network",
        maintenance=maintenance,
        world=world,
        days=7.0,
    )
    before = TestedMap(
        columns=columns,
        images=100,
        fingerprint="0123abcd",
        map=MapTruthMetrics(nodes=40, edges=100, spurious_edges=1, pieces=1, goals_connected=10),
        version="0.1.0",
        command="ltvn lifelong --world doors",
    )
    return Run(columns, (before,), queries)
