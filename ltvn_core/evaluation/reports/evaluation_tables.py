"""The tables of the evaluation, for HTML and Markdown.

Owns the columns and the number format. The numbers come from result rows and lifelong groups.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from math import isnan
from typing import TypeVar

import numpy as np

from ltvn_core.evaluation.confidence_intervals import Estimate
from ltvn_core.evaluation.metrics import compare_methods, recognition_of
from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.evaluation.reports.result_rows import (
    LifelongGroup,
    MaintenanceInterval,
    ResultRow,
    calibration_error,
    calibration_of,
    group_lifelong,
    maintenance_intervals,
    rows_over_scenes,
    scene_name,
    setup_of,
    static_tests,
)
from ltvn_core.evaluation.results import Run, TestedMap

NO_RESULTS = "No results yet."

_Key = TypeVar("_Key", bound=tuple[str, ...])


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


def main_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the metrics of each method in each scene, and then over all scenes."""
    return _metrics_table((*rows_over_scenes(rows), *rows))


def overall_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the metrics of each method over all scenes; the first rows of `main_table`."""
    return _metrics_table(rows_over_scenes(rows) or _of_one_scene(rows))


def _metrics_table(rows: Sequence[ResultRow]) -> ReportTable:
    head = ("scene", "method", "network", "goals reached", "SPL", "collisions", "steps", "nodes", "edges", "spurious")
    body = (
        (*_named(row), _interval(row.success), *_driving(row), *_size(row), _spurious(row), *_sample(row))
        for row in rows
    )
    caption = "Goals reached with 95 % interval. SPL, collisions and steps are means over the episodes."
    return ReportTable(caption=caption, head=(*head, "episodes", "seeds"), rows=tuple(body), words=3)


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


def size_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the sizes of the maps, their spurious edges and components."""
    head = ("scene", "method", "network", "images", "nodes", "edges", "spurious edges", "pieces", "goals connected")
    head = (*head, "goals reported as not in the map (rightly)", "not told")
    body = (
        (
            *_named(row),
            *(_count(row.images), *_size(row), _number(row.metrics.spurious_edges, 1)),
            *(_number(row.metrics.pieces, 1), _number(row.metrics.goals_connected, 1)),
            *_goals(row),
        )
        for row in rows
    )
    return ReportTable(
        caption="Means over the map seeds. Before any drive, the map reports the goals to which it has no path that it "
        "trusts. A report is right if no drivable path leads to the goal from half of the nodes. Not reported: goals "
        "without such a path that the map claims to contain.",
        head=head,
        rows=tuple(body),
        words=3,
    )


def cause_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return the share of the episodes that failed for each cause."""
    head = ("scene", "method", "network", "failed", *(cause.value for cause in FailureCause))
    body = (
        (
            *_named(row),
            percent(1 - row.success.mean),
            *(percent(row.failed(cause)) for cause in FailureCause),
        )
        for row in chain(rows_over_scenes(rows), rows)
    )
    return ReportTable(caption="Share of all episodes.", head=head, rows=tuple(body), words=3)


def recognition_table(rows: Sequence[ResultRow]) -> ReportTable:
    """Return each method's progress towards goals and its wrong recognitions; older results have no row."""
    head = (
        "scene",
        "method",
        "network",
        "checkpoints crossed",
        "localised at a wrong node",
        "wrong arrivals",
    )
    body = (
        (*_named(row), *(percent(share) for share in (found.crossed, found.mislocalised, found.wrong_arrivals)))
        for row in chain(rows_over_scenes(rows), rows)
        if (found := recognition_of(row.trials)) is not None
    )
    caption = (
        "There is a checkpoint at each metre of the path from start to goal; the robot crosses one when it comes "
        "nearer than 0.72 m. A wrong node is farther than 1.5 m or 60 degrees, or behind a wall. Wrong arrivals: "
        "share of those declared."
    )
    return ReportTable(caption=caption, head=head, rows=tuple(body), words=3)


def lifelong_table(lifelong_groups: Iterable[LifelongGroup]) -> ReportTable:
    """Return the static tests of each lifelong group, with the changes by maintenance since the previous test."""
    head = (
        "scene",
        "method",
        "queries",
        "goals reached",
        "SPL",
        "collisions",
        "nodes",
        "edges",
        "spurious",
        "gap of p",
    )
    body = tuple(line for group in lifelong_groups for line in _lifelong_lines(group))
    caption = (
        "Tests with maintenance off. Added and pruned edges are means over the runs, since the previous test. "
        "The gap of p is its mean calibration error."
    )
    return ReportTable(caption=caption, head=(*head, "added", "pruned (bad)", "seeds"), rows=body, words=2)


