"""`ltvn export`: writes an excerpt of a recording, a test, a page or a figure, or converts all of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb
from ltvn_viz.verbs.floor_plan_options import FloorPlanOptions


@dataclass(frozen=True, kw_only=True)
class ExportVerb(FloorPlanOptions, Verb):
    """Take something out of a recording or a map, to pass on: a moment, a test of it, a page or a figure of the map.

    With --to FORMAT all of it becomes a file or folder for other programs.
    """

    job = "ltvn_viz.verbs.jobs.export:export"

    recording: Positional[Path]
    """The .rrd file; it is left as it is."""
    from_s: Annotated[float | None, tyro.conf.arg(name="from")] = None
    """Start of the moment, in seconds on the robot's clock; the beginning if not given."""
    to: str | None = None
    """A format for other programs: of a drive mcap, tum, vint or lerobot, of a map graphml, geojson or nav2-route. Or
    seconds: where the moment ends, and the time at which the map is drawn; the end if not given."""
    until: float | None = None
    """End of the moment, for --to FORMAT."""
    output: Path | None = None
    """Write the moment here, as a complete recording; with --to FORMAT the file or folder of that format."""
    named_only: bool = False
    """Keep only the images that the moment's events name: much smaller, but unfit for navigation."""
    test: Path | None = None
    """Write a pytest file here that opens the moment and asserts what happened; lies beside --output."""
    html: Path | None = None
    """Write the map in its scene, in 3D, as one HTML file that needs no network."""
    svg: Path | None = None
    """Write the map as an SVG figure; pointing at a node or an edge shows its numbers."""
