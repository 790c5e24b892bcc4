"""`ltvn export`: a moment, a test, a page or a figure out of a recording, to pass on."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True)
class Exported:
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
class Export(Verb):
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
    """Write the map over its scene as one page that asks nothing of any other machine."""
    svg: Path | None = None
    """Write the same as a figure."""

    def run(self) -> Summary:
        """Write what is asked for; raises OptionError, RecordingError, MapError and SceneError."""
        self._check()
        cut = self._cut() if self.output is not None else None
        if self.html is not None or self.svg is not None:
            self._draw()
        return Exported(
            recording=self.recording,
            output=self.output,
            frames=None if cut is None else cut.frames,
            events=None if cut is None else cut.events,
            size_bytes=None if cut is None else cut.size_bytes,
            test=self.test,
            html=self.html,
            svg=self.svg,
        )
