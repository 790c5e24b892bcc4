"""Decisions of the robot in a query, with the rules and numbers behind them.

A recording holds the outcome of each decision and the thresholds of its method; this module joins the two. Verdicts and
notes name their rule in the recording; this module owns the rules of all other events.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple, TypeAlias

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, QueryRecord
from ltvn_core.config import Method
from ltvn_core.graph import deltas as d
from ltvn_core.graph.deltas import Cause
from ltvn_core.graph.place_belief import LIKELY
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_table import describe_event


class RuleUse(NamedTuple):
    """A rule that took part in a decision."""

    rule: str
    """Name of the rule in `config`, such as localising.distance."""
    limit: float | bool | None
    """Value of the rule in the run; None for a rule of an older version."""
    found: float | None = None
    """The recorded number that was compared with the value; None if the rule compares none."""

    @property
    def text(self) -> str:
        """The rule in words, its value, and the number that was compared with it."""
        words = self.rule.rpartition(".")[2].replace("_", " ")
        if self.limit is None:
            return f"{words}: a rule of an older version"
        limit = ("on" if self.limit else "off") if isinstance(self.limit, bool) else f"{self.limit:g}"
        return f"{words}: {limit}" if self.found is None else f"{words}: {self.found:.2f}, limit {limit}"


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision of the robot."""

    instant: Instant
    text: str
    """The decision in one sentence."""
    rules: tuple[RuleUse, ...]
    """The rules behind it; none if the method leaves no choice."""


_Rules: TypeAlias = dict[str, float | None]
"""Rules behind an event, each with the number that it compared; None for a rule that compares none."""
_ENDS = {
    e.AttemptEnd.BLOCKED: "driving.depth_veto",
    e.AttemptEnd.LOST: "driving.lost_reachability",
}
"""Rule for each way in which a rule can end an attempt."""
_OUTCOMES = {
    e.Outcome.NO_PATH: "recovering.give_up_after_looks",
    e.Outcome.LOST: "recovering.give_up_after_looks",
    e.Outcome.STEP_LIMIT: "recovering.step_limit",
    e.Outcome.COLLISION_LIMIT: "recovering.collision_limit",
}
"""Rule for each outcome of a query but an arrival, whose event names its rule."""
_ADDITIONS = {
    Cause.NOVEL: ("expanding.novel_after_looks",),
    Cause.EXPAND: ("expanding.search_reserve", "expanding.strict"),
}
"""Rules for each cause that adds nodes and edges during a query."""


def query_decisions(timeline: Timeline, query: int, method: Method, *, until: Instant | None = None) -> list[Decision]:
    """Return the decisions of a query in their order.

    Args:
        timeline: The run.
        query: Number of the query.
        method: The thresholds of the run.
        until: Leave out what was decided later.
    """
    record = next((each for each in timeline.queries if each.id == query), None)
    if record is None:
        return []
    return list(_decisions(record, timeline, method, min(record.last + 1, timeline.count_until(until))))


def _decisions(query: QueryRecord, timeline: Timeline, method: Method, after: int) -> Iterator[Decision]:
    """Yield the decisions of a query before event number `after`."""
    failed = 0
    place_p = {plan.event: plan.place_p for plan in query.plans}
    for number, stamped in enumerate(timeline.events[query.first : after], query.first):
        event = stamped.event
        rules = _rules(event, failed)
        if isinstance(event, e.AttemptEnded):
            failed += not event.succeeded
        p = place_p.get(number)
        if rules is not None and p is not None and p <= LIKELY:
            rules["localising.follow_places"] = p  # Edges that no image supports cost more.
        if rules is None:
            continue
        used = tuple(RuleUse(rule, _limit(method, rule), found) for rule, found in rules.items())
        yield Decision(timeline.instant(number), describe_event(event).sentence, used)


def _limit(method: Method, rule: str) -> float | bool | None:
    try:
        return attrgetter(rule)(method)
    except AttributeError:
        return None


def _rules(event: e.Event, failed: int) -> _Rules | None:
    """Return the rules behind an event; None if the event decides nothing.

    `failed` is the number of attempts of the query that failed before.
    """
    match event:
        case e.Localised():
            return _localising_rules(event)
        case e.Planned(nodes=nodes):
            return dict.fromkeys(["planning.belief_weight", *["planning.failure_penalty"] * bool(failed and nodes)])
        case e.AttemptStarted(source=source, reachability=reachability):
            # Whether to approach the node first depends on the view of the next node, which no event holds.
            return {"driving.departure_reachability": None if source is None else reachability}
        case e.AttemptEnded(end=end, rule=rule):
            stopped: _Rules = {_ENDS[end]: None} if end in _ENDS else {}
            judged = {"judging.success_distance": event.distance, "judging.success_reachability": event.reachability}
            return stopped | ({rule: judged.get(rule)} if rule else {})
        case e.StateChanged(state=e.NavigatorState.RECOVERING):
            return {"recovering.give_up_after_looks": None}
        case e.GraphChanged(delta):
            return _map_rules(delta)
        case e.QueryEnded(rule=e.BY_IMAGE):
            return {"judging.arrive_distance": event.distance, e.BY_IMAGE: event.reachability}
        case e.QueryEnded(rule=e.BY_WAYPOINT):
            return {}  # Nothing was left to drive.
        case e.QueryEnded(outcome=outcome, rule=rule):
            named = rule or _OUTCOMES.get(outcome)
            return {named: None} if named else {}
        case e.Note(rule=rule) if rule:
            return {rule: None}
        case _:
            return None


def _localising_rules(event: e.Localised) -> _Rules:
    near: _Rules = {
        "localising.distance": event.distance if math.isfinite(event.distance) else None,
        "localising.reachability": event.reachability,
    }
    has_place = event.node is not None and event.probability is not None
    return near | ({"localising.follow_places": None} if has_place else {})


def _map_rules(delta: d.GraphDelta) -> _Rules | None:
    match delta:
        case d.BeliefUpdated(belief=belief, cause=Cause.ATTEMPT):
            assumed = dict.fromkeys(["believing.p_success_if_reachable", "believing.p_success_if_not"])
            return assumed | {"believing.p_cap": belief.p}
        case d.EdgePruned(cause=Cause.ATTEMPT):
            names = ("prune_below", "prune_after_failures", "failures_per_success")
            return dict.fromkeys(f"believing.{name}" for name in names)
        case d.NodeAdded(cause=cause) | d.EdgeAdded(cause=cause) if cause in _ADDITIONS:
            return dict.fromkeys(_ADDITIONS[cause])
        case _:
            return None
