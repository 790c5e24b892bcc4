"""All pictures of one report. Owns which there are, their names and the words below them."""

from collections.abc import Iterable, Sequence
from functools import partial
from itertools import chain

from ltvn_core.evaluate.results import Results
from ltvn_core.report.evaluation_bars import causes, sizes, success
from ltvn_core.report.evaluation_courses import Course, courses_of
from ltvn_core.report.evaluation_curves import calibration, lifelong
from ltvn_core.report.evaluation_floors import Panel, floors
from ltvn_core.report.evaluation_rows import Row, rows_of, rows_over_scenes, scene_name, scenes_of
from ltvn_core.report.evaluation_style import Picture, slug
from ltvn_core.report.style import Ink


def pictures_of(results: Results, ink: Ink) -> tuple[Picture, ...]:
    """Return all pictures that the results allow, not yet drawn."""
    rows, courses = rows_of(results.trials), courses_of(results.lifelong)
    return tuple(chain(_of_rows(rows, ink), _of_maps(rows, ink), _of_courses(courses, ink)))


def _of_rows(rows: Sequence[Row], ink: Ink) -> Iterable[Picture]:
    whole = [row for row in rows if not row.setup.ablated and not row.setup.queries]
    parts = [row for row in rows if not row.setup.queries and row.setup.scene in _ablated_scenes(rows)]
    if whole:
        caption = "Goals reached, with 95 % intervals."
        if len({row.setup.finetuned for row in whole}) > 1:
            caption += " Rings: network as trained. Discs: after fine-tuning on the drive."
        yield Picture("success", "success", "Success per scene and method", caption, partial(success, whole, ink))
        caption = "Nodes and edges of the maps: mean of the map seeds, and from the smallest to the largest."
        yield Picture("sizes", "sizes", "Nodes and edges per scene and method", caption, partial(sizes, whole, ink))
    if parts:
        caption = "Goals reached when single parts of the method are switched off, with 95 % intervals."
        yield Picture("success", "ablation", "What each part is worth", caption, partial(success, parts, ink))
    if whole:
        over = rows_over_scenes(whole) or whole
        caption = "Share of the episodes that failed, by the one cause that each failure is put down to."
        yield Picture("causes", "causes", "Causes of failure over all scenes", caption, partial(causes, over, ink))


def _of_maps(rows: Sequence[Row], ink: Ink) -> Iterable[Picture]:
    """Draw the maps of each scene's first seed."""
    drawn = [row for row in rows if row.trials[0].floorplan is not None and not row.setup.ablated]
    for scene in scenes_of(drawn):
        panels = [
            Panel(f"{row.setup.method}, {row.setup.stage}", row.trials[0]) for row in drawn if row.setup.scene == scene
        ]
        title = f"Maps of {scene_name(scene)}"
        caption = (
            f"Map seed {panels[0].trial.seed}. Grey: where no robot fits. Red crosses: edges that nobody can drive."
        )
        yield Picture("floors", f"floors-{slug(scene_name(scene))}", title, caption, partial(floors, panels, ink))


def _of_courses(courses: Sequence[Course], ink: Ink) -> Iterable[Picture]:
    for course in courses:
        name = f"{slug(scene_name(course.scene))}-{slug(course.method)}"
        title = f"{course.method} in {scene_name(course.scene)}"
        several = len(course.runs) > 1
        caption = (
            f"Goals reached with maintenance off, with 95 % interval{'; thin lines are single maps' * several}. "
            f"Below: edges added and pruned{', means of the runs' * several}; red are those that nobody can drive."
        )
        yield Picture("lifelong", f"lifelong-{name}", title, caption, partial(lifelong, course, ink))
        yield from _before_and_after(course, name, ink)
    if any(point.calibration for course in courses for run in course.runs for point in run.points):
        caption = "A point on the dashed line means: of edges with this p, just that share can be driven."
        yield Picture("calibration", "calibration", "Can p be believed?", caption, partial(calibration, courses, ink))


def _before_and_after(course: Course, name: str, ink: Ink) -> Iterable[Picture]:
    first, last = course.runs[0].points[0], course.runs[0].points[-1]
    if first is last or first.trial.floorplan is None or last.trial.floorplan is None:
        return
    panels = [Panel(f"after {point.queries:,} queries", point.trial) for point in (first, last)]
    caption = f"Map seed {course.runs[0].seed}, before and after maintenance. Red crosses: edges that nobody can drive."
    title = f"The map of {scene_name(course.scene)} before and after"
    yield Picture("lifelong", f"map-{name}", title, caption, partial(floors, panels, ink))


def _ablated_scenes(rows: Sequence[Row]) -> set[str]:
    return {row.setup.scene for row in rows if row.setup.ablated}
