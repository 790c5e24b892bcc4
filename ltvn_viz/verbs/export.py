"""`ltvn export`: a moment, a test, a page or a figure out of a recording, to pass on."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
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


@dataclass(frozen=True, kw_only=True)
class ExportVerb(Verb):
    """Take something out of a recording or a map, to pass on: a moment, a test of it, a page or a figure of the map."""

    recording: Positional[Path]
    """The .rrd file; it is left as it is."""
    from_s: Annotated[float | None, tyro.conf.arg(name="from")] = None
    """Where the moment begins, in seconds on the robot's clock; the beginning if not given."""
    to_s: Annotated[float | None, tyro.conf.arg(name="to")] = None
    """Where it ends, and the time at which the map is drawn; the end if not given."""
    output: Path | None = None
    """Write the moment here, as a recording that stands alone."""
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
        self._check()
        excerpt = self._cut() if self.output is not None else None
        if self.html is not None or self.svg is not None:
            self._draw()
        return ExportSummary(
            recording=self.recording,
            output=self.output,
            frames=None if excerpt is None else excerpt.frames,
            events=None if excerpt is None else excerpt.events,
            size_bytes=None if excerpt is None else excerpt.size_bytes,
            test=self.test,
            html=self.html,
            svg=self.svg,
        )

    def _check(self) -> None:
        if self.output is None and self.html is None and self.svg is None:
            raise OptionError(
                "Nothing to write: name --output for a moment, or --html or --svg for a picture of the map."
            )
        if self.test is not None and self.output is None:
            raise OptionError("--test is about a moment; name --output, the recording that the test opens.")
        for path in (self.test, self.html, self.svg):
            if path is not None and path.exists():
                raise OptionError(f"{path} exists already and is never overwritten; name another file.")

    def _cut(self) -> "Excerpt":
        from ltvn_core.recording.excerpt import time_span, write_excerpt
        from ltvn_core.recording.reader import Recording
        from ltvn_viz.debugger.exports import write_excerpt_test

        recording = Recording.open(self.recording)
        begin, end = time_span(recording)
        from_s = begin if self.from_s is None else self.from_s
        to_s = end if self.to_s is None else self.to_s
        output = self.output or Path()
        written = write_excerpt(recording, output, from_s=from_s, to_s=to_s, named_only=self.named_only)
        if self.test is not None:
            write_excerpt_test(recording, output, self.test, from_s=from_s, to_s=to_s)
        return written

    def _draw(self) -> None:
        from ltvn_core.recording.reader import Recording
        from ltvn_viz.debugger.exports import draw_map

        draw_map(Recording.open(self.recording), self.to_s, html=self.html, svg=self.svg)
