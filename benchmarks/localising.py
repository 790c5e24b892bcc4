"""What it costs to find out where an image was taken, in maps of 1,000 to 100,000 nodes, and what a node takes.

The first 1,000 nodes are looks at the demo apartment. All others are made up of these: in each thousand the numbers of
every descriptor are shuffled in another way, so that they are like descriptors and like those of no other thousand.
"""

import gc
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np
import psutil

from benchmarks.measurement import Measurement, alternating, measured, seconds
from benchmarks.recording import demo_observations
from ltvn_core.config import ROBUST
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import best_localisation, near_enough
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.place_belief import PlaceBelief
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.image_features import place_columns
from ltvn_core.network.predictor import NetworkPredictor, load_predictor
from ltvn_core.types import Features, Observation

REAL, LOOKS = 1_000, 20
"""Nodes that are looks at an apartment, and other looks at it that are searched for."""
BUDGETS_MS = {REAL: 5, 10_000: 15, 100_000: 50}
_SHIFT_M = 100.0
"""So far apart the thousands of nodes lie."""


def lost_look_s(count: int) -> float:
    """Return the time in seconds of a look of a robot that does not know where it is, in a map of `count` nodes."""
    predictor = load_predictor()
    seen = demo_observations(REAL + LOOKS)
    features = predictor.encode(seen[:REAL])
    graph, keyframes = TopologicalGraph(), KeyframeStore(predictor)
    for k in range(count // REAL):
        keyframes.add(_moved(seen[:REAL], k), _shuffled(features, k))
        _grow(graph, _moved(seen[:REAL], k))
    return seconds(_lost_look(predictor, graph, Matcher(predictor, keyframes, ROBUST.matching), seen[REAL:]), 21)


def localise() -> list[Measurement]:
    """Search ever larger maps, as a robot does that does not know where it is, and one as a robot that does."""
    predictor = load_predictor()
    seen = demo_observations(REAL + LOOKS)
    nodes, looks = seen[:REAL], seen[REAL:]
    features = predictor.encode(nodes)
    graph, keyframes = TopologicalGraph(), KeyframeStore(predictor)
    matcher = Matcher(predictor, keyframes, ROBUST.matching)
    found, kept_kb = list[Measurement](), 0.0
    for count, budget_ms in BUDGETS_MS.items():
        kept_kb -= _memory_kb()
        thousands = range(len(keyframes) // REAL, count // REAL)
        for k in thousands:
            keyframes.add(_moved(nodes, k), _shuffled(features, k))
        kept_kb += _memory_kb()
        for k in thousands:
            _grow(graph, _moved(nodes, k))
        look = _lost_look(predictor, graph, matcher, looks)
        if count == REAL:
            held = keyframes.held(tuple(graph.nodes))
            assert held is not None, "this predictor makes keys"
            ratio = alternating(
                lambda held=held: predictor.predict_among(predictor.encode(looks[:1]), held),
                lambda: predictor.encode(nodes),
                3,
            )
            found.append(measured("localise in 1,000 nodes against stacked pairs", ratio, "x faster", at_least=100))
            found.append(
                measured("best node of a full search found", _recall(predictor, matcher, looks), "%", at_least=99.5)
            )
        found.append(
            measured(f"look of a lost robot, {count:,} nodes", 1e3 * seconds(look, 21), "ms", at_most=budget_ms)
        )
    few = tuple(graph.nodes)[:8]
    look_s = seconds(lambda: matcher.match(predictor.encode(looks[:1]), few), 21)
    found.append(measured("look among the 8 nodes around a known place", 1e3 * look_s, "ms", at_most=5))
    return [*found, measured("memory of a node beyond its image", kept_kb / len(keyframes), "kB", at_most=1)]


def _lost_look(
    predictor: NetworkPredictor, graph: TopologicalGraph, matcher: Matcher, looks: Sequence[Observation]
) -> Callable[[], None]:
    """Return what a robot does that does not know where it is: encode an image, search the map, follow the places."""
    belief = PlaceBelief(graph, matcher)
    endless = cycle(looks)

    def look() -> None:
        seen = next(endless)
        belief.forget()
        matches = matcher.match(predictor.encode([seen]), belief.nodes_to_ask(seen.odometry))
        belief.see(seen.odometry, matches, near_enough(matches, ROBUST.localising))

    return look


def _recall(predictor: NetworkPredictor, matcher: Matcher, looks: Sequence[Observation]) -> float:
    """Return for how many looks, in percent of those a full search places, the quick one finds its best node too."""
    nodes = tuple(matcher.keyframes.frames)
    in_full = Matcher(load_predictor(prefilter_from=None), matcher.keyframes, ROBUST.matching)
    are_found = list[bool]()
    for look in looks:
        features = predictor.encode([look])
        full = in_full.match(features, nodes)
        best = best_localisation(full, full.distances, near_enough(full, ROBUST.localising), "").node
        if best is not None:
            quick = matcher.match(features, nodes)
            are_found.append(bool(near_enough(quick, ROBUST.localising)[nodes.index(best)]))
    return 100 * sum(are_found) / len(are_found)


def _moved(nodes: Sequence[Observation], thousand: int) -> list[Observation]:
    """Return images of the same content in another place."""
    shift = np.array([_SHIFT_M * thousand, 0, 0])
    return [replace(node, step=REAL * thousand + k, odometry=node.odometry + shift) for k, node in enumerate(nodes)]


def _shuffled(features: Features, thousand: int) -> Features:
    """Return features (N, F) with the numbers of descriptors and place vectors in another order; as is for 0."""
    if not thousand:
        return features
    size = PairArchitecture()
    rng = np.random.default_rng(thousand)
    shuffled = features.copy()
    order = rng.permutation(size.descriptor)
    descriptors = (len(features), size.token_count, size.descriptor)
    end = size.token_count * size.descriptor
    shuffled[:, :end] = features[:, :end].reshape(descriptors)[:, :, order].reshape(len(features), -1)
    for columns in place_columns(size):
        shuffled[:, columns] = features[:, columns][:, rng.permutation(size.place)]
    return shuffled


def _grow(graph: TopologicalGraph, images: Sequence[Observation]) -> None:
    """Add images as nodes, each joined to the one before."""
    for image in images:
        graph.apply(NodeAdded(node_from_observation(image), Cause.BUILD))
        before = graph.nodes.get(image.step - 1)
        if before is not None:
            way = pose_row(relative(np.array(before.odometry), image.odometry))
            graph.apply(EdgeAdded(Edge(before.id, image.step, way, Belief(0.9, 0.5, 0.02)), Cause.BUILD))


def _memory_kb() -> float:
    """Return what this process holds, files that are mapped left out."""
    gc.collect()
    held = psutil.Process().memory_info()
    return (held.rss - getattr(held, "shared", 0)) / 1e3
