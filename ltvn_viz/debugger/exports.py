"""Exports from a recording: an excerpt with a test to start from, and the map as page and figure.

Owns the file names, which are always new. The contents come from `ltvn_core.data.recording.excerpt`,
`analysis.regression_test_source`, `scene_html` and `evaluation.reports.map_svg`. Slow; runs in the worker's thread.
"""

import os
import re
from dataclasses import replace
from pathlib import Path

from ltvn_core.analysis.regression_test_source import regression_test_source
from ltvn_core.atomic_files import write_text_atomically
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.data.recording.excerpt import event_window, time_span, write_excerpt
from ltvn_core.data.recording.reader import Recording
from ltvn_core.evaluation.reports.map_svg import map_layout, map_svg
from ltvn_viz.session.recording_library import RecordingLibrary


def save_excerpt(library: RecordingLibrary, name: str, from_s: float, to_s: float) -> tuple[Path, Path]:
    """Write an excerpt between two times of the robot's clock, and a test in the same folder. Raises LtvnError.

    Both names have the second of the recording at which it begins, as the page shows it.
    """
    recording = Recording.open(library.path(name))
    begin, end = time_span(recording)
    from_s, to_s = max(from_s, begin), min(to_s, end)
    output = library.new_file(f"moment-{Path(name).stem}-{from_s - begin:.0f}s")
    write_excerpt(recording, output, from_s=from_s, to_s=to_s)
    test = library.new_file(f"test_{re.sub(r'[^0-9A-Za-z]+', '_', output.stem)}", ".py")
    write_excerpt_test(recording, output, test, from_s=from_s, to_s=to_s)
    return output, test


def save_map(
    library: RecordingLibrary, name: str, at_s: float, floor_plan: FloorPlan | None = None
) -> tuple[Path, Path]:
    """Draw the map at a time of the robot's clock as a page in 3D and as a flat figure. Raises LtvnError."""
    stem = f"map-{Path(name).stem}-{at_s:.0f}s"
    page = library.new_file(stem, ".html")
    figure = library.new_file(stem, ".svg")
    draw_map(Recording.open(library.path(name)), at_s, html=page, svg=figure, floor_plan=floor_plan)
    return page, figure


def write_excerpt_test(recording: Recording, excerpt: Path, test: Path, *, from_s: float, to_s: float) -> None:
    """Write a pytest file that opens an excerpt of a recording and asserts its events. Raises LtvnError."""
    found = event_window(recording.events, from_s, to_s)
    file = os.path.relpath(excerpt.absolute(), test.absolute().parent)
    about = f"{recording.path.name} from {from_s:.1f} s to {to_s:.1f} s"
    write_text_atomically(test, regression_test_source(found.ongoing + found.events, file=file, about=about))


def draw_map(
    recording: Recording,
    at_s: float | None,
    *,
    html: Path | None = None,
    svg: Path | None = None,
    floor_plan: FloorPlan | None = None,
) -> None:
    """Draw the map at a time of the robot's clock, at the end if None, into new files. Raises LtvnError.

    The map is drawn over the floor plan, if there is one.
    """
    drawn = replace(map_layout(recording, at_s=at_s), floor_plan=floor_plan)
    if svg is not None:
        write_text_atomically(svg, map_svg(drawn))
    if html is not None:
        from ltvn_viz.layers.scene_html import scene_html  # Imports viser, which no answer needs.

        write_text_atomically(html, scene_html(recording, drawn))
