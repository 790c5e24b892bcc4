"""The table of people met in changing worlds: how near the robot came, whom it touched, and how long it waited."""

from collections.abc import Sequence

import numpy as np

from ltvn_core.evaluation.query_result import EncounterCounts
from ltvn_core.evaluation.results import WorldResult
from ltvn_core.evaluation.worlds.world_metrics import WorldMetrics, world_metrics
from ltvn_core.reports.evaluation_tables import ReportTable, percent
from ltvn_core.reports.result_rows import scene_name
from ltvn_core.reports.world_table import ALL_SCENES, world_groups

_HEAD = (
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


def people_table(results: Sequence[WorldResult]) -> ReportTable:
    """Return the encounters in each world, over all scenes where there are several and in each; none of empty ones."""
    met = [result for result in results if any(query.people.encounters for query in result.queries)]
    body = tuple(_line(*group) for group in world_groups(met))
    caption = (
        "An encounter begins when a person is nearer than 1.5 m, from surface to surface as all distances, and ends "
        "beyond 2 m. A touch is avoidable where the robot drove towards the person, and either backwards, or although "
        "its camera had shown the person in the last 3 s and early enough to brake."
    )
    return ReportTable(caption=caption, head=_HEAD, rows=body, words=3)


def _line(world: str, scene: str, results: Sequence[WorldResult]) -> tuple[str, ...]:
    found: WorldMetrics = world_metrics(results)
    people = found.people
    seeds = ", ".join(map(str, sorted({result.seed for result in results})))
    return (
        *(world, scene if scene == ALL_SCENES else scene_name(scene), results[0].maintenance),
        *(f"{people.encounters:,}", f"{people.touched:,}", f"{people.avoidable:,}", *_distances(people)),
        *(percent(people.gave_way / people.encounters), f"{people.stood_s / people.encounters:.1f}"),
        *(percent(found.success_rate), f"{found.spl:.2f}", f"{found.queries:,}", seeds),
    )


def _distances(people: EncounterCounts) -> tuple[str, str, str, str]:
    """Return least distance, and the quantiles of 1, 10 and 50 %; older results know the first alone."""
    least = "–" if people.closest_m is None else f"{people.closest_m:.2f}"
    if len(people.closest_each_m) < people.encounters:
        return least, "–", "–", "–"
    one, ten, half = np.quantile(people.closest_each_m, [0.01, 0.1, 0.5])
    return least, f"{one:.2f}", f"{ten:.2f}", f"{half:.2f}"
