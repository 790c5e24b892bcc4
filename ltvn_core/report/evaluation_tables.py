"""The tables of the evaluation, for an HTML page and for Markdown alike.

Owns their columns and how numbers are written. The numbers come in rows and courses.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from math import isnan

from ltvn_core.evaluate.results import Failure, LifelongResult, Results, TrialResult
from ltvn_core.report.evaluation_courses import Course, calibration_error, stretches
from ltvn_core.report.evaluation_rows import Interval, Row, rows_over_scenes, scene_name, setup_of

NOTHING = "No results yet."


@dataclass(frozen=True, slots=True)
class Table:
    """Cells as they are read."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int
    """How many columns, from the left, hold words; the others hold numbers."""

    def markdown(self) -> str:
        """Return the table as Markdown, without its caption."""
        if not self.rows:
            return NOTHING
        rule = ["---"] * self.words + ["---:"] * (len(self.head) - self.words)
        return "\n".join(f"| {' | '.join(map(_plain, line))} |" for line in (self.head, rule, *self.rows))


def main_table(rows: Sequence[Row]) -> Table:
    """Return what each method reached in each scene, and then over all scenes."""
    head = ("scene", "method", "network", "goals reached", "SPL", "collisions", "steps", "nodes", "edges", "spurious")
    body = (
        (*_named(row), _interval(row.success), *_driving(row), *_size(row), share(row.spurious), *_sample(row))
        for row in chain(rows, rows_over_scenes(rows))
    )
    caption = "Goals reached with 95 % interval. SPL, collisions and steps are means over the episodes."
    return Table(caption, (*head, "episodes", "seeds"), tuple(body), 3)


def size_table(rows: Sequence[Row]) -> Table:
    """Return how large the maps are, and how whole."""
    head = ("scene", "method", "network", "images", "nodes", "edges", "spurious edges", "pieces", "goals connected")
    body = (
        (
            *_named(row),
            *(_count(sum(trial.images for trial in row.trials) / len(row.trials)), *_size(row)),
            *(f"{row.per_map(name):,.1f}" for name in ("spurious_edges", "pieces", "goals_connected")),
        )
        for row in rows
    )
    return Table("Means over the map seeds.", head, tuple(body), 3)


def cause_table(rows: Sequence[Row]) -> Table:
    """Return what share of the episodes failed for each cause."""
    head = ("scene", "method", "network", "failed", *(cause.value for cause in Failure))
    body = (
        (
            *_named(row),
            share(sum(map(row.failed, Failure)) / max(row.episodes, 1)),
            *(share(row.failed(cause) / max(row.episodes, 1)) for cause in Failure),
        )
        for row in chain(rows, rows_over_scenes(rows))
    )
    return Table("Share of all episodes.", head, tuple(body), 3)


def lifelong_table(courses: Iterable[Course]) -> Table:
    """Return each course's tests, with what maintenance did since the test before."""
    head = ("scene", "method", "queries", "goals reached", "SPL", "collisions", "nodes", "edges", "spurious", "gap of p")
    body = tuple(line for course in courses for line in _course(course))
    caption = (
        "Tests with maintenance off. Added and pruned edges are means over the runs, since the test before. "
        "The gap of p is its mean calibration error."
    )
    return Table(caption, (*head, "added", "pruned", "of them bad", "seeds"), body, 2)


def run_table(results: Results) -> Table:
    """Return the command, version and weights behind each result."""
    head = ("scene", "method", "network", "seed", "weights", "version", "command")
    body = [(*_stage_of(trial), str(trial.seed), *_origin(trial)) for trial in results.trials]
    body += [_lifelong_run(result) for result in results.lifelong if result.points]
    return Table("What makes each result again.", head, tuple(body), 7)


def share(number: float, digits: int = 1) -> str:
    """Write a share as percent."""
    return "–" if isnan(number) else f"{100 * number:.{digits}f} %"


def _course(course: Course) -> Iterable[tuple[str, ...]]:
    changes = {stretch.until: stretch for stretch in stretches(course)}
    for row in course.points():
        cells = [p for run in course.runs for p in run.points if p.queries == row.setup.queries]
        gap = calibration_error([cell for point in cells for cell in point.calibration])
        change = changes.get(row.setup.queries)
        done = ("–", "–", "–")
        if change is not None:
            bad = share(change.pruned_bad / change.pruned if change.pruned else float("nan"))
            done = (_count(change.added_edges), _count(change.pruned), bad)
        yield (
            *(scene_name(course.scene), course.method, f"{row.setup.queries:,}", _interval(row.success)),
            *(_number(row.per_episode("spl")), _number(row.per_episode("collisions")), *_size(row)),
            *(share(row.spurious), _number(gap, 3), *done, _seeds(row)),
        )


def _named(row: Row) -> tuple[str, str, str]:
    return scene_name(row.setup.scene), row.setup.method, row.setup.stage


def _stage_of(trial: TrialResult) -> tuple[str, str, str]:
    setup = setup_of(trial)
    return scene_name(setup.scene), setup.method, setup.stage


def _origin(trial: TrialResult) -> tuple[str, str, str]:
    return trial.fingerprint, trial.version, trial.command


def _lifelong_run(result: LifelongResult) -> tuple[str, ...]:
    trial, queries = result.points[0].trial, f"{len(result.queries):,} queries"
    return (*_stage_of(trial)[:2], queries, str(result.seed), trial.fingerprint, result.version, result.command)


def _driving(row: Row) -> tuple[str, ...]:
    steps = _count(row.per_episode("steps"))
    return _number(row.per_episode("spl")), _number(row.per_episode("collisions")), steps


def _size(row: Row) -> tuple[str, str]:
    return _count(row.per_map("nodes")), _count(row.per_map("edges"))


def _sample(row: Row) -> tuple[str, str]:
    return f"{row.episodes:,}", _seeds(row)


def _seeds(row: Row) -> str:
    return ", ".join(map(str, row.seeds))


def _interval(found: Interval) -> str:
    if isnan(found.mean):
        return "–"
    return f"{share(found.mean)} ({100 * found.low:.1f} to {100 * found.high:.1f})"


def _number(number: float, digits: int = 2) -> str:
    return "–" if isnan(number) else f"{number:.{digits}f}"


def _count(number: float) -> str:
    return "–" if isnan(number) else f"{number:,.0f}"


def _plain(cell: str) -> str:
    """Return a cell so that Markdown takes nothing in it for its own."""
    return cell.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|").replace("\n", " ")
