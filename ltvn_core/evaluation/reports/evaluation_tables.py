"""The tables of the evaluation, for HTML and Markdown.

A table has a line for each group of results, and its columns are functions of a group. Owns the columns and the number
format. The groups come from `result_rows`.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import TypeAlias, TypeVar

import numpy as np

from ltvn_core.evaluation.metrics import compare_methods, recognition_of
from ltvn_core.evaluation.query_result import EncounterCounts, FailureCause
from ltvn_core.evaluation.reports.result_rows import (
    LifelongGroup,
    ResultRow,
    WorldRow,
    calibration_error,
    calibration_of,
    group_lifelong,
    grouped,
    in_order_of_worlds,
    rows_of,
    rows_over_scenes,
    scene_name,
    setup_of,
    static_tests,
    world_name,
    world_rows,
)
from ltvn_core.evaluation.results import Run, TestedMap

NO_RESULTS = "No results yet."

_Group = TypeVar("_Group")


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table of text cells with a caption."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int
    """Number of columns with text, from the left; the others have numbers."""

    def markdown(self) -> str:
        """Return the table as Markdown, without its caption."""
        if not self.rows:
            return NO_RESULTS
        rule = ["---"] * self.words + ["---:"] * (len(self.head) - self.words)
        return "\n".join(f"| {' | '.join(map(_plain, line))} |" for line in (self.head, rule, *self.rows))


def percent(number: float, digits: int = 1) -> str:
    """Write a share as percent."""
    return "–" if isnan(number) else f"{100 * number:.{digits}f} %"


def _number(number: float, digits: int = 2) -> str:
    return "–" if isnan(number) else f"{number:,.{digits}f}"


def _interval(mean: float, low: float, high: float) -> str:
    return f"{percent(mean)} ({100 * low:.1f} to {100 * high:.1f})"


def _plain(cell: str) -> str:
    """Return a cell with the special characters of Markdown escaped."""
    return cell.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|").replace("\n", " ")


def _table(
    caption: str, groups: Iterable[_Group], columns: Mapping[str, Callable[[_Group], str]], *, words: int = 3
) -> ReportTable:
    rows = tuple(tuple(cell(group) for cell in columns.values()) for group in groups)
    return ReportTable(caption=caption, head=tuple(columns), rows=rows, words=words)


_Columns: TypeAlias = Mapping[str, Callable[[ResultRow], str]]
_NAMES: _Columns = {
    "scene": lambda row: scene_name(row.setup.scene),
    "method": lambda row: row.setup.method,
    "network": lambda row: row.setup.stage,
}
_DRIVING: _Columns = {
    "goals reached": lambda row: _interval(*row.success),
    "SPL": lambda row: _number(row.metrics.spl.mean),
    "collisions": lambda row: _number(row.metrics.collisions_per_episode.mean),
}
_SIZE: _Columns = {
    "nodes": lambda row: _number(row.metrics.nodes, 0),
    "edges": lambda row: _number(row.metrics.edges, 0),
}
_SPURIOUS: _Columns = {"spurious": lambda row: percent(row.metrics.spurious_share)}


def _seeds(row: ResultRow | WorldRow) -> str:
    return ", ".join(map(str, row.seeds))


def main_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the metrics of each method in each scene, and then over all scenes."""
    return _metrics_table((*rows_over_scenes(rows), *rows))


