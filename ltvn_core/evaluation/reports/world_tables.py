"""The tables of evaluations in changing worlds: metrics of each maintenance, and the commands that reproduce them.

For worlds with people, a table reports the robot's distances to people, contacts and waiting times.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ltvn_core.evaluation.query_result import EncounterCounts
from ltvn_core.evaluation.reports.evaluation_tables import ReportTable, merged_rows, percent
from ltvn_core.evaluation.reports.result_rows import scene_name
from ltvn_core.evaluation.results import Run
from ltvn_core.evaluation.worlds.world_metrics import WorldMetrics, world_metrics
from ltvn_core.systems.maintenance_names import MAINTENANCE_NAMES

ALL_SCENES = "all scenes"
_PEOPLE_HEAD = (
    *(
        "world",
        "scene",
        "maintenance",
        "encounters",
        "touches",
        "avoidable touches",
        "closest, m",
        "1 % nearer than, m",
    ),
    *("10 %, m", "half, m", "people gave way", "stood still, s each", "goals reached", "SPL", "queries", "seeds"),
)


def world_table(results: Sequence[Run]) -> ReportTable:
    """Return the metrics of each maintenance in each world, in each scene and, if there are several, over all."""
    head = (
        *(
            "world",
            "scene",
            "maintenance",
            "goals reached",
            "where the usual path is closed",
            "SPL",
            "tries at closed edges, per 100",
            "at closed doors",
        ),
        *("queries until a reopened door is used", "Brier now", "in an hour", "edges lost", "nodes", "collisions"),
        *("queries", "seeds"),
    )
    body = tuple(_line(*group) for group in world_groups(results))
    caption = (
        "Goals reached with 95 % interval, then only of goals whose shortest path is at least half a metre longer "
        "than in the original scene, with their number; SPL against the shortest path at that time. Brier: squared "
        "error of predicted presence, over the edges that the world ever closes. Nodes: before and after all queries."
    )
    return ReportTable(caption=caption, head=head, rows=body, words=3)


def world_run_table(results: Sequence[Run]) -> ReportTable:
    """Return the commands and versions behind all results."""
    head = ("world", "scenes", "maintenance", "seeds", "version", "command")
    rows = ((_origin(each), _place(each)) for each in _sorted(results))
    body = tuple((world, *cells, version, command) for (world, version, command), cells in merged_rows(rows))
    return ReportTable(caption="Command that repeats each result.", head=head, rows=body, words=6)


def world_groups(results: Sequence[Run]) -> Iterator[tuple[str, str, Sequence[Run]]]:
    """Yield world, scene and the results of one maintenance there, in the order of the table."""
    ordered = _sorted(results)
    for world in dict.fromkeys(map(_world, ordered)):
        here = [result for result in ordered if _world(result) == world]
        scenes = list(dict.fromkeys(result.columns.scene for result in here))
        for scene in (*([ALL_SCENES] if len(scenes) > 1 else []), *scenes):
            there = [result for result in here if scene in (ALL_SCENES, result.columns.scene)]
            for name in dict.fromkeys(_maintenance(result) for result in there):
                yield world, scene, [result for result in there if _maintenance(result) == name]


def _sorted(results: Iterable[Run]) -> list[Run]:
    order = {name: place for place, name in enumerate(MAINTENANCE_NAMES)}

    def key(result: Run) -> tuple[object, ...]:
        columns = result.columns
        return _world(result), order.get(_maintenance(result), 99), columns.scene, columns.seed

    return sorted(results, key=key)


def _origin(result: Run) -> tuple[str, str, str]:
    return _world(result), result.maps[0].version, result.maps[0].command


def _place(result: Run) -> tuple[str, str, str]:
    return scene_name(result.columns.scene), _maintenance(result), str(result.columns.seed)


def _world(result: Run) -> str:
    return f"{result.columns.world}, {result.columns.days:g} days"


def _maintenance(result: Run) -> str:
    return result.columns.maintenance or ""


def _line(world: str, scene: str, results: Sequence[Run]) -> tuple[str, ...]:
    found = world_metrics(results)
    seeds = ", ".join(map(str, sorted({result.columns.seed for result in results})))
    return (
        *(world, scene if scene == ALL_SCENES else scene_name(scene), _maintenance(results[0])),
        f"{percent(found.success_rate)} ({100 * found.success_low:.1f} to {100 * found.success_high:.1f})",
        *(_on_detours(found), f"{found.spl:.2f}", f"{found.blocked_tries_per_100:.1f}"),
        *(f"{found.door_tries_per_100:.1f}", _waits(found)),
        *(f"{found.brier:.3f}", f"{found.brier_later:.3f}", percent(found.lost_edges_share, 2)),
        f"{found.nodes_before:,.0f} to {found.nodes:,.0f}",
        *(f"{found.collisions_per_episode:.2f}", f"{found.queries:,}", seeds),
    )


def _waits(found: WorldMetrics) -> str:
    return "–" if found.reopened_after_queries is None else f"{found.reopened_after_queries:.1f} ({found.reopened})"


def _on_detours(found: WorldMetrics) -> str:
    return "–" if found.success_on_detours is None else f"{percent(found.success_on_detours)} ({found.detours})"


def people_table(results: Sequence[Run]) -> ReportTable:
    """Return the encounters with people in each world and scene and, if there are several scenes, over all scenes.

    Worlds without encounters have no row.
    """
    met = [result for result in results if any(query.people.encounters for query in result.queries)]
    body = tuple(_people_line(*group) for group in world_groups(met))
    caption = (
        "An encounter begins when a person is nearer than 1.5 m, from surface to surface as all distances, and ends "
        "beyond 2 m. A touch is avoidable if the robot drove towards the person, and either backwards, or although "
        "its camera had shown the person in the last 3 s and early enough to brake."
    )
    return ReportTable(caption=caption, head=_PEOPLE_HEAD, rows=body, words=3)


def _people_line(world: str, scene: str, results: Sequence[Run]) -> tuple[str, ...]:
    found: WorldMetrics = world_metrics(results)
    people = found.people
    seeds = ", ".join(map(str, sorted({result.columns.seed for result in results})))
    return (
        *(world, scene if scene == ALL_SCENES else scene_name(scene), _maintenance(results[0])),
        *(f"{people.encounters:,}", f"{people.touched:,}", f"{people.avoidable:,}", *_distances(people)),
        *(percent(people.gave_way / people.encounters), f"{people.stood_s / people.encounters:.1f}"),
        *(percent(found.success_rate), f"{found.spl:.2f}", f"{found.queries:,}", seeds),
    )


def _distances(people: EncounterCounts) -> tuple[str, str, str, str]:
    """Return the least distance and its 1 %, 10 % and 50 % quantiles; older results have only the least distance."""
    least = "–" if people.closest_m is None else f"{people.closest_m:.2f}"
    if len(people.closest_each_m) < people.encounters:
        return least, "–", "–", "–"
    one, ten, half = np.quantile(people.closest_each_m, [0.01, 0.1, 0.5])
    return least, f"{one:.2f}", f"{ten:.2f}", f"{half:.2f}"
