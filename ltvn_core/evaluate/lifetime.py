"""Queries with maintenance, in stretches: each begins with the map that the one before it left in a file.

Owns one stretch, what it asks of the robot, and what it writes down. A stretch that is done is two files, the map and
what the queries did to it; so an interrupted test goes on at the last map. Frames and dice are named after the query,
so that it makes no difference where a run was interrupted.
"""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np

from ltvn_core.evaluate.course import Course
from ltvn_core.evaluate.plans import TrialFiles, TrialPlan
from ltvn_core.evaluate.preparation import Sights, prepare
from ltvn_core.evaluate.protocol import EpisodePlan
from ltvn_core.evaluate.refuted import bad_edges
from ltvn_core.evaluate.results import LifelongQuery, load_results, save_results
from ltvn_core.evaluate.trials import open_course
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.operators import pose_row
from ltvn_core.nav.episode import judge
from ltvn_core.recording.maps import save_map
from ltvn_core.types import FrameId

QUERIES_AT_ONCE = 25
"""Queries in a stretch: little is lost when it is interrupted, and a map is loaded for more than a few."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Some queries, done."""

    queries: tuple[LifelongQuery, ...]
    wall_s: float


class _Driven(NamedTuple):
    """One query, before anybody has tried which of the edges that left were bad."""

    query: LifelongQuery
    pruned: tuple[Edge, ...]
    """As they were before the query."""


def run_until(plan: TrialPlan, files: TrialFiles, first: int, until: int) -> int:
    """Drive the queries from `first` on up to `until`, in stretches; return how many there are."""
    for begin, end in stretches(first, until):
        run_stretch(plan, files, begin, end - begin)
    return until - first


def stretches(first: int, until: int) -> list[tuple[int, int]]:
    """Return the first query of each stretch, and the one after its last."""
    return [(begin, min(begin + QUERIES_AT_ONCE, until)) for begin in range(first, until, QUERIES_AT_ONCE)]


def queries_between(files: TrialFiles, first: int, until: int) -> tuple[LifelongQuery, ...]:
    """Read what was written down of the queries from `first` on up to `until`. Raises OptionError if they lack."""
    found: list[Stretch] = [load_results(files.stretch(*each), Stretch) for each in stretches(first, until)]
    return tuple(query for stretch in found for query in stretch.queries)


def run_stretch(plan: TrialPlan, files: TrialFiles, first: int, count: int) -> int:
    """Drive so many queries with the map after `first` ones, which learns; return how many there were.

    Writes the map and what the queries did to it; does nothing if both are there. Raises the errors of the parts.
    """
    until = first + count
    if files.stretch(first, until).exists() and files.map(until).exists():
        return count
    started, course, sights = time.monotonic(), open_course(plan, files, first, maintain=True), prepare(plan, files)
    driven = [_drive(plan, course, sights, query) for query in range(first, until)]
    if not files.map(until).exists():
        _save(plan, files, course, first, until)
    if not files.stretch(first, until).exists():
        told = _told(course, driven, plan.seed)
        save_results(files.stretch(first, until), Stretch(told, time.monotonic() - started))
    return count


def _drive(plan: TrialPlan, course: Course, sights: Sights, query: int) -> _Driven:
    """Drive one query from a random image of the mapping drive to a random node."""
    rng = np.random.default_rng([plan.seed, 5, query])
    known, before = set(course.graph.nodes), dict(course.graph.edges)
    episode, frame = _draw(course, sights, rng), _first_frame(plan, course, sights, query)
    result = course.run(query, episode, rng, first_frame=frame)
    graph, spurious = course.graph, course.truth.spurious(course.graph)
    pruned, added = before.keys() - graph.edges.keys(), graph.edges.keys() - before.keys()
    told = LifelongQuery(
        query=query,
        reached=result.reached,
        outcome=result.outcome,
        steps=result.steps,
        collisions=result.collisions,
        pruned=len(pruned),
        pruned_bad=0,
        pruned_spurious=sum(course.truth.is_spurious(edge) for edge in pruned),
        added_nodes=len(graph.nodes.keys() - known),
        added_edges=len(added),
        added_spurious=len(added & spurious),
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        spurious_edges=len(spurious),
    )
    return _Driven(told, tuple(before[edge] for edge in pruned))


def _draw(course: Course, sights: Sights, rng: np.random.Generator) -> EpisodePlan:
    """Draw a start and a goal that is not reached there."""
    nodes = sorted(course.graph.nodes)
    while True:
        start, goal = int(rng.integers(len(sights.frames))), nodes[int(rng.integers(len(nodes)))]
        ends = np.array(sights.poses[start]), course.truth.pose(goal)
        if not judge(0, *ends).reached:
            return EpisodePlan(sights.frames[start], goal, *(pose_row(end) for end in ends))


def _first_frame(plan: TrialPlan, course: Course, sights: Sights, query: int) -> FrameId:
    """Return the number of a query's first image: no query takes more images than it has steps."""
    return max(sights.frames) + 1 + query * (plan.protocol.steps_in(course.scene) + 1)


def _save(plan: TrialPlan, files: TrialFiles, course: Course, first: int, until: int) -> None:
    save_map(
        files.map(until),
        course.graph,
        [course.views.observation(frame) for frame in course.views.frames],
        scene=course.scene.address,
        fingerprint=course.fingerprint,
        config={
            "verb": "lifelong",
            "system": course.system.name,
            "seed": plan.seed,
            "queries": until,
            "method": asdict(course.system.method),
        },
        origin=files.map(first),
    )


def _told(course: Course, driven: Sequence[_Driven], seed: int) -> tuple[LifelongQuery, ...]:
    """Try the edges that left, and count the bad ones with the query in which they left."""
    bad = bad_edges(course, [edge for each in driven for edge in each.pruned], seed)
    counts = (sum((edge.source, edge.target) in bad for edge in each.pruned) for each in driven)
    return tuple(replace(each.query, pruned_bad=count) for each, count in zip(driven, counts, strict=True))
