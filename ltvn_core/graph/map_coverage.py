"""How much of a drive its map knows: the share of the images whose place is in the map's largest piece.

Owns that question, which is put to the localisation that a robot would use. Decides nothing.
"""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import NO_PRIOR
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, Observation, Predictor, is_usable

ASKED = 40
"""Images that are no nodes are asked where they are; of more than so many, evenly spaced ones."""


class Stretch(NamedTuple):
    """A part of a drive, in seconds after its first image."""

    begin_s: float
    end_s: float
    drive: str = ""
    """Its name, where the map has several."""


class MapCoverage(NamedTuple):
    """What a map knows of the drive that it was built from."""

    share: float
    """Of the images, those that are nodes of the map's largest piece or are recognised as one of them."""
    gap: Stretch | None
    """The longest part of the drive that the piece knows nothing of; None where it knows all."""
    lost: tuple[FrameId, ...] = ()
    """The images that it does not know, in order."""


def map_coverage(
    observations: Sequence[Observation],
    graph: TopologicalGraph,
    keyframes: KeyframeStore,
    predictor: Predictor,
    system: NavigationSystem,
) -> MapCoverage:
    """Return what the largest piece of a map knows of the images that it was built from, which are in order.

    `keyframes` holds those of nodes and of the reserve. An image in neither merged and was let go, so it is known,
    unless the predictor cannot use it.
    """
    pieces = strongly_connected_components(graph)
    piece = set(pieces[0]) if pieces else set[FrameId]()
    in_reserve = [seen.step for seen in observations if seen.step in keyframes and seen.step not in graph.nodes]
    asked = np.unique(np.linspace(0, len(in_reserve) - 1, min(len(in_reserve), ASKED)).astype(int)).tolist()
    matcher = Matcher(predictor, keyframes, system.method.matching)
    answers = {}
    for frame in (in_reserve[k] for k in asked):
        found = system.localise(keyframes.features([frame]), graph, NO_PRIOR, matcher)
        answers[frame] = found.node in piece
    known = _known(observations, {node: node in piece for node in graph.nodes} | answers, set(in_reserve), predictor)
    return MapCoverage(
        share=float(np.mean(known)) if known else 1.0,
        gap=_longest_gap(observations, known, graph),
        lost=tuple(seen.step for seen, is_known in zip(observations, known, strict=True) if not is_known),
    )


def _known(
    observations: Sequence[Observation], answers: Mapping[FrameId, bool], in_reserve: set[FrameId], predictor: Predictor
) -> list[bool]:
    """Tell for each image whether its place is known; one of the reserve that was not asked is where the last was."""
    known, last = list[bool](), True
    for seen in observations:
        if seen.step in in_reserve:
            last = answers.get(seen.step, last)
            known.append(last)
        else:
            known.append(answers.get(seen.step, is_usable(seen, predictor)))
    return known


def _longest_gap(observations: Sequence[Observation], known: Sequence[bool], graph: TopologicalGraph) -> Stretch | None:
    """Return the longest part of one drive that is not known; between two drives lies no part of either."""
    gaps, begun_s = list[Stretch](), dict[int, float]()
    names = dict(enumerate(graph.drives.values(), 1)) if len(graph.drives) > 1 else {}
    drives = [graph.drive_of(seen.step) for seen in observations]
    for seen, drive in zip(observations, drives, strict=True):
        begun_s.setdefault(drive, seen.stamp)
    for (is_known, drive), run in groupby(range(len(known)), key=lambda row: (known[row], drives[row])):
        if not is_known:
            stamps = [observations[row].stamp - begun_s[drive] for row in run]
            gaps.append(Stretch(stamps[0], stamps[-1], names.get(drive, "")))
    return max(gaps, key=lambda gap: gap.end_s - gap.begin_s, default=None)
