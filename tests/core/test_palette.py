"""What a colour means is the same in the page, the Rerun viewer, an exported map and a report."""

import re

import cv2
import numpy as np
import pytest
import rerun as rr
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.data.recording.drawn_poses import DrawnPoses
from ltvn_core.data.recording.map_drawing import MapDrawing
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.schema import EDGES
from ltvn_core.evaluation.reports.figure_style import probability_colour_map
from ltvn_core.evaluation.reports.map_svg import map_layout, map_svg
from ltvn_core.graph.deltas import Belief, Edge, Node, PoseRow
from tests.repository import DEMO_DRIVE, ROOT

ONE_PLACE = "ltvn_core/palette.py"
ORANGE, BLUE = (235, 90, 10), (25, 115, 250)


def rerun_edge_colour(p: float) -> tuple[int, ...]:
    nodes = [Node(number, PoseRow(float(number), 0.0, 0.0)) for number in (0, 1)]
    poses = DrawnPoses()
    for node in nodes:
        poses.add_node(node)
    drawn = MapDrawing().draw(nodes, [Edge(0, 1, PoseRow(1.0, 0.0, 0.0), Belief(p, 1.0, 0.1))], [], poses)
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

    assert [
        path.relative_to(ROOT).as_posix() for path in modules if red_of_ramp.search(path.read_text(encoding="utf-8"))
    ] == [ONE_PLACE]


MACHADO_2009 = {
    "normal sight": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""What is left of linear RGB for each kind of sight: Machado et al. 2009, severity 1."""

EASILY_TOLD_APART = 20.0
"""A difference in CIE Lab; 2 can be seen side by side, 10 at a glance."""


def seen_as_lab(colour: tuple[int, int, int], sight: str) -> NDArray[np.float64]:
    linear = np.clip(MACHADO_2009[sight] @ (np.array(colour) / 255) ** 2.2, 0, 1).astype(np.float32)
    return cv2.cvtColor((linear ** (1 / 2.2))[None, None], cv2.COLOR_RGB2LAB)[0, 0].astype(np.float64)


@pytest.mark.parametrize("sight", MACHADO_2009)
@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("EDGE_ADDED", "EDGE_REMOVED"),
        ("EDGE_REMOVED", "PROBABILITY_0"),
        ("EDGE_REMOVED", "PROBABILITY_1"),
        ("EDGE_ADDED", "PROBABILITY_0"),
        ("EDGE_ADDED", "PROBABILITY_1"),
        ("PROBABILITY_0", "PROBABILITY_1"),
        ("NODE", "LOCALISED"),
        ("NODE", "GOAL"),
        ("LOCALISED", "GOAL"),
        ("EDGE_REMOVED", "GOAL"),
        ("NODE", "BACKGROUND"),
        ("EDGE_REMOVED", "BACKGROUND"),
    ],
)
def test_what_means_two_things_is_told_apart_by_every_eye(one: str, other: str, sight: str) -> None:
    ends = dict(zip(("PROBABILITY_0", "PROBABILITY_1"), map(tuple, palette.probability_colours([0, 1])), strict=True))
    first, second = (
        seen_as_lab(ends[name] if name in ends else getattr(palette, name), sight) for name in (one, other)
    )

    assert np.linalg.norm(first - second) >= EASILY_TOLD_APART
