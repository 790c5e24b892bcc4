"""What an exported map says of itself: its name, its colours, and how long a metre is."""

import re

import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.evaluation.reports.map_svg import bar_length_m, map_layout, map_svg
from tests.repository import DEMO_DRIVE


@pytest.mark.parametrize(("width_m", "bar_m"), [(0.5, 0.1), (9.8, 2.0), (21.0, 5.0), (400.0, 100.0), (0.0, 0.01)])
def test_the_scale_bar_is_round_and_at_most_a_quarter_of_the_map(width_m: float, bar_m: float) -> None:
    assert bar_length_m(width_m) == pytest.approx(bar_m)


def test_an_exported_map_has_its_title_legend_and_a_bar_as_long_as_it_says() -> None:
    drawn = map_layout(Recording.open(DEMO_DRIVE))
    figure = map_svg(drawn)
    words = re.findall(r"<text[^>]*>([^<]*)</text>", figure)
    assert words[0].startswith(f"{drawn.title}: {len(drawn.graph.nodes):,} nodes")
    assert {"edge p 0", "1"} <= set(words)
    (said,) = [word for word in words if re.fullmatch(r"[\d.]+ m", word)]
    (drawn_m,) = re.findall(r"v[\d.]+h([\d.]+)v-", figure)
    assert float(drawn_m) == float(said.removesuffix(" m"))