def overall_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the metrics of each method over all scenes; the first rows of `main_table`."""
    return _metrics_table(rows_over_scenes(rows) or _of_one_scene(rows))


def _of_one_scene(rows: Sequence[ResultRow]) -> Sequence[ResultRow]:
    return rows if len({scene for row in rows for scene in row.scenes}) == 1 else ()


def _metrics_table(rows: Sequence[ResultRow]) -> ReportTable:
    return _table(
        "Goals reached with 95 % interval. SPL, collisions and steps are means over the episodes.",
        rows,
        {
            **_NAMES,
            **_DRIVING,
            "steps": lambda row: _number(row.metrics.steps_per_episode.mean, 0),
            **_SIZE,
            **_SPURIOUS,
            "episodes": lambda row: f"{row.metrics.episodes:,}",
            "seeds": _seeds,
        },
    )


def margin_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the difference of the first method to the others at the same stage and conditions, over all scenes."""
    head = ("method", "against", "network", "goals reached, more", "SPL, more", "of its nodes", "of its edges")
    whole = [row for row in rows_over_scenes(rows) or _of_one_scene(rows) if not row.setup.ablated]
    first = {_occasion(row): row for row in whole if row.setup.method == whole[0].setup.method}
    body = tuple(
        _margin(first[_occasion(row)], row)
        for row in whole
        if _occasion(row) in first and row is not first[_occasion(row)]
    )
    caption = (
        "Differences with 95 % interval, episode by episode where both methods drove the same ones. "
        "Nodes and edges: as a share of the other method's."
    )
    return ReportTable(caption=caption, head=head, rows=body, words=3)


def _occasion(row: ResultRow) -> str:
    """Return the stage, and any conditions that were harder than usual."""
    return ", ".join([row.setup.stage, *row.trials[0].columns.conditions])


def _margin(row: ResultRow, other: ResultRow) -> tuple[str, ...]:
    found = compare_methods(row.trials, other.trials)
    points = found.success_rate
    spl = found.spl
    sizes = [(row.metrics.nodes, other.metrics.nodes), (row.metrics.edges, other.metrics.edges)]
    return (
        *(row.setup.method, other.setup.method, _occasion(row)),
        f"{100 * points.mean:+.1f} points ({100 * points.low:+.1f} to {100 * points.high:+.1f})",
        f"{spl.mean:+.2f} ({spl.low:+.2f} to {spl.high:+.2f})",
        *(percent(own / theirs, 1) if theirs else "–" for own, theirs in sizes),
    )


def size_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the sizes of the maps, their spurious edges and components."""
    return _table(
        "Means over the map seeds. Before any drive, the map reports the goals to which it has no path that it "
        "trusts. A report is right if no drivable path leads to the goal from half of the nodes. Not reported: goals "
        "without such a path that the map claims to contain.",
        rows,
        {
            **_NAMES,
            "images": lambda row: _number(float(np.mean([trial.images for trial in row.trials])), 0),
            **_SIZE,
            "spurious edges": lambda row: _number(row.metrics.spurious_edges, 1),
            "pieces": lambda row: _number(row.metrics.pieces, 1),
            "goals connected": lambda row: _number(row.metrics.goals_connected, 1),
            "goals reported as not in the map (rightly)": lambda row: _goals(row)[0],
            "not told": lambda row: _goals(row)[1],
        },
    )


def _goals(row: ResultRow) -> tuple[str, str]:
    """Return two mean numbers as text: of goals reported as doubtful, with the correct reports in brackets, and of
    unreported ones.

    Returns dashes if the results have no such counts.
    """
    maps = [trial.map for trial in row.trials]
    counts = [(each.goals_told, each.goals_told_rightly, each.goals_untold) for each in maps]
    known = [[number for number in count if number is not None] for count in counts]
    if not all(len(count) == len(counts[0]) for count in known):
        return "–", "–"
    told, rightly, untold = np.mean(known, axis=0)
    return f"{_number(told, 1)} ({_number(rightly, 1)})", _number(untold, 1)


def cause_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the share of the episodes that failed for each cause."""
    causes: _Columns = {cause.value: lambda row, cause=cause: percent(row.failed(cause)) for cause in FailureCause}
    columns = {**_NAMES, "failed": lambda row: percent(1 - row.success.mean), **causes}
    return _table("Share of all episodes.", (*rows_over_scenes(rows), *rows), columns)


def recognition_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return each method's progress towards goals and its wrong recognitions; older results have no row."""
    columns: Mapping[str, Callable[[ResultRow], str]] = _NAMES
    body = (
        (
            *(cell(row) for cell in columns.values()),
            *(percent(share) for share in (found.crossed, found.mislocalised, found.wrong_arrivals)),
        )
        for row in (*rows_over_scenes(rows), *rows)
        if (found := recognition_of(row.trials)) is not None
    )
    return ReportTable(
        caption="There is a checkpoint at each metre of the path from start to goal; the robot crosses one when it "
        "comes nearer than 0.72 m. A wrong node is farther than 1.5 m or 60 degrees, or behind a wall. Wrong "
        "arrivals: share of those declared.",
        head=(*columns, "checkpoints crossed", "localised at a wrong node", "wrong arrivals"),
        rows=tuple(body),
        words=3,
    )


