"""Every decision of a query names the rule and the number behind it."""

from operator import attrgetter

from ltvn_core.analysis.decisions import query_decisions
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.config import ROBUST, Method
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.navigation import events as e
from tests.core.navigation.mapped_world import PRESETS, mapped_rooms


@PRESETS
def test_each_decision_of_a_real_query_names_rules_of_the_method_that_drove(method: Method) -> None:
    world = mapped_rooms(method)
    _, events = world.go(world.nearest(5.0, 3.0))
    timeline = Timeline.of([e.StampedEvent(k, 0.1 * k, event) for k, event in enumerate(events)])
    decisions = query_decisions(timeline, 0, world.method)
    deciding = (e.Localised, e.Planned, e.AttemptStarted, e.AttemptEnded, e.QueryEnded)
    assert len(decisions) >= sum(isinstance(event, deciding) for event in events) > 5
    for decision in decisions:
        assert decision.rules
        assert all(rule.limit == attrgetter(rule.rule)(world.method) for rule in decision.rules)


def test_nothing_that_is_decided_later_is_told() -> None:
    world = mapped_rooms(ROBUST)
    _, events = world.go(world.nearest(5.0, 3.0))
    timeline = Timeline.of([e.StampedEvent(k, 0.1 * k, event) for k, event in enumerate(events)])
    middle = timeline.instant(len(events) // 2)
    all_of_them = query_decisions(timeline, 0, ROBUST)
    until = query_decisions(timeline, 0, ROBUST, until=middle)
    assert until == [each for each in all_of_them if each.instant.step <= middle.step]
    assert len(until) < len(all_of_them)


def test_a_rule_of_an_older_version_is_named_without_a_number() -> None:
    end = e.AttemptEnded(0, 1, 1, 2, 3, e.AttemptEnd.REACHED, 0.2, 0.9, False, "disagreed", "judging.second_look")
    events = [e.QueryStarted(0, 2), e.AttemptStarted(0, 1, 1, 2, 3, PoseRow(0.5, 0.0, 0.0), 0.9), end]
    timeline = Timeline.of([e.StampedEvent(k, 0.1 * k, event) for k, event in enumerate(events)])
    judged = query_decisions(timeline, 0, ROBUST)[-1].rules[-1]
    assert (judged.rule, judged.limit) == ("judging.second_look", None)
    assert "older version" in judged.text


def test_a_query_that_never_was_has_no_decisions() -> None:
    assert query_decisions(Timeline(), 3, ROBUST) == []
