"""What driving teaches a map, by name, for any navigation system."""

from dataclasses import replace

import pytest

from ltvn_core.config import PAPER, ROBUST
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.worlds.world_truth import KnownPresence
from ltvn_core.graph.deltas import BeliefUpdated
from ltvn_core.graph.ltvn import LifelongMaintenance, ltvn_system
from ltvn_core.graph.navigation_system import NoMaintenance
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.presence.presence_filter import PERSISTENT
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.brm import BayesianEdges
from ltvn_core.systems.maintenance import recorded_filter, with_maintenance
from ltvn_core.systems.maintenance_names import MAINTENANCE_NAMES
from ltvn_core.systems.registry import own_systems
from tests.core.graph.small_maps import edge_added, node_added


def test_every_system_can_have_every_maintenance() -> None:
    truth = KnownPresence(lambda graph: ())
    for entry in own_systems():
        system = entry.factory(ROBUST)
        for name in MAINTENANCE_NAMES:
            changed = with_maintenance(system, name, truth=truth, room_of=lambda node: 0)
            knows_presence = name in ("persistent", "truth")
            assert changed.follows_presence == knows_presence
            assert (type(changed.maintenance) is NoMaintenance) == (name == "static")
            own = {part: getattr(system, part) for part in ("maintenance", "presence")}
            assert replace(changed, **own) == system


def test_the_papers_maintenance_keeps_what_was_measured_for_the_predictor() -> None:
    measured = replace(ROBUST, believing=replace(ROBUST.believing, p_success_if_not=0.123, sigma2=0.456))
    maintenance = with_maintenance(ltvn_system(measured), "paper").maintenance
    assert isinstance(maintenance, LifelongMaintenance)
    believing = maintenance.method.believing
    assert (believing.p_success_if_not, believing.sigma2) == (0.123, 0.456)
    assert believing.prune_after_failures == PAPER.believing.prune_after_failures


def test_brms_update_can_maintain_the_map_of_any_system_and_closes_nothing_for_the_moment() -> None:
    changed = with_maintenance(ltvn_system(ROBUST), "brm")
    assert isinstance(changed.maintenance, BayesianEdges)
    assert recorded_filter("brm") is None


@pytest.mark.parametrize("name", ["", "persistent", "fremen", "forgetting"])
def test_recordings_of_filters_that_left_are_looked_at_with_the_one_that_stayed(name: str) -> None:
    assert recorded_filter(name) is PERSISTENT


def test_a_system_knows_no_presence_unless_it_is_asked_for() -> None:
    assert not ltvn_system(ROBUST).follows_presence


def test_what_cannot_be_is_refused_with_what_can() -> None:
    with pytest.raises(OptionError, match="static, paper, robust, brm, brm-rooms, persistent"):
        with_maintenance(ltvn_system(ROBUST), "kalman")
    with pytest.raises(OptionError, match="'brm-rooms' needs to know from the simulator which rooms"):
        with_maintenance(ltvn_system(ROBUST), "brm-rooms")
    with pytest.raises(OptionError, match="simulated worlds"):
        with_maintenance(ltvn_system(ROBUST), "truth")


def test_between_rooms_one_drive_tells_of_all_edges_that_lead_the_same_way() -> None:
    ends = ((0, 1), (1, 2), (0, 3), (2, 0), (3, 4))
    graph = TopologicalGraph([*map(node_added, range(5)), *(edge_added(*each) for each in ends)])
    rooms = {0: 1, 1: 1, 2: 2, 3: 2, 4: None}
    maintenance = with_maintenance(ltvn_system(ROBUST), "brm-rooms", room_of=rooms.get).maintenance

    def told_of(source: int, target: int) -> dict[tuple[int, int], int]:
        failed = AttemptEvidence(source=source, target=target, distance=1.0, succeeded=False)
        found = [each for each in maintenance.after_attempt(graph, failed) if isinstance(each, BeliefUpdated)]
        assert all(each.belief.p < 0.9 for each in found)
        return {(each.source, each.target): each.attempts for each in found}

    assert told_of(1, 2) == {(1, 2): 1, (0, 3): 0}
    assert told_of(2, 0) == {(2, 0): 1}
    assert told_of(0, 1) == {(0, 1): 1}
    assert told_of(3, 4) == {(3, 4): 1}
    assert told_of(4, 0) == {}


def test_what_is_known_of_the_world_closes_edges_at_once() -> None:
    known = KnownPresence(lambda graph: [(1, 2)])
    assert known.probabilities(TopologicalGraph(), 0.0) == {(1, 2): 0.0}
