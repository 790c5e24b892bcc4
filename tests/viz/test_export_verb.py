"""`ltvn export` writes other formats by --to, takes seconds there as before, and refuses what does not go together."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ltvn_core.data.exporting.map_files import placed_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_viz.verbs.export import ExportSummary, ExportVerb
from tests.core.data.importing.plan_files import write_plan
from tests.repository import DEMO_DRIVE, DEMO_MAP


def export(**options: Any) -> ExportSummary:
    summary = ExportVerb(**options).run()
    assert isinstance(summary, ExportSummary)
    return summary


def test_a_map_and_a_drive_are_written_in_another_format(tmp_path: Path) -> None:
    route = export(recording=DEMO_MAP, to="nav2-route", output=tmp_path / "route.geojson")
    drive = export(recording=DEMO_DRIVE, to="vint", from_s=10, until=15, output=tmp_path / "drive")
    assert (route.format, route.frames, route.nodes) == ("nav2-route", None, 327)
    assert drive.frames == len(list((tmp_path / "drive").glob("*.jpg")))
    assert drive.size_bytes is not None
    assert drive.size_bytes > 1000


def test_seconds_still_say_where_a_moment_ends(tmp_path: Path) -> None:
    moment = export(recording=DEMO_DRIVE, from_s=10, to="15", output=tmp_path / "moment.rrd")
    assert moment.format is None
    assert moment.frames


def test_a_floor_plan_lies_under_the_figure_and_gives_the_route_its_frame(tmp_path: Path) -> None:
    plan = write_plan(tmp_path)
    poses = placed_map(Recording.open(DEMO_MAP)).poses
    first, middle, last = np.quantile([*poses], (0, 0.5, 1), method="nearest").tolist()
    # The plan's origin is at x = 1 m, y = 2 m of the map.
    align = tuple(f"{node}={poses[node][0] - 1},{poses[node][1] - 2}" for node in (first, middle, last))
    export(recording=DEMO_MAP, to="nav2-route", output=tmp_path / "route.geojson", floor_plan=plan, align=align)
    export(recording=DEMO_MAP, svg=tmp_path / "map.svg", floor_plan=plan, align=align)
    features = json.loads((tmp_path / "route.geojson").read_text(encoding="utf-8"))["features"]
    place = next(each["geometry"]["coordinates"] for each in features if each["properties"]["id"] == first)
    assert place == pytest.approx([poses[first][0] - 1, poses[first][1] - 2])
    # The corner, (-1, 2) in the plan, is at (0, 4); its picture of 4 rows of half a metre ends 2 m above.
    svg = (tmp_path / "map.svg").read_text(encoding="utf-8")
    found = re.search(r'<image width="6" height="4" transform="matrix\(([^)]*)', svg)
    assert found is not None
    np.testing.assert_allclose([float(word) for word in found[1].split()], (0.5, 0, 0, 0.5, 0, -6), atol=1e-5)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"to": "nav2-route"}, "needs --output"),
        ({"to": "mp3", "output": Path("x")}, "--to takes a format"),
        ({"to": "vint", "output": Path("x.rrd")}, "not write a recording"),
        ({"to": "vint", "output": Path("x"), "svg": Path("y")}, "only one output"),
        ({"to": "graphml", "output": Path("x"), "from_s": 3}, "map at the end"),
        ({"to": "3", "until": 4.0, "output": Path("x")}, "already gives seconds"),
        ({}, "give --output"),
        ({"to": "vint", "output": Path("x"), "floor_plan": Path("map.yaml")}, "--floor-plan only with"),
        ({"output": Path("x"), "floor_plan": Path("map.yaml")}, "with --html, --svg"),
        ({"svg": Path("x.svg"), "align": ("3=1,2",)}, "with --floor-plan"),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, Any], expected: str) -> None:
    with pytest.raises(OptionError, match=expected):
        export(recording=DEMO_DRIVE, **options)
