"""Faults are planted where the truth says that they are faults, and the shipped recording tells of each."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.config import BeliefConfig
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import MapError
from ltvn_core.evaluation.edge_accuracy import edge_accuracy
from ltvn_core.evaluation.reports.map_svg import recorded_ground_truth
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.navigation.events import AttemptEnded, Judged, Outcome, Planned, QueryEnded, QueryStarted
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Features, Observation, Prediction
from tests.core.evaluation.ground_truth_map import PLACES, map_with_edges, observation_of, truth
from tests.repository import DEMO_FAULT, DEMO_MAP
from tools.plant_faults import FaultKind, missing_edge, perceptual_alias, plant_faults, spurious_edge

ROUND = ((5, 1), (1, 5), (1, 2), (2, 1), (2, 3), (3, 2), (3, 6), (6, 3))
"""From one side of the wall through the opening to the other."""


class BlindedPredictor:
    """Takes every image for its neighbour straight ahead. Implements `ltvn_core.types.Predictor`."""

    fingerprint = "dazzled"
    camera = LOCOBOT.camera

    def encode(self, observations: Sequence[Observation]) -> Features:
        return np.array([[seen.step] for seen in observations])

    def predict(self, sources: Features, targets: Features) -> Prediction:
        sure = np.where((sources[:, 0] == 1) & (targets[:, 0] == 4), 0.9, 0.2)
        return Prediction(sure, np.tile([0.5, 0.0, 0.0], (len(sure), 1)))


def test_a_spurious_edge_leads_through_a_wall_and_the_map_is_sure_of_it() -> None:
    graph, config = map_with_edges(*ROUND, nodes=(1, 2, 3, 5, 6)), BeliefConfig()
    fault = spurious_edge(graph, truth(), config, detour_m=2.0)
    assert (fault.kind, fault.start, fault.goal) == (FaultKind.SPURIOUS_EDGE, 5, 6)
    for delta in fault.deltas:
        graph.apply(delta)
    assert graph.edges[5, 6].belief.p == config.p_cap
    assert set(fault.edges) == {(5, 6), (6, 5)} <= truth().spurious(graph)


def test_a_spurious_edge_joins_no_two_pieces() -> None:
    with pytest.raises(MapError, match="wall"):
        spurious_edge(map_with_edges((1, 2), nodes=(1, 2, 3, 5, 6)), truth(), BeliefConfig(), detour_m=2.0)


def test_a_perceptual_alias_edge_joins_what_the_network_is_surest_of() -> None:
    keyframes = KeyframeStore(BlindedPredictor())
    keyframes.add([observation_of(node) for node in PLACES])
    graph = map_with_edges(*ROUND, (3, 4), (4, 3), nodes=(1, 2, 3, 4, 5, 6))
    fault = perceptual_alias(graph, truth(), keyframes, BlindedPredictor(), BeliefConfig(), near=1.5)
    assert (fault.start, fault.goal) == (1, 4)
    for delta in fault.deltas:
        graph.apply(delta)
    assert graph.edges[1, 4].belief.p == pytest.approx(0.9)


def test_a_small_map_has_no_passage_to_cut() -> None:
    with pytest.raises(MapError, match="passage"):
        missing_edge(map_with_edges((1, 2), (2, 1), nodes=(1, 2)), truth())


@pytest.fixture(scope="module")
def shipped() -> Recording:
    return Recording.open(DEMO_FAULT)


def test_the_shipped_recording_is_small_and_holds_all_three_faults(shipped: Recording) -> None:
    assert DEMO_FAULT.stat().st_size < 3_000_000
    before = shipped.graph_at(next(s.step for s in shipped.events if isinstance(s.event, QueryStarted)) - 1)
    known = recorded_ground_truth(shipped, before)
    assert known is not None
    planted = {said["kind"]: {tuple(edge) for edge in said["edges"]} for said in shipped.meta.config["faults"]}
    found = edge_accuracy(before, known, near=2.0)
    assert found.spurious == planted["spurious-edge"] | planted["look-alike"]
    assert planted["missing-edge"] <= {(pair.source, pair.target) for pair in found.missing}
    assert len(strongly_connected_components(before)) == 2


def test_each_shipped_query_meets_its_fault_and_fails(shipped: Recording) -> None:
    events = [stamped.event for stamped in shipped.events]
    ends = {event.query: event.outcome for event in events if isinstance(event, QueryEnded)}
    attempts_ended = [event for event in events if isinstance(event, AttemptEnded)]
    assert not any(event.reached for event in events if isinstance(event, Judged))
    for said in shipped.meta.config["faults"]:
        driven = [
            ended
            for ended in attempts_ended
            if ended.query == said["query"] and [ended.source, ended.target] in said["edges"]
        ]
        plans = [e.nodes for e in events if isinstance(e, Planned) and e.query == said["query"]]
        match said["kind"]:
            case "spurious-edge":
                assert driven
                assert not any(ended.succeeded for ended in driven)
            case "look-alike":
                assert any(ended.succeeded for ended in driven)
                assert ends[said["query"]] is Outcome.ARRIVED
            case "missing-edge":
                assert ends[said["query"]] is Outcome.NO_PATH
                assert set(plans) == {()}
            case unknown:
                pytest.fail(f"no such fault: {unknown}")


@pytest.mark.slow
def test_planting_writes_a_recording_in_which_the_robot_meets_the_fault_and_fails(tmp_path: Path) -> None:
    planted = plant_faults(DEMO_MAP, tmp_path / "faults.rrd", (FaultKind.SPURIOUS_EDGE,))

    assert planted.outcome.reached == 0
    (said,) = Recording.open(tmp_path / "faults.rrd").meta.config["faults"]
    assert {tuple(edge) for edge in said["edges"]} == {*planted.faults[0].edges}