def run_table(runs: Sequence[Run]) -> ReportTable:
    """Return the commands and versions behind all results, with the weights of each scene and seed."""
    head = ("method", "network", "scenes", "seeds", "weights", "version", "command")
    made = [(*_stage_of(trial), str(trial.columns.seed), *_origin(trial)) for trial in static_tests(runs)]
    made += [_lifelong_run(run) for group in group_lifelong(runs) for run in group.runs]
    rows = (
        ((method, stage, version, command), (scene, seed, weights))
        for scene, method, stage, seed, weights, version, command in made
    )
    body = tuple(
        (method, stage, *cells, version, command) for (method, stage, version, command), cells in merged_rows(rows)
    )
    return ReportTable(caption="Command that repeats each result.", head=head, rows=body, words=7)


def merged_rows(rows: Iterable[tuple[_Key, tuple[str, ...]]]) -> Iterator[tuple[_Key, tuple[str, ...]]]:
    """Yield one row for each key; its cells list the different values in order of appearance, separated by commas."""
    by_key: dict[_Key, list[tuple[str, ...]]] = {}
    for key, cells in rows:
        by_key.setdefault(key, []).append(cells)
    for key, several in by_key.items():
        yield key, tuple(", ".join(dict.fromkeys(column)) for column in zip(*several, strict=True))


def percent(number: float, digits: int = 1) -> str:
    """Write a share as percent."""
    return "–" if isnan(number) else f"{100 * number:.{digits}f} %"


def _lifelong_lines(group: LifelongGroup) -> Iterable[tuple[str, ...]]:
    changes = {interval.until: interval for interval in maintenance_intervals(group)}
    for row in group.points():
        tests = [point for run in group.runs for point in run.maps if point.after == row.setup.queries]
        gap = calibration_error(calibration_of(tests))
        change = changes.get(row.setup.queries)
        done = ("–", "–") if change is None else (_count(change.added_edges), _pruned(change))
        yield (
            *(scene_name(group.scene), group.method, f"{row.setup.queries:,}", _interval(row.success)),
            *(*_driving(row)[:2], *_size(row), _spurious(row), _number(gap, 3), *done, _seeds(row)),
        )


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


def _of_one_scene(rows: Sequence[ResultRow]) -> Sequence[ResultRow]:
    return rows if len({scene for row in rows for scene in row.scenes}) == 1 else ()


def _occasion(row: ResultRow) -> str:
    """Return the stage, and any conditions that were harder than usual."""
    return ", ".join([row.setup.stage, *row.trials[0].columns.conditions])


def _pruned(change: MaintenanceInterval) -> str:
    bad = change.pruned_bad / change.pruned if change.pruned else float("nan")
    return f"{_count(change.pruned)} ({percent(bad, 0)})"


def _named(row: ResultRow) -> tuple[str, str, str]:
    return scene_name(row.setup.scene), row.setup.method, row.setup.stage


def _stage_of(trial: TestedMap) -> tuple[str, str, str]:
    setup = setup_of(trial)
    return scene_name(setup.scene), setup.method, setup.stage


def _origin(trial: TestedMap) -> tuple[str, str, str]:
    return trial.fingerprint, trial.version, trial.command


def _lifelong_run(result: Run) -> tuple[str, ...]:
    trial = result.maps[0]
    queries = f"{len(result.queries):,} queries"
    return (*_stage_of(trial)[:2], queries, str(result.columns.seed), *_origin(trial))


def _driving(row: ResultRow) -> tuple[str, str, str]:
    found = row.metrics
    return _number(found.spl.mean), _number(found.collisions_per_episode.mean), _count(found.steps_per_episode.mean)


def _size(row: ResultRow) -> tuple[str, str]:
    return _count(row.metrics.nodes), _count(row.metrics.edges)


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


def _spurious(row: ResultRow) -> str:
    return percent(row.metrics.spurious_share)


def _sample(row: ResultRow) -> tuple[str, str]:
    return f"{row.metrics.episodes:,}", _seeds(row)


def _seeds(row: ResultRow) -> str:
    return ", ".join(map(str, row.seeds))


def _interval(found: Estimate) -> str:
    return f"{percent(found.mean)} ({100 * found.low:.1f} to {100 * found.high:.1f})"


def _number(number: float, digits: int = 2) -> str:
    return "–" if isnan(number) else f"{number:,.{digits}f}"


def _count(number: float) -> str:
    return f"{number:,.0f}"


def _plain(cell: str) -> str:
    """Return a cell with the special characters of Markdown escaped."""
    return cell.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|").replace("\n", " ")
