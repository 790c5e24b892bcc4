"""Localisation: the current image compared with every node, the margin over time, and perceptual aliases.

The images of the nodes come from the live map, or from a recording, where they are read and encoded step by step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import PROBABILITY, Axis, Inline, Link, StepChart, Strong, Term, joined
from ltvn_core.analysis.localisation_confidence import (
    LocalisationHeatMap,
    PerceptualAlias,
    features_of,
    find_perceptual_aliases,
    localisation_heat_map,
)
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.config import Method
from ltvn_core.errors import LtvnError
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import Localised
from ltvn_core.palette import Rgb8
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId, Observation, Predictor
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, has_map, request_link, time_link
from ltvn_viz.session.backend import NO_PREDICTOR
from ltvn_viz.session.inspection import Overlay, QuestionAnswer, QuestionName, Selection, Stroke
from ltvn_viz.wishes.commands import PointAt, QuestionRequest

_COLOURED = 1000
_SHOWN_LOCALIZATIONS = 200
_SMALLEST = 5
_PAIRS = 8
_CANDIDATES = 8
"""Number of nodes with the most similar images that each node is compared with; more nodes take longer."""
_SMALL = 0.3
_AT_ONCE = 24
"""Number of images read between two updates of the page."""
MAX_NODES = 2000
"""Largest number of nodes of a recording that are compared, so that a long one fits into memory."""


@dataclass(frozen=True, slots=True, eq=False)
class ColouredHeat:
    """Colours of all nodes by their similarity to the current image."""

    heat: LocalisationHeatMap
    colours: dict[NodeId, Rgb8] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FindAliases(QuestionRequest):
    """Search the map for places that look alike."""


class LocalisationQuestion(Question[FindAliases]):
    """Compares the current image with the whole map."""

    name = QuestionName.WHERE
    is_offered = has_map
    about = (
        "Colour shows how near each node looks: yellow is near, violet is far. The chart shows how sure the robot "
        "was over time."
    )

    def __init__(self) -> None:
        """Start without a comparison."""
        self._node_images = NodeImageLoader()
        self._heat = LatestAnswer()
        self._asked: tuple[object, ...] | None = None

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Colour the nodes and list the best ones."""
        builder = AnswerBuilder()
        if context.weights not in ("", context.predictor.fingerprint) and context.predictor.fingerprint != NO_PREDICTOR:
            builder.add_line(
                f"This was recorded with other weights ({context.weights}), for instance ones that were fine-tuned for "
                f"it; the colours show the answers of those in use ({context.predictor.fingerprint}). To see its own, "
                "give its file of weights with --weights."
            )
        try:
            shown = self._compared(context, builder)
        except LtvnError as missing:  # Without a predictor, the results of the run itself are still shown.
            builder.add_line(str(missing))
            shown = None
        self._past_margins(context, builder)
        strokes = (*_known_aliases(context, builder), *self._perceptual_aliases(context, builder))
        nodes = shown.colours if shown is not None else {}
        return builder.build(Overlay(strokes, nodes, is_of_likeness=bool(nodes)))

    def handle_request(self, context: DebugContext, request: FindAliases) -> None:
        """Search for places that look alike."""
        self._asked = "alike", context.name, _change_count(context)

    def _compared(self, context: DebugContext, builder: AnswerBuilder) -> ColouredHeat | None:
        nodes = tuple(context.graph.nodes)
        frame = context.moment.frame
        self._heat.about(context.name)
        seen = None if frame is None else context.observation(frame)
        if not nodes or seen is None:
            builder.add_line("The map is empty." if not nodes else "There is no image at this moment.")
            return None
        image = context.as_compared(seen)
        if image is None:
            builder.add_line("The image of this moment has no depth, so it is compared with no node.")
            return None
        keyframes, missing = self._node_images.load(context)
        if missing:
            # The best node of a part of the map may be far from the best node of the whole map.
            builder.add_pending(f"Reading the images of {count_text(len(nodes), 'node')}, {missing} left")
            return None
        question = "where", context.name, frame, len(nodes), context.predictor.fingerprint
        found = self._heat(
            context.in_background, question, partial(_heat, image, nodes, keyframes, context.predictor, context.method)
        )
        if found is None:
            builder.add_pending("Comparing")
        elif isinstance(found, str):
            builder.add_line(found)
        else:
            builder.add_behind(self._heat)
            _say(found.heat, len(nodes), len(nodes) if context.is_live else min(len(nodes), MAX_NODES), builder)
            return found
        return None

    @staticmethod
    def _past_margins(context: DebugContext, builder: AnswerBuilder) -> None:
        """Show the results of the run itself, for each localisation."""
        until = context.timeline.count_until(context.instant)
        events = reversed(context.timeline.events[:until])
        latest = islice((each for each in events if isinstance(each.event, Localised)), _SHOWN_LOCALIZATIONS)
        margins = [
            (context.seconds(Instant(int(each.step), float(each.stamp))), float(each.event.margin))
            for each in reversed([*latest])
            if isinstance(each.event, Localised)
        ]
        if not margins:
            return
        looks = "look" if len(margins) == 1 else f"{len(margins)} looks"
        told = " that the robot found, from earlier images and its search area too, in the last "
        builder.add_line(Term("margin", "Margin of best over second"), f"{told}{looks}:")
        now_s = context.seconds(context.instant)
        builder.add_chart(
            StepChart(
                tuple((time, min(1.0, margin)) for time, margin in margins),
                Axis("time, s", margins[0][0], max(now_s, margins[0][0] + 1.0)),
                Axis("margin (1 and above)", *PROBABILITY),
                colour=palette.SOURCE,
                limits=((_SMALL, "below: ambiguous"),),
                now=now_s,
            )
        )
        small = sorted((margin, time) for time, margin in margins)[:_SMALLEST]
        links = (time_link(time, f"{margin:.2f} at {time:.1f} s") for margin, time in small)
        builder.add_line("Smallest: ", joined(links))

    def _perceptual_aliases(self, context: DebugContext, builder: AnswerBuilder) -> tuple[Stroke, ...]:
        link = request_link("search for places that look alike", FindAliases())
        if self._asked is None or self._asked[1] != context.name:
            builder.add_line(link)
            return ()
        keyframes, missing = self._node_images.load(context)
        if missing:
            builder.add_line("The search for perceptual aliases begins when all images are read.")
            return ()
        found = context.in_background(
            self._asked, partial(_alias_search, context.graph, keyframes, context.predictor, context.method)
        )
        if found is None:
            builder.add_pending("Searching for places that look alike, which takes a while")
            return ()
        if isinstance(found, str):
            builder.add_line(found)
            return ()
        if self._asked[2] != _change_count(context):
            builder.add_line("The map of another moment was searched; ", link, " search the map of now.")
        return _pairs(context, found, builder)


