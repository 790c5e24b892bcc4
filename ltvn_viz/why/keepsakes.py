"""What a person can take along from a recording: a moment with a test to begin with, and the map as page and figure.

Owns the names of the files, which never are those of others. What is in them is `recording.excerpt`,
`analysis.skeleton`, `scene_page` and `report.scene_svg`. Slow; runs in the worker's thread.
"""

import re
from pathlib import Path

from ltvn_core.analysis.skeleton import skeleton
from ltvn_core.evaluate.scene_plan import scene_plan
from ltvn_core.recording.excerpt import cut, moment, span
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.whole import write_whole
from ltvn_core.report.scene_svg import scene_svg
from ltvn_viz.library import Library
from ltvn_viz.scene_colours import scene_colours
from ltvn_viz.scene_page import scene_page


def save_moment(library: Library, name: str, from_s: float, to_s: float) -> tuple[Path, Path]:
    """Cut a stretch of the robot's clock out of a recording, and write a test of it beside it. Raises LtvnError."""
    recording = Recording.open(library.path(name))
    begin, end = span(recording)
    from_s, to_s = max(from_s, begin), min(to_s, end)
    output = library.new_file(f"moment-{Path(name).stem}-{from_s:.0f}s")
    cut(recording, output, from_s=from_s, to_s=to_s)
    found = moment(recording.events, from_s, to_s)
    about = f"{name} from {from_s:.1f} s to {to_s:.1f} s"
    test = library.new_file(f"test_{re.sub(r'[^0-9A-Za-z]+', '_', output.stem)}", ".py")
    write_whole(test, skeleton(found.opened + found.events, file=output.name, about=about))
    return output, test


def save_map(library: Library, name: str, at_s: float) -> tuple[Path, Path]:
    """Draw the map at a time of the robot's clock as a page in 3D and as a flat figure. Raises LtvnError."""
    recording = Recording.open(library.path(name))
    drawn = scene_plan(recording, at_s=at_s)
    stem = f"map-{Path(name).stem}-{at_s:.0f}s"
    page, figure = library.new_file(stem, ".html"), library.new_file(stem, ".svg")
    write_whole(page, scene_page(recording, drawn))
    write_whole(figure, scene_svg(drawn, scene_colours()))
    return page, figure
