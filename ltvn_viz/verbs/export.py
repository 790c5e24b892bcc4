"""`ltvn export`: writes an excerpt of a recording, a test, a page or a figure, or converts all of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from ltvn_core.verbs.outputs import NewOutput, NewText
from ltvn_core.verbs.verb import Verb
from ltvn_viz.verbs.floor_plan_options import FloorPlanOptions


@dataclass(frozen=True, kw_only=True)
class ExportVerb(FloorPlanOptions, Verb):
    """Export an excerpt of a recording, a test of it, or a page or figure of the map.

    With --to FORMAT, convert the recording or map to a file or folder for other programs.
    """

    job = "ltvn_viz.verbs.jobs.export:export"

    recording: Positional[Path]
    """The .rrd file; it is not changed."""
    from_s: Annotated[float | None, tyro.conf.arg(name="from")] = None
    """Start of the excerpt, in seconds on the robot's clock; by default the beginning of the recording."""
    to: str | None = None
    """Format for other programs: mcap, tum, vint or lerobot for the images of a drive; graphml, geojson or nav2-route
    for the map that is in a recording at its end, also of a drive in which one was built or used. Or a time in seconds:
    the end of the excerpt, at which the map is drawn; by default the end of the recording."""
    until: float | None = None
    """End of the excerpt, in seconds on the robot's clock; needed only if --to names a format."""
    output: NewOutput | None = None
    """File for the excerpt, as a complete recording; with --to FORMAT, the file or folder of that format."""
    named_only: bool = False
    """Keep only the images that events of the excerpt name: a much smaller file, but unfit for navigation."""
    test: NewText | None = None
    """File for a pytest test that opens the excerpt of --output and asserts its events."""
    html: NewText | None = None
    """File for the map in its scene, in 3D, as one HTML page that needs no network."""
    svg: NewText | None = None
    """File for the map as an SVG figure, which shows the numbers of a node or an edge on hover."""
