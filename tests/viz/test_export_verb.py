"""`ltvn export` writes other formats by --to, takes seconds there as before, and refuses what does not go together."""

from pathlib import Path
from typing import Any

import pytest

from ltvn_core.errors import OptionError
from ltvn_viz.verbs.export import ExportVerb
from ltvn_viz.verbs.jobs.export import ExportSummary
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


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"to": "nav2-route"}, "needs --output"),
        ({"to": "mp3", "output": Path("x")}, "--to takes a format"),
        ({"to": "vint", "output": Path("x.rrd")}, "no recording"),
        ({"to": "vint", "output": Path("x"), "svg": Path("y")}, "one thing alone"),
        ({"to": "graphml", "output": Path("x"), "from_s": 3}, "map at the end"),
        ({"to": "3", "until": 4.0, "output": Path("x")}, "seconds already"),
        ({}, "name --output"),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, Any], expected: str) -> None:
    with pytest.raises(OptionError, match=expected):
        export(recording=DEMO_DRIVE, **options)
