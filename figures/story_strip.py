"""`python -m figures.story_strip RECORDING`: the story of a door that closes and opens again, as a row of floor plans.

The recording is that of `ltvn demo --headless --story`.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

from figures.story_moments import StoryMoment, story_moments
from ltvn_core import palette
from ltvn_core.cli import run_verb
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import RecordingError
from ltvn_core.extras import require_libraries
from ltvn_core.types import NodeId
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE_IN = (12.6, 2.15)
_FLOOR, _SOLID = (0.955, 0.96, 0.97), (0.42, 0.45, 0.5)
_KNOWN = (0.62, 0.7, 0.82)


@dataclass(frozen=True)
class StoryStripSummary:
    """What was drawn."""

    picture: Path
    moments: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class StoryStripVerb(Verb):
    """Draw the moments of a story next to each other."""

    recording: Positional[Path]
    """What `ltvn demo --headless --story` recorded."""
    output: Path = Path("docs/images/story.png")
    """The picture."""

    def run(self) -> Summary:
        """Draw it; raises RecordingError, SceneError and OptionError."""
        require_libraries("matplotlib", "jinja2")
        from matplotlib.figure import Figure

        from ltvn_core.evaluation.reports.figure_style import FIGURE_PALETTE, documentation_style, save_png

        recording = Recording.open(self.recording)
        moments = story_moments(recording)
        if not moments:
            raise RecordingError(f"{self.recording} holds no story; record one with `ltvn demo --headless --story`.")
        poses = {node: pose for moment in moments for node, pose in moment.places.items()}
        with documentation_style(FIGURE_PALETTE):
            figure = Figure(figsize=SIZE_IN, layout="constrained")
            for number, (axes, moment) in enumerate(zip(figure.subplots(1, len(moments)), moments, strict=True), 1):
                _draw(axes, moment, poses)
                axes.set_title(f"{number} {moment.title}", fontsize=11)
        return StoryStripSummary(save_png(figure, self.output), tuple(moment.title for moment in moments))


def _draw(axes: "Axes", moment: StoryMoment, poses: "dict[NodeId, NDArray[np.float64]]") -> None:
    clearance = moment.scene.clearance
    rows, columns = clearance.blocked.shape
    (x, y), size_m = clearance.origin, clearance.resolution_m
    colours = np.where(clearance.blocked[..., None], _SOLID, _FLOOR)
    axes.imshow(
        colours, origin="lower", extent=(x, x + columns * size_m, y, y + rows * size_m), interpolation="nearest"
    )
    _lines(axes, [edge for edge in moment.edges if edge not in moment.new | moment.absent], poses, _KNOWN, 0.8)
    _lines(axes, sorted(moment.new), poses, palette.EDGE_ADDED.on_white, 1.4)
    if len(moment.plan) > 1:
        way = np.array([poses[node][:2] for node in moment.plan])
        axes.plot(*way.T, color=palette.TARGET.on_white, linewidth=2.2, zorder=4)
    _lines(axes, sorted(moment.absent), poses, palette.EDGE_REMOVED.on_white, 1.8)
    for door in moment.closed:
        across = np.array([[door.low, door.high], [door.wall, door.wall]])
        axes.plot(*(across[::-1] if door.axis == 0 else across), color=palette.EDGE_REMOVED.on_white, linewidth=4)
    if moment.robot is not None:
        px, py, yaw = moment.robot
        axes.plot(px, py, "o", color="black", markersize=6, zorder=6)
        axes.plot([px, px + 0.45 * np.cos(yaw)], [py, py + 0.45 * np.sin(yaw)], color="black", linewidth=2, zorder=6)
    axes.set_axis_off()


def _lines(
    axes: "Axes",
    edges: Sequence[tuple[NodeId, NodeId]],
    poses: "dict[NodeId, NDArray[np.float64]]",
    colour: tuple[float, float, float],
    width: float,
) -> None:
    from matplotlib.collections import LineCollection

    ends = [(poses[source][:2], poses[target][:2]) for source, target in edges]
    axes.add_collection(LineCollection(ends, colors=[colour], linewidths=width, zorder=3))


if __name__ == "__main__":
    sys.exit(run_verb("python -m figures.story_strip", StoryStripVerb))
