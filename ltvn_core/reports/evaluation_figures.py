"""The figures of an evaluation report, with their names, titles and captions."""

from collections.abc import Iterable, Sequence
from functools import partial
from itertools import chain

from ltvn_core.evaluation.results import EvaluationResults
from ltvn_core.reports.evaluation_style import ReportFigure, slug
from ltvn_core.reports.figure_style import FigurePalette
from ltvn_core.reports.lifelong_figures import edge_calibration_figure, lifelong_figure
from ltvn_core.reports.lifelong_groups import LifelongGroup, group_lifelong
from ltvn_core.reports.map_figures import MapPanel, map_figure
from ltvn_core.reports.method_figures import cause_figure, size_figure, success
from ltvn_core.reports.result_rows import ResultRow, rows_of, rows_over_scenes, scene_name, scenes_of


def figures_of(results: EvaluationResults, palette: FigurePalette) -> tuple[ReportFigure, ...]:
    """Yield all figures for which there are results, not yet drawn."""
    rows = rows_of(results.trials)
    lifelong_groups = group_lifelong(results.lifelong)
    return tuple(
        chain(_row_figures(rows, palette), _map_figures(rows, palette), _lifelong_figures(lifelong_groups, palette))
    )


def _row_figures(rows: Sequence[ResultRow], palette: FigurePalette) -> Iterable[ReportFigure]:
    whole = [row for row in rows if not row.setup.ablated and not row.setup.queries]
    parts = [row for row in rows if not row.setup.queries and row.setup.scene in _ablated_scenes(rows)]
    if whole:
        caption = "Goals reached, with 95 % intervals."
        if len({row.setup.finetuned for row in whole}) > 1:
            caption += " Rings: network as trained. Discs: after fine-tuning on the drive."
        yield ReportFigure(
            kind="success",
            name="success",
            title="Success per scene and method",
            caption=caption,
            draw=partial(success, whole, palette),
        )
        caption = "Nodes and edges of the maps: mean of the map seeds, and from the smallest to the largest."
        yield ReportFigure(
            kind="sizes",
            name="sizes",
            title="Nodes and edges per scene and method",
            caption=caption,
            draw=partial(size_figure, whole, palette),
        )
    if parts:
        caption = "Goals reached when single parts of the method are switched off, with 95 % intervals."
        yield ReportFigure(
            kind="success",
            name="ablation",
            title="What each part is worth",
            caption=caption,
            draw=partial(success, parts, palette),
        )
    if whole:
        over = rows_over_scenes(whole) or whole
        caption = "Share of the episodes that failed, by the one cause that each failure is put down to."
        yield ReportFigure(
            kind="causes",
            name="causes",
            title="Causes of failure over all scenes",
            caption=caption,
            draw=partial(cause_figure, over, palette),
        )


def _map_figures(rows: Sequence[ResultRow], palette: FigurePalette) -> Iterable[ReportFigure]:
    """Draw the maps of each scene's first seed."""
    drawn = [row for row in rows if row.trials[0].floorplan is not None and not row.setup.ablated]
    for scene in scenes_of(drawn):
        panels = [
            MapPanel(f"{row.setup.method}, {row.setup.stage}", row.trials[0])
            for row in drawn
            if row.setup.scene == scene
        ]
        title = f"Maps of {scene_name(scene)}"
        caption = f"Map seed {panels[0].trial.seed}. Grey: where no robot fits. Red crosses: spurious edges."
        yield ReportFigure(
            kind="floors",
            name=f"floors-{slug(scene_name(scene))}",
            title=title,
            caption=caption,
            draw=partial(map_figure, panels, palette),
        )


def _lifelong_figures(lifelong_groups: Sequence[LifelongGroup], palette: FigurePalette) -> Iterable[ReportFigure]:
    for group in lifelong_groups:
        name = f"{slug(scene_name(group.scene))}-{slug(group.method)}"
        title = f"{group.method} in {scene_name(group.scene)}"
        several = len(group.runs) > 1
        caption = (
            f"Goals reached with maintenance off, with 95 % interval{'; thin lines are single maps' * several}. "
            f"Below: edges added and pruned{', means of the runs' * several}; red are the spurious ones."
        )
        yield ReportFigure(
            kind="lifelong",
            name=f"lifelong-{name}",
            title=title,
            caption=caption,
            draw=partial(lifelong_figure, group, palette),
        )
        yield from _before_and_after(group, name, palette)
    if any(point.calibration for group in lifelong_groups for run in group.runs for point in run.points):
        caption = "A point on the dashed line means: of edges with this p, just that share can be driven."
        yield ReportFigure(
            kind="calibration",
            name="calibration",
            title="Can p be believed?",
            caption=caption,
            draw=partial(edge_calibration_figure, lifelong_groups, palette),
        )


def _before_and_after(group: LifelongGroup, name: str, palette: FigurePalette) -> Iterable[ReportFigure]:
    first, last = group.runs[0].points[0], group.runs[0].points[-1]
    if first is last or first.trial.floorplan is None or last.trial.floorplan is None:
        return
    panels = [MapPanel(f"after {point.queries:,} queries", point.trial) for point in (first, last)]
    caption = f"Map seed {group.runs[0].seed}, before and after maintenance. Red crosses: spurious edges."
    title = f"The map of {scene_name(group.scene)} before and after"
    yield ReportFigure(
        kind="lifelong", name=f"map-{name}", title=title, caption=caption, draw=partial(map_figure, panels, palette)
    )


def _ablated_scenes(rows: Sequence[ResultRow]) -> set[str]:
    return {row.setup.scene for row in rows if row.setup.ablated}
