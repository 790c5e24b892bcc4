"""What a person can take along from a recording: a moment with a test to begin with, and the map as page and figure.

Owns the names of the files, which never are those of others. What is in them is `recording.excerpt`,
`analysis.regression_test_source`, `scene_html` and `report.map_svg`. Slow; runs in the worker's thread.
"""

import re
from pathlib import Path

from ltvn_core.analysis.regression_test_source import regression_test_source
from ltvn_core.atomic_files import write_text_atomically
from ltvn_core.evaluation.map_layout import map_layout
from ltvn_core.recording.excerpt import event_window, time_span, write_excerpt
from ltvn_core.recording.reader import Recording
from ltvn_core.reports.map_svg import map_svg
from ltvn_viz.layers.scene_html import scene_html
from ltvn_viz.session.recording_library import RecordingLibrary


def save_excerpt(library: RecordingLibrary, name: str, from_s: float, to_s: float) -> tuple[Path, Path]:
    """Cut a stretch of the robot's clock out of a recording, and write a test of it beside it. Raises LtvnError."""
    recording = Recording.open(library.path(name))
    begin, end = time_span(recording)
    from_s, to_s = max(from_s, begin), min(to_s, end)
    output = library.new_file(f"moment-{Path(name).stem}-{from_s:.0f}s")
    write_excerpt(recording, output, from_s=from_s, to_s=to_s)
    found = event_window(recording.events, from_s, to_s)
    about = f"{name} from {from_s:.1f} s to {to_s:.1f} s"
    test = library.new_file(f"test_{re.sub(r'[^0-9A-Za-z]+', '_', output.stem)}", ".py")
    write_text_atomically(test, regression_test_source(found.ongoing + found.events, file=output.name, about=about))
    return output, test


def save_map(library: RecordingLibrary, name: str, at_s: float) -> tuple[Path, Path]:
    """Draw the map at a time of the robot's clock as a page in 3D and as a flat figure. Raises LtvnError."""
    recording = Recording.open(library.path(name))
    drawn = map_layout(recording, at_s=at_s)
    stem = f"map-{Path(name).stem}-{at_s:.0f}s"
    page, figure = library.new_file(stem, ".html"), library.new_file(stem, ".svg")
    write_text_atomically(page, scene_html(recording, drawn))
    write_text_atomically(figure, map_svg(drawn))
    return page, figure
