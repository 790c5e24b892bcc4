"""Charts in an answer: what never changes is a line of text, and no name lies on a curve."""

import re

import pytest

from ltvn_core import palette
from ltvn_core.analysis.answer import PROBABILITY, Axis, Paragraph, StepChart
from ltvn_core.analysis.answer_text import answer_text
from ltvn_viz.debugger.charts import axis_ticks, chart_svg
from ltvn_viz.debugger.question import AnswerBuilder


def nodes_chart(*counts: int) -> StepChart:
    points = tuple((float(query), float(count)) for query, count in enumerate(counts, start=1))
    return StepChart(points, Axis("queries", 1.0, 3.0), Axis("nodes", 0.0, 30.0), palette.NODE)


def test_a_quantity_that_never_changes_is_a_line_of_text() -> None:
    builder = AnswerBuilder()
    builder.add_chart(nodes_chart(27, 27, 27))
    (block,) = builder.build().answer.blocks
    assert isinstance(block, Paragraph)
    assert answer_text(builder.build().answer) == "nodes: 27 throughout"


def test_the_name_of_a_limit_lies_below_all_that_a_curve_can_reach() -> None:
    x, y = Axis("time, s", 0.0, 10.0), Axis("margin", *PROBABILITY)
    chart = StepChart(((0.0, 0.0), (5.0, 1.0)), x, y, palette.SOURCE, limits=((0.3, "below: ambiguous"),))
    svg = chart_svg(chart)
    name = re.search(r'<text x="[\d.]+" y="([\d.]+)"[^>]*>below: ambiguous', svg)
    curve = re.search(r'<path d="(M[^"]+)" fill="none" stroke="[^"]+" stroke-width="2"', svg)
    assert name is not None
    assert curve is not None
    lowest = max(float(row) for row in re.findall(r"(?:V|M[\d.]+ )([\d.]+)", curve[1]))
    assert float(name[1]) > lowest + 13  # The height of the letters.


@pytest.mark.parametrize("span", [1e-6, 0.3, 1.0, 7.0, 95.0, 3600.0])
def test_an_axis_has_a_few_round_ticks(span: float) -> None:
    ticks = axis_ticks(Axis("time, s", 3.0, 3.0 + span))
    assert len(ticks) <= 7
    assert all(3.0 - 1e-9 <= tick <= 3.0 + span + 1e-9 for tick in ticks)
    assert len(ticks) >= 2 or span < 0.3


def test_an_axis_that_counts_has_whole_ticks() -> None:
    assert axis_ticks(Axis("queries", 1.0, 3.0, is_count=True)) == [1.0, 2.0, 3.0]


def test_the_axis_of_a_probability_ends_at_one() -> None:
    assert axis_ticks(Axis("p", *PROBABILITY)) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])


def test_a_chart_has_axes_with_units_and_a_line_at_the_moment() -> None:
    x, y = Axis("time, s", 0.0, 10.0), Axis("p", *PROBABILITY)
    svg = chart_svg(StepChart(((0.0, 0.9), (4.0, 0.2)), x, y, palette.SOURCE, now=6.0))
    assert all(words in svg for words in (">time, s<", ">p<", ">now<", ">0.2<", ">10<"))
    assert svg.count("<circle") == 2
    assert "nan" not in svg
