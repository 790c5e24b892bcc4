"""Alignment of the floor plan with the map by clicks in the page: a node, its place on the plan, and the next node.

Owns the order of the clicks and the hints about them. The fit is computed as for the option `--align`, from the same
text. After the second pair, the page shows the plan at the fitted pose. For the session's thread only.
"""

from dataclasses import dataclass, replace

import numpy as np

from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.data.importing.floor_plan_alignment import (
    DOUBTFUL_M,
    LEAST_APART_M,
    LEAST_PAIRS,
    LaidFloorPlan,
    align_floor_plan,
)
from ltvn_core.errors import OptionError
from ltvn_core.geometry import compose, relative
from ltvn_core.types import NodeId, Pose
from ltvn_viz.session.snapshot import FloorPlanView


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """A clicked node and its place on the plan."""

    node: NodeId
    pose: Pose
    """(3,) pose of the node on the map."""
    place: tuple[float, float] | None = None
    """x and y in the plan's own frame, in metres and whole centimetres; None until it is clicked."""

    @property
    def text(self) -> str:
        """The pair as text, in the format of `--align`."""
        return "" if self.place is None else f"{self.node}={self.place[0]:g},{self.place[1]:g}"


class FloorPlanClicks:
    """The floor plan under the map, and the clicks of the person who aligns it."""

    def __init__(self, laid: LaidFloorPlan) -> None:
        """Start with the plan at its present pose."""
        self._used = laid
        self._shown = laid
        self._pairs: list[_Pair] = []
        self.view = FloorPlanView(laid.plan)
        """State of the plan for the page."""

    @property
    def is_on(self) -> bool:
        """Tell whether a person is aligning the plan, so that clicks on the map are meant for it."""
        return self.view.is_aligning

    def toggle(self) -> None:
        """Start an alignment, or leave the plan as it was before."""
        self._begin(is_on=not self.is_on)

    def take_node(self, node: NodeId, graph: GraphArrays) -> None:
        """Handle a click on a node of the map; replaces a node whose place was not clicked. Raises OptionError."""
        poses = graph.poses_of((node,))
        if not len(poses):
            raise OptionError(f"Node {node} is not in the map any more; click another one.")
        self._pairs = [*self._placed(), _Pair(node, poses[0])]
        self._show()

    def take_place(self, place: tuple[float, float]) -> None:
        """Handle a click on the plan at (x, y), in metres in the frame of the map. Raises OptionError.

        If the pairs do not determine the rotation, the last pair is removed.
        """
        if not self.is_on or self.view.node is None:
            return  # The page sent the click before it received that no click on the plan is expected any more.
        x, y, _ = relative(self._shown.frame, np.array([*place, 0.0])).round(2)
        self._pairs[-1] = replace(self._pairs[-1], place=(float(x), float(y)))
        try:
            self._show()
        except OptionError as error:
            self._pairs.pop()
            self._show()
            raise OptionError(
                f"These places are too near to each other; click a node more than {LEAST_APART_M} m away, and its "
                "place on the plan."
            ) from error

    def undo(self) -> None:
        """Undo the last click."""
        if self._pairs:
            last = self._pairs.pop()
            self._pairs += [] if last.place is None else [replace(last, place=None)]
            self._show()

    def use(self) -> None:
        """Use the plan at the pose that is shown. Raises OptionError if there are too few pairs."""
        if self.view.error_m is None:
            raise OptionError(f"Click at least {LEAST_PAIRS} nodes and their places on the plan first.")
        self._used = self._shown
        self.view = replace(self.view, align=" ".join(["--align", *(pair.text for pair in self._placed())]))
        self._begin(is_on=False)

    def _begin(self, *, is_on: bool) -> None:
        self._pairs = []
        self.view = replace(self.view, is_aligning=is_on)
        self._show()

    def _placed(self) -> list[_Pair]:
        return [pair for pair in self._pairs if pair.place is not None]

    def _show(self) -> None:
        """Move the plan to the fitted pose. Raises OptionError, and changes nothing, if the pairs do not determine the
        pose."""
        placed = self._placed()
        fit = None
        if len(placed) >= LEAST_PAIRS:
            fit = align_floor_plan([pair.text for pair in placed], {pair.node: pair.pose for pair in placed})
        self._shown = self._used if fit is None else self._used.moved_to(fit.pose)
        self.view = replace(
            self.view,
            plan=self._shown.plan,
            pairs=len(placed),
            node=next((pair.node for pair in self._pairs if pair.place is None), None),
            error_m=None if fit is None else fit.error_m,
            marks=tuple(mark for pair in self._pairs for mark in self._marks(pair)),
        )

    def _marks(self, pair: _Pair) -> list[tuple[float, float]]:
        points = [pair.pose]
        if pair.place is not None:
            points.append(compose(self._shown.frame, np.array([*pair.place, 0.0])))
        return [(float(point[0]), float(point[1])) for point in points]


def aligning_hint(view: FloorPlanView) -> str:
    """Return a hint about the next click, and how well the pairs fit."""
    if view.node is not None:
        return f"Click the place of node {view.node} on the plan, which is coloured now."
    if view.error_m is None:
        return "Click a node of the map." if not view.pairs else "Click another node, far from the first."
    if is_doubtful(view):
        return (
            f"The clicks disagree by {view.error_m:.2f} m: one is wrong, or odometry drifted far. Press “Undo last” "
            "under “World”, or click another node."
        )
    return f"The plan fits to {view.error_m:.2f} m. Press “Use it” under “World”, or click another node to be sure."


def is_doubtful(view: FloorPlanView) -> bool:
    """Tell whether the pairs contradict each other."""
    return view.error_m is not None and view.error_m > DOUBTFUL_M