def lifelong_table(lifelong_groups: Iterable[LifelongGroup]) -> ReportTable:
    """Return the static tests of each lifelong group, with the changes by maintenance since the previous test."""
    return _table(
        "Tests with maintenance off. Added and pruned edges are means over the runs, since the previous test. "
        "The gap of p is its mean calibration error.",
        (row for group in lifelong_groups for row in group.points()),
        {
            "scene": _NAMES["scene"],
            "method": _NAMES["method"],
            "queries": lambda row: f"{row.setup.queries:,}",
            **_DRIVING,
            **_SIZE,
            **_SPURIOUS,
            "gap of p": lambda row: _number(calibration_error(calibration_of(row.trials)), 3),
            "added": lambda row: "–" if row.change is None else _number(row.change.added_edges, 0),
            "pruned (bad)": _pruned,
            "seeds": _seeds,
        },
        words=2,
    )


def _pruned(row: ResultRow) -> str:
    if (change := row.change) is None:
        return "–"
    bad = change.pruned_bad / change.pruned if change.pruned else float("nan")
    return f"{_number(change.pruned, 0)} ({percent(bad, 0)})"


def run_table(runs: Sequence[Run]) -> ReportTable:
    """Return the commands and versions behind all results, with the weights of each scene and seed."""
    made = [(trial, setup_of(trial).stage) for trial in static_tests(runs)]
    made += [(run.maps[0], f"{len(run.queries):,} queries") for each in group_lifelong(runs) for run in each.runs]
    return _merged_table(
        ("method", "network", "scenes", "seeds", "weights", "version", "command"),
        [_origin(trial, network) for trial, network in made],
        merged=("scenes", "seeds", "weights"),
    )


def _origin(trial: TestedMap, network: str) -> tuple[str, ...]:
    setup = setup_of(trial)
    seed = str(trial.columns.seed)
    return setup.method, network, scene_name(setup.scene), seed, trial.fingerprint, trial.version, trial.command


def _merged_table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]], *, merged: Collection[str]) -> ReportTable:
    """Return one line for all rows that differ only in `merged` columns; these list their values, with commas."""
    kept = [place for place, name in enumerate(head) if name not in merged]
    groups = grouped(rows, lambda row: tuple(row[place] for place in kept))
    body = tuple(
        tuple(", ".join(dict.fromkeys(cells)) for cells in zip(*each, strict=True)) for each in groups.values()
    )
    return ReportTable(caption="Command that repeats each result.", head=head, rows=body, words=len(head))


_WORLD_NAMES: Mapping[str, Callable[[WorldRow], str]] = {
    "world": lambda row: row.world,
    "scene": lambda row: row.scene,
    "maintenance": lambda row: row.maintenance,
}
_WORLD_SAMPLE: Mapping[str, Callable[[WorldRow], str]] = {
    "queries": lambda row: f"{row.metrics.queries:,}",
    "seeds": _seeds,
}


