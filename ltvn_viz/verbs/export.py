"""`ltvn export`: a moment, a test, a page or a figure out of a recording, or all of it in another format."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.exporting.recording_export import ExportFormat
    from ltvn_core.recording.excerpt import Excerpt


@dataclass(frozen=True)
class ExportSummary:
    """What was written."""

    recording: Path
    """What it came from."""
    output: Path | None
    """The moment, a recording of its own."""
    frames: int | None
    """In it."""
    events: int | None
    size_bytes: int | None
    test: Path | None
    """A pytest file about the moment, to be changed by hand."""
    html: Path | None
    svg: Path | None
    format: str | None
    """Other than a recording, by --to."""
    nodes: int | None
    """Of a map in another format."""
    edges: int | None


@dataclass(frozen=True, kw_only=True)
class ExportVerb(Verb):
    """Take something out of a recording or a map, to pass on: a moment, a test of it, a page or a figure of the map.

    With --to FORMAT all of it becomes a file or folder for other programs.
    """

    recording: Positional[Path]
    """The .rrd file; it is left as it is."""
    from_s: Annotated[float | None, tyro.conf.arg(name="from")] = None
    """Where the moment begins, in seconds on the robot's clock; the beginning if not given."""
    to: str | None = None
    """A format for other programs: of a drive mcap, tum, vint or lerobot, of a map graphml, geojson or nav2-route. Or
    seconds: where the moment ends, and the time at which the map is drawn; the end if not given."""
    until: float | None = None
    """Where the moment ends, beside --to FORMAT."""
    output: Path | None = None
    """Write the moment here, as a recording that stands alone; with --to FORMAT the file or folder of that format."""
    named_only: bool = False
    """Keep only the images that the moment's events name: much smaller, but nobody can navigate by it."""
    test: Path | None = None
    """Write a pytest file here that opens the moment and asserts what happened; lies beside --output."""
    html: Path | None = None
    """Write the map in its scene, in 3D, as one page that asks nothing of any other machine."""
    svg: Path | None = None
    """Write it as a flat figure; pointing at a node or an edge shows its numbers."""

    def run(self) -> Summary:
        """Write what is asked for; raises OptionError, RecordingError, MapError and SceneError."""
        to_s, to_format = self._end()
        self._check(to_format)
        if to_format is not None:
            return self._export(to_format, to_s)
        excerpt = self._cut(to_s) if self.output is not None else None
        if self.html is not None or self.svg is not None:
            self._draw(to_s)
        return self._summary(
            frames=None if excerpt is None else excerpt.frames,
            events=None if excerpt is None else excerpt.events,
            size_bytes=None if excerpt is None else excerpt.size_bytes,
        )

    def _end(self) -> "tuple[float | None, ExportFormat | None]":
        """Return where the moment ends, and another format; --to says one of the two."""
        from ltvn_core.exporting.recording_export import ExportFormat

        if self.to is None:
            return self.until, None
        if self.to in (names := [each.value for each in ExportFormat]):
            return self.until, ExportFormat(self.to)
        try:
            seconds = float(self.to)
        except ValueError as error:
            raise OptionError(f"--to takes a format ({', '.join(names)}) or seconds, got {self.to!r:.40}.") from error
        if self.until is not None:
            raise OptionError("--to names seconds already; --until goes with --to FORMAT.")
        return seconds, None

    def _check(self, to_format: "ExportFormat | None") -> None:
        if to_format is not None:
            self._check_format(to_format)
        elif self.output is None and self.html is None and self.svg is None:
            raise OptionError(
                "Nothing to write: name --output for a moment, or --html or --svg for a picture of the map."
            )
        if self.test is not None and self.output is None:
            raise OptionError("--test is about a moment; name --output, the recording that the test opens.")
        for path in (self.test, self.html, self.svg):
            if path is not None and path.exists():
                raise OptionError(f"{path} exists already and is never overwritten; name another file.")

    def _check_format(self, to_format: "ExportFormat") -> None:
        name = to_format.value
        if self.output is None:
            raise OptionError(f"--to {name} needs --output, the file or folder to write.")
        if self.html or self.svg or self.test or self.named_only:
            raise OptionError(f"--to {name} writes one thing alone; leave out --html, --svg, --test and --named-only.")
        if to_format.is_map and (self.from_s is not None or self.until is not None):
            raise OptionError(f"--to {name} writes the map at the end; --from and --until choose frames of a drive.")
        if self.output.suffix == ".rrd":
            raise OptionError(f"--to {name} writes no recording; give --output another ending than .rrd.")

    def _export(self, to_format: "ExportFormat", to_s: float | None) -> Summary:
        from ltvn_core.exporting.recording_export import export_recording
        from ltvn_core.recording.reader import Recording

        recording, output = Recording.open(self.recording), self.output or Path()
        done = export_recording(recording, output, to_format, from_s=self.from_s, to_s=to_s)
        files = [output] if output.is_file() else [file for file in output.rglob("*") if file.is_file()]
        return self._summary(
            frames=done.frames,
            size_bytes=sum(file.stat().st_size for file in files),
            nodes=done.nodes,
            edges=done.edges,
            to_format=to_format.value,
        )

    def _summary(
        self,
        *,
        frames: int | None = None,
        events: int | None = None,
        size_bytes: int | None = None,
        nodes: int | None = None,
        edges: int | None = None,
        to_format: str | None = None,
    ) -> ExportSummary:
        return ExportSummary(
            recording=self.recording,
            output=self.output,
            frames=frames,
            events=events,
            size_bytes=size_bytes,
            test=self.test,
            html=self.html,
            svg=self.svg,
            format=to_format,
            nodes=nodes,
            edges=edges,
        )

    def _cut(self, until_s: float | None) -> "Excerpt":
        from ltvn_core.recording.excerpt import time_span, write_excerpt
        from ltvn_core.recording.reader import Recording
        from ltvn_viz.debugger.exports import write_excerpt_test

        recording = Recording.open(self.recording)
        begin, end = time_span(recording)
        from_s = begin if self.from_s is None else self.from_s
        to_s = end if until_s is None else until_s
        output = self.output or Path()
        written = write_excerpt(recording, output, from_s=from_s, to_s=to_s, named_only=self.named_only)
        if self.test is not None:
            write_excerpt_test(recording, output, self.test, from_s=from_s, to_s=to_s)
        return written

    def _draw(self, to_s: float | None) -> None:
        from ltvn_core.recording.reader import Recording
        from ltvn_viz.debugger.exports import draw_map

        draw_map(Recording.open(self.recording), to_s, html=self.html, svg=self.svg)
