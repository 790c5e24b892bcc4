"""`ltvn export`: a moment, a test, a page or a figure out of a recording, to pass on."""

import os
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
        write_excerpt = self._cut() if self.output is not None else None
        if self.html is not None or self.svg is not None:
            self._draw()
        return ExportSummary(
            recording=self.recording,
            output=self.output,
            frames=None if write_excerpt is None else write_excerpt.frames,
            events=None if write_excerpt is None else write_excerpt.events,
            size_bytes=None if write_excerpt is None else write_excerpt.size_bytes,
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
        from ltvn_core.analysis.regression_test_source import regression_test_source
        from ltvn_core.atomic_files import write_text_atomically
        from ltvn_core.recording.excerpt import event_window, time_span, write_excerpt
        from ltvn_core.recording.reader import Recording

        recording = Recording.open(self.recording)
        begin, end = time_span(recording)
        from_s, to_s = begin if self.from_s is None else self.from_s, end if self.to_s is None else self.to_s
        output = self.output or Path()
        written = write_excerpt(recording, output, from_s=from_s, to_s=to_s, named_only=self.named_only)
        if self.test is not None:
            found = event_window(recording.events, from_s, to_s)
            file = os.path.relpath(output.absolute(), self.test.absolute().parent)
            about = f"{self.recording.name} from {from_s:.1f} s to {to_s:.1f} s"
            write_text_atomically(
                self.test, regression_test_source(found.ongoing + found.events, file=file, about=about)
            )
        return written

    def _draw(self) -> None:
        from ltvn_core.atomic_files import write_text_atomically
        from ltvn_core.evaluation.map_layout import map_layout
        from ltvn_core.recording.reader import Recording
        from ltvn_core.reports.map_svg import map_svg
        from ltvn_viz.layers.scene_html import scene_html

        recording = Recording.open(self.recording)
        drawn = map_layout(recording, at_s=self.to_s)
        if self.svg is not None:
            write_text_atomically(self.svg, map_svg(drawn))
        if self.html is not None:
            write_text_atomically(self.html, scene_html(recording, drawn))
