"""A map over its scene as one HTML page that asks nothing of any other machine. Owns the page around the figure."""

from html import escape
from importlib.resources import files
from string import Template

from ltvn_core.evaluate.scene_plan import ScenePlan
from ltvn_core.report.scene_svg import SceneColours, scene_svg


def scene_page(drawn: ScenePlan, colours: SceneColours) -> str:
    """Return a page to look at with a mouse: drag, zoom, and point at nodes and edges for their numbers."""
    graph, wrong = drawn.graph, sum(spurious for *_, spurious in drawn.plan.edges)
    template = Template(files("ltvn_core.report").joinpath("templates/scene.html").read_text(encoding="utf-8"))
    key = f'<span><span class="wrong"></span> nobody can drive it: {wrong}</span>' if drawn.simulated else ""
    return template.substitute(
        title=escape(drawn.title),
        counts=f"{len(graph.nodes):,} nodes, {len(graph.edges):,} edges",
        ramp=", ".join(colours.ramp),
        spurious=colours.spurious,
        ground=colours.ground,
        text=colours.text,
        wrong=key,
        svg=scene_svg(drawn, colours),
    )
