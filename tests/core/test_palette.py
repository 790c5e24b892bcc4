"""What a colour means is the same in the page, the Rerun viewer, an exported map and a report."""

import re

import pytest
import rerun as rr

from ltvn_core import palette
from ltvn_core.evaluation.map_layout import map_layout
from ltvn_core.graph.deltas import Belief, Edge, Node, PoseRow
from ltvn_core.recording.drawn_poses import DrawnPoses
from ltvn_core.recording.map_drawing import draw_graph
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.schema import EDGES
from ltvn_core.reports.evaluation_style import probability_colour_map
from ltvn_core.reports.map_svg import map_svg
from tests.repository import DEMO_DRIVE, ROOT

ONE_PLACE = "ltvn_core/palette.py"
ORANGE, BLUE = (235, 90, 10), (25, 115, 250)


def rerun_edge_colour(p: float) -> tuple[int, ...]:
    nodes = [Node(number, PoseRow(float(number), 0.0, 0.0)) for number in (0, 1)]
    poses = DrawnPoses()
    for node in nodes:
        poses.add_node(node)
    drawn = draw_graph(nodes, [Edge(0, 1, PoseRow(1.0, 0.0, 0.0), Belief(p, 1.0, 0.1))], [], poses)
    (strips,) = (
        part for row in drawn if row.entity == EDGES for part in row.values if isinstance(part, rr.LineStrips3D)
    )
    assert strips.colors is not None
    packed = int(strips.colors.as_arrow_array()[0].as_py())
    return packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255


@pytest.mark.parametrize(("p", "colour"), [(0.0, ORANGE), (1.0, BLUE)])
def test_certain_edges_have_one_colour_in_page_rerun_and_report(p: float, colour: tuple[int, ...]) -> None:
    assert tuple(palette.probability_colours([p])[0].tolist()) == colour
    assert rerun_edge_colour(p) == colour
    assert tuple(round(255 * part) for part in probability_colour_map()(p)[:3]) == colour


def test_an_exported_map_draws_edges_in_the_colours_of_the_page() -> None:
    drawn = map_layout(Recording.open(DEMO_DRIVE))
    page = {tuple(palette.probability_colours([edge.belief.p])[0].tolist()) for edge in drawn.graph.edges.values()}

    figure = {tuple(map(int, rgb.split(","))) for rgb in re.findall(r'stroke="rgb\(([\d,]+)\)"', map_svg(drawn))}

    assert figure
    assert figure <= page


def test_no_other_module_mixes_colours_for_probabilities() -> None:
    red_of_ramp = re.compile(r"235,\s*90,\s*10\b|25,\s*115,\s*250\b|0,\s*158,\s*115\b|213,\s*94,\s*0\b")
    modules = [path for package in ("ltvn_core", "ltvn_viz") for path in (ROOT / package).rglob("*.py")]

    assert [path.relative_to(ROOT).as_posix() for path in modules if red_of_ramp.search(path.read_text())] == [
        ONE_PLACE
    ]