def _known_aliases(context: DebugContext, builder: AnswerBuilder) -> tuple[Stroke, ...]:
    """Name what building the map left unsure, and join the places that look alike."""
    if context.unsure is None:
        return ()
    builder.add_line(f"By the drive that made the map: {context.unsure}.")
    return context.strokes([(one, other) for one, other, _ in context.unsure.look_alikes], palette.EDGE_REMOVED)


def _change_count(context: DebugContext) -> int:
    return context.timeline.change_count_before(context.timeline.count_until(context.instant))


def _heat(
    seen: Observation, nodes: tuple[NodeId, ...], keyframes: KeyframeStore, predictor: Predictor, method: Method
) -> ColouredHeat | str:
    """Compare the image; runs in the worker's thread, which owns the images."""
    known = [node for node in nodes if node in keyframes]
    if not known:
        return "There are no images of the nodes to compare with."
    matcher = Matcher(predictor, keyframes, method.matching)
    found = localisation_heat_map(features_of(seen, matcher, predictor), known, matcher, method.localising)
    return ColouredHeat(found, _colours(found, method.localising.distance))


def _colours(found: LocalisationHeatMap, scale: float) -> dict[NodeId, Rgb8]:
    """Colour the most similar nodes by their scores; a score of D_l gives the middle of the colour scale."""
    rows = np.argsort(found.scores, kind="stable")[:_COLOURED]
    rgb = palette.score_colours(scale / (scale + np.maximum(found.scores[rows], 0.0)))
    return {found.nodes[row]: Rgb8(*colour) for row, colour in zip(rows, rgb.tolist(), strict=True)}


