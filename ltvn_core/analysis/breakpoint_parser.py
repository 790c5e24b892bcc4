"""Breakpoints as a person types them: "prune", "edge 12->40", "margin < 0.2", "p(12->40) < 0.5".

Owns the short text form, both ways.
"""

import re
from typing import assert_never

from ltvn_core.analysis.breakpoint_kinds import (
    BeliefCrossingBreakpoint,
    Breakpoint,
    BreakpointQuantity,
    BreakpointTrigger,
    EdgeBeliefBreakpoint,
    EdgeBreakpoint,
    EventBreakpoint,
    LocalisationBreakpoint,
    NodeBreakpoint,
)
from ltvn_core.analysis.number_parser import parse_number
from ltvn_core.config import ROBUST, BeliefConfig
from ltvn_core.errors import OptionError

BREAKPOINT_EXAMPLES = (
    *(trigger.value for trigger in BreakpointTrigger),
    "p crosses R_p",
    "p crosses 0.5",
    "margin < 0.2",
    "distance > 1",
    "r < 0.6",
    "edge 12->40",
    "node 12",
    "p(12->40) < 0.5",
    "mu(12->40) > 1.5",
)
"""One of each form, for help texts."""

_TRIGGERS = frozenset(trigger.value for trigger in BreakpointTrigger)
_EDGE = r"(\d+)\s*(?:->|→)\s*(\d+)"
_COMPARED = r"\s*([<>])\s*(\S+)"
_LOCALISATION = re.compile(rf"(margin|distance|r){_COMPARED}", re.IGNORECASE)
_ON_EDGE = re.compile(rf"(p|mu)\s*\(\s*{_EDGE}\s*\){_COMPARED}", re.IGNORECASE)
_AT_EDGE = re.compile(rf"edge\s+{_EDGE}", re.IGNORECASE)
_AT_NODE = re.compile(r"node\s+(\d+)", re.IGNORECASE)
_CROSSING = re.compile(r"p\s+crosses\s+(\S+)", re.IGNORECASE)


def parse_breakpoint(text: str, config: BeliefConfig = ROBUST.believing) -> Breakpoint:
    """Read a breakpoint; "R_p" is the threshold of `config`.

    Raises OptionError, which lists the valid forms, for anything else.
    """
    words = " ".join(text.split())
    if found := _LOCALISATION.fullmatch(words):
        return LocalisationBreakpoint(
            BreakpointQuantity(found[1].lower()), found[2] == "<", parse_number(found[3], text, "no breakpoint")
        )
    if found := _ON_EDGE.fullmatch(words):
        edge = int(found[2]), int(found[3])
        return EdgeBeliefBreakpoint(
            BreakpointQuantity(found[1].lower()), edge, found[4] == "<", parse_number(found[5], text, "no breakpoint")
        )
    if found := _AT_EDGE.fullmatch(words):
        return EdgeBreakpoint((int(found[1]), int(found[2])))
    if found := _AT_NODE.fullmatch(words):
        return NodeBreakpoint(int(found[1]))
    if found := _CROSSING.fullmatch(words):
        if found[1].lower() == "r_p":
            return prune_threshold_breakpoint(config)
        return BeliefCrossingBreakpoint(parse_number(found[1], text, "no breakpoint"))
    if words.lower() in _TRIGGERS:
        return EventBreakpoint(BreakpointTrigger(words.lower()))
    raise OptionError(f"{text[:60]!r} is no breakpoint; write one of: {', '.join(BREAKPOINT_EXAMPLES)}.")


def prune_threshold_breakpoint(config: BeliefConfig) -> BeliefCrossingBreakpoint:
    """Return the breakpoint that stops where p crosses R_p, the threshold of `config`."""
    return BeliefCrossingBreakpoint(config.prune_below, is_prune_threshold=True)


def format_breakpoint(breakpoint_: Breakpoint) -> str:
    """Return what one types for a breakpoint; parsing it gives the same breakpoint."""
    match breakpoint_:
        case EventBreakpoint(trigger):
            return trigger.value
        case BeliefCrossingBreakpoint(level, is_prune_threshold):
            return f"p crosses {'R_p' if is_prune_threshold else repr(level)}"
        case LocalisationBreakpoint(quantity, less, value):
            return f"{quantity} {'<' if less else '>'} {value!r}"
        case EdgeBeliefBreakpoint(quantity, edge, less, value):
            return f"{quantity}({edge[0]}->{edge[1]}) {'<' if less else '>'} {value!r}"
        case EdgeBreakpoint(edge):
            return f"edge {edge[0]}->{edge[1]}"
        case NodeBreakpoint(node):
            return f"node {node}"
    assert_never(breakpoint_)