def world_table(runs: Sequence[Run]) -> ReportTable:
    """Return the metrics of each maintenance in each world, in each scene and, if there are several, over all."""
    return _table(
        "Goals reached with 95 % interval, then only of goals whose shortest path is at least half a metre longer "
        "than in the original scene, with their number; SPL against the shortest path at that time. Brier: squared "
        "error of predicted presence, over the edges that the world ever closes. Nodes: before and after all queries.",
        world_rows(runs),
        {
            **_WORLD_NAMES,
            "goals reached": lambda row: _interval(
                row.metrics.success_rate, row.metrics.success_low, row.metrics.success_high
            ),
            "where the usual path is closed": lambda row: (
                "–"
                if row.metrics.success_on_detours is None
                else f"{percent(row.metrics.success_on_detours)} ({row.metrics.detours})"
            ),
            "SPL": lambda row: f"{row.metrics.spl:.2f}",
            "tries at closed edges, per 100": lambda row: f"{row.metrics.blocked_tries_per_100:.1f}",
            "at closed doors": lambda row: f"{row.metrics.door_tries_per_100:.1f}",
            "queries until a reopened door is used": lambda row: (
                "–"
                if row.metrics.reopened_after_queries is None
                else f"{row.metrics.reopened_after_queries:.1f} ({row.metrics.reopened})"
            ),
            "Brier now": lambda row: f"{row.metrics.brier:.3f}",
            "in an hour": lambda row: f"{row.metrics.brier_later:.3f}",
            "edges lost": lambda row: percent(row.metrics.lost_edges_share, 2),
            "nodes": lambda row: f"{row.metrics.nodes_before:,.0f} to {row.metrics.nodes:,.0f}",
            "collisions": lambda row: f"{row.metrics.collisions_per_episode:.2f}",
            **_WORLD_SAMPLE,
        },
    )


def people_table(runs: Sequence[Run]) -> ReportTable:
    """Return the encounters with people in each world and scene and, if there are several scenes, over all scenes.

    Worlds without encounters have no row.
    """
    return _table(
        "An encounter begins when a person is nearer than 1.5 m, from surface to surface as all distances, and ends "
        "beyond 2 m. A touch is avoidable if the robot drove towards the person, and either backwards, or although "
        "its camera had shown the person in the last 3 s and early enough to brake.",
        world_rows(run for run in runs if any(query.people.encounters for query in run.queries)),
        {
            **_WORLD_NAMES,
            "encounters": lambda row: f"{row.metrics.people.encounters:,}",
            "touches": lambda row: f"{row.metrics.people.touched:,}",
            "avoidable touches": lambda row: f"{row.metrics.people.avoidable:,}",
            "closest, m": lambda row: (
                "–" if row.metrics.people.closest_m is None else f"{row.metrics.people.closest_m:.2f}"
            ),
            "1 % nearer than, m": lambda row: _nearer_than(row.metrics.people, 0.01),
            "10 %, m": lambda row: _nearer_than(row.metrics.people, 0.1),
            "half, m": lambda row: _nearer_than(row.metrics.people, 0.5),
            "people gave way": lambda row: percent(row.metrics.people.gave_way / row.metrics.people.encounters),
            "stood still, s each": lambda row: f"{row.metrics.people.stood_s / row.metrics.people.encounters:.1f}",
            "goals reached": lambda row: percent(row.metrics.success_rate),
            "SPL": lambda row: f"{row.metrics.spl:.2f}",
            **_WORLD_SAMPLE,
        },
    )


def _nearer_than(people: EncounterCounts, share: float) -> str:
    """Return the distance below which this share of the encounters came; older results do not tell."""
    if len(people.closest_each_m) < people.encounters:
        return "–"
    return f"{np.quantile(people.closest_each_m, share):.2f}"


def world_run_table(runs: Sequence[Run]) -> ReportTable:
    """Return the commands and versions behind all results."""
    rows: list[tuple[str, ...]] = []
    for run in in_order_of_worlds(runs):
        columns, first = run.columns, run.maps[0]
        place = world_name(run), scene_name(columns.scene), columns.maintenance or "", str(columns.seed)
        rows.append((*place, first.version, first.command))
    head = ("world", "scenes", "maintenance", "seeds", "version", "command")
    return _merged_table(head, rows, merged=("scenes", "maintenance", "seeds"))


def report_tables(runs: Sequence[Run]) -> dict[str, ReportTable]:
    """Return all tables by name."""
    worlds = [run for run in runs if run.columns.world]
    rows = rows_of(runs)
    return {
        "main": main_table(rows),
        "margins": margin_table(rows),
        "sizes": size_table(rows),
        "causes": cause_table(rows),
        "recognition": recognition_table(rows),
        "lifelong": lifelong_table(group_lifelong(runs)),
        "runs": run_table(runs),
        "worlds": world_table(worlds),
        "people": people_table(worlds),
        "world-runs": world_run_table(worlds),
    }