def _say(found: LocalisationHeatMap, count: int, most: int, builder: AnswerBuilder) -> None:
    """List the best of the nodes that were compared up to now, of `count` nodes, at most the first `most`."""
    if most < count:
        builder.add_line(f"The first {most:,} of {count:,} nodes are compared, which is the limit for a recording.")
    if len(found.nodes) < most:
        builder.add_line(f"{most - len(found.nodes):,} of these {most:,} nodes are not: their images are missing.")
    best = [found.nodes.index(node) for node in found.best(2)]
    rows: list[tuple[Inline, ...]] = []
    for rank, k in zip(("best", "second"), best, strict=False):
        node = Link(f"node {found.nodes[k]}", PointAt(found.nodes[k]))
        here = "may be here" if found.near[k] else "too far"
        rows.append((rank, node, f"{found.distances[k]:.2f}", f"{found.reachability[k]:.2f}", here))
    builder.add_table(("", "", "d", "r", ""), rows)
    if len(best) > 1:
        sure = "ambiguous" if found.margin < _SMALL else "clear"
        near = count_text(int(found.near.sum()), "node")
        margin = Strong(f"{found.margin:.2f}")
        builder.add_line("Margin of this image alone ", margin, f", {sure}; {near} near enough.")


def _alias_search(
    graph: TopologicalGraph, keyframes: KeyframeStore, predictor: Predictor, method: Method
) -> tuple[PerceptualAlias, ...] | str:
    """Search for look-alike places; runs in the worker's thread, which owns the images."""
    try:
        return find_perceptual_aliases(
            graph, Matcher(predictor, keyframes, method.matching), method, candidates=_CANDIDATES
        )
    except LtvnError as error:
        return str(error)


def _pairs(context: DebugContext, found: Sequence[PerceptualAlias], builder: AnswerBuilder) -> tuple[Stroke, ...]:
    named = f"{count_text(len(found), 'pair')} of perceptual aliases:"
    builder.add_line(named if found else "No perceptual aliases: no two places look alike.")
    for pair in found[:_PAIRS]:
        link = Link(f"{pair.first} ↔ {pair.second}", PointAt(pair.first, pair.second))
        builder.add_line(link, f": {pair.sentence}")
    return context.strokes([(pair.first, pair.second) for pair in found[:_PAIRS]], palette.EDGE_REMOVED)


class NodeImageLoader:
    """Loads and encodes the images of nodes."""

    def __init__(self) -> None:
        """Start without images."""
        self._run: Any = None
        self._keyframes: KeyframeStore | None = None
        self._read: set[NodeId] = set()
        self._reading: tuple[Any, ...] | None = None

    def load(self, context: DebugContext) -> tuple[KeyframeStore, int]:
        """Return the encoded images, for the worker's thread only, and the number of nodes still to be read."""
        if context.live_map is not None:
            return context.live_map.keyframes, 0
        run = context.name, context.predictor.fingerprint
        if run != self._run or self._keyframes is None:
            self._run = run
            self._keyframes = KeyframeStore(context.predictor)
            self._read = set()
            self._reading = None
        missing = [node for node in list(context.graph.nodes)[:MAX_NODES] if node not in self._read]
        if missing and (self._reading is None or context.in_background(self._reading, lambda: True) is not None):
            self._read_on(context, self._keyframes, missing[:_AT_ONCE])
        return self._keyframes, len(missing)

    def _read_on(self, context: DebugContext, keyframes: KeyframeStore, nodes: Sequence[NodeId]) -> None:
        self._read.update(nodes)
        seen = [picture for picture in map(context.observation, nodes) if picture is not None]
        self._reading = ("sights", *self._run, len(self._read))

        def add() -> bool:
            keyframes.add([image for image in map(context.as_compared, seen) if image is not None])
            return True

        context.in_background(self._reading, add)
