"""`ltvn export`: writes an excerpt of a recording, a test, a page or a figure, or converts all of it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.verbs.outputs import NewOutput, NewText
from ltvn_core.verbs.verb import Verb
from ltvn_viz.verbs.floor_plan_options import FloorPlanOptions

if TYPE_CHECKING:
    from ltvn_core.data.exporting.recording_export import ExportFormat
    from ltvn_core.data.recording.excerpt import Excerpt


@dataclass(frozen=True, kw_only=True)
class ExportSummary:
    """Summary of an export."""

    recording: Path
    """The exported recording."""
    output: Path | None
    """New recording with the excerpt."""
    frames: int | None = None
    """Number of frames in the new recording."""
    events: int | None = None
    size_bytes: int | None = None
    test: Path | None
    """A pytest file about the excerpt, to be edited by hand."""
    html: Path | None
    svg: Path | None
    format: str | None = None
    """Format given by --to; None for a recording."""
    nodes: int | None = None
    """Number of nodes of a map in another format."""
    edges: int | None = None


@dataclass(frozen=True, kw_only=True)
class ExportVerb(FloorPlanOptions, Verb):
    """Export an excerpt of a recording, a test of it, or a page or figure of the map.

    With --to FORMAT, convert the recording or map to a file or folder for other programs.
    """

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

    def run(self) -> ExportSummary:
        """Write the requested files; raises OptionError, RecordingError, MapError and SceneError."""
        from ltvn_core.data.recording.reader import Recording
        from ltvn_viz.debugger.exports import draw_map

        to_s, to_format = self._end()
        self._check(to_format)
        wanted = ExportSummary(
            recording=self.recording, output=self.output, test=self.test, html=self.html, svg=self.svg
        )
        if to_format is not None:
            return self._convert(wanted, to_format, to_s)
        excerpt = None if self.output is None else self._cut(self.output, to_s)
        if self.html is not None or self.svg is not None:
            laid = self.lay_floor_plan(self.recording)
            plan = None if laid is None else laid.plan
            recording = Recording.open(self.recording, whole=True)
            draw_map(recording, to_s, html=self.html, svg=self.svg, floor_plan=plan)
        if excerpt is None:
            return wanted
        return replace(wanted, frames=excerpt.frames, events=excerpt.events, size_bytes=excerpt.size_bytes)

    def _end(self) -> "tuple[float | None, ExportFormat | None]":
        """Return the end of the excerpt, and the other format; --to gives only one of them."""
        from ltvn_core.data.exporting.recording_export import ExportFormat

        if self.to is None:
            return self.until, None
        if self.to in (names := [each.value for each in ExportFormat]):
            return self.until, ExportFormat(self.to)
        try:
            seconds = float(self.to)
        except ValueError as error:
            raise OptionError(f"--to takes a format ({', '.join(names)}) or seconds, got {self.to!r:.40}.") from error
        if self.until is not None:
            raise OptionError("--to already gives seconds; use --until only with --to FORMAT.")
        return seconds, None

    def _check(self, to_format: "ExportFormat | None") -> None:
        if to_format is not None:
            self._check_format(to_format)
        elif (self.floor_plan or self.align) and not (self.html or self.svg):
            raise OptionError("--floor-plan needs a map; use it with --html, --svg or a format of maps.")
        elif self.output is None and self.html is None and self.svg is None:
            raise OptionError("Nothing to write: give --output for a recording, or --html or --svg for the map.")
        if self.test is not None and self.output is None:
            raise OptionError("--test needs --output, the recording that the test opens.")

    def _check_format(self, to_format: "ExportFormat") -> None:
        name = to_format.value
        if self.output is None:
            raise OptionError(f"--to {name} needs --output, the file or folder to write.")
        if self.html or self.svg or self.test or self.named_only:
            raise OptionError(f"--to {name} writes only one output; omit --html, --svg, --test and --named-only.")
        if not to_format.is_map and (self.floor_plan or self.align):
            raise OptionError(
                f"--to {name} writes a drive; use --floor-plan only with graphml, geojson and nav2-route."
            )
        if to_format.is_map and (self.from_s is not None or self.until is not None):
            raise OptionError(f"--to {name} writes the map at the end; use --from and --until only for drives.")
        if self.output.suffix == ".rrd":
            raise OptionError(f"--to {name} does not write a recording; --output must not end in .rrd.")

    def _convert(self, wanted: ExportSummary, to_format: "ExportFormat", to_s: float | None) -> ExportSummary:
        from ltvn_core.data.exporting.recording_export import export_recording
        from ltvn_core.data.recording.reader import Recording

        recording = Recording.open(self.recording, whole=True)
        output = self.output or Path()
        laid = self.lay_floor_plan(self.recording)
        frame = None if laid is None else laid.frame
        done = export_recording(recording, output, to_format, from_s=self.from_s, to_s=to_s, frame=frame)
        files = [output] if output.is_file() else [file for file in output.rglob("*") if file.is_file()]
        return replace(
            wanted,
            frames=done.frames,
            size_bytes=sum(file.stat().st_size for file in files),
            nodes=done.nodes,
            edges=done.edges,
            format=to_format.value,
        )

    def _cut(self, output: Path, until_s: float | None) -> "Excerpt":
        from ltvn_core.data.recording.excerpt import time_span, write_excerpt
        from ltvn_core.data.recording.reader import Recording
        from ltvn_viz.debugger.exports import write_excerpt_test

        recording = Recording.open(self.recording, whole=True)
        begin, end = time_span(recording)
        from_s = begin if self.from_s is None else self.from_s
        to_s = end if until_s is None else until_s
        written = write_excerpt(recording, output, from_s=from_s, to_s=to_s, named_only=self.named_only)
        if self.test is not None:
            write_excerpt_test(recording, output, self.test, from_s=from_s, to_s=to_s)
        return written
