"""What driving teaches a map, by name, for any navigation system."""

from dataclasses import replace

import pytest

from ltvn_core.config import PAPER, ROBUST
from ltvn_core.errors import OptionError
from ltvn_core.graph.ltvn import LifelongMaintenance, ltvn_system
from ltvn_core.graph.navigation_system import NoMaintenance
from ltvn_core.graph.presence.edge_presence import KnownPresence
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.brm import BayesianEdges
from ltvn_core.systems.maintenance import recorded_filter, with_maintenance
from ltvn_core.systems.maintenance_names import MAINTENANCE_NAMES
from ltvn_core.systems.registry import own_systems


def test_every_system_can_have_every_maintenance() -> None:
    truth = KnownPresence(lambda graph: ())
    for entry in own_systems():
        system = entry.factory(ROBUST)
        for name in MAINTENANCE_NAMES:
            changed = with_maintenance(system, name, truth=truth)
            knows_presence = name in ("persistent", "forgetting", "fremen", "truth")
            assert (changed.presence is not None) == knows_presence
            assert (type(changed.maintenance) is NoMaintenance) == (name == "static")
            assert (changed.views is not None) == knows_presence
            own = {part: getattr(system, part) for part in ("maintenance", "presence", "views")}
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


def test_a_system_knows_no_presence_unless_it_is_asked_for() -> None:
    assert ltvn_system(ROBUST).presence is None


def test_what_cannot_be_is_refused_with_what_can() -> None:
    with pytest.raises(OptionError, match="static, paper, robust, brm, persistent"):
        with_maintenance(ltvn_system(ROBUST), "kalman")
    with pytest.raises(OptionError, match="simulated worlds"):
        with_maintenance(ltvn_system(ROBUST), "truth")


def test_what_is_known_of_the_world_closes_edges_at_once() -> None:
    known = KnownPresence(lambda graph: [(1, 2)])
    assert known.probabilities(TopologicalGraph(), 0.0) == {(1, 2): 0.0}
