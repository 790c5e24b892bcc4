"""Following links of the Why tab by what they say. Owns no assertion."""

import re

from ltvn_viz.session import commands as c
from ltvn_viz.session.snapshot import Snapshot
from tests.viz.session_harness import SessionHarness

_LINK = re.compile(r'data-ltvn-action="follow" data-id="(\d+)">([^<]*)</a>')


def links(snapshot: Snapshot) -> list[tuple[int, str]]:
    """Return number and label of each link of the answer."""
    return [(int(number), label) for number, label in _LINK.findall(snapshot.inspection.html)]


def follow(harness: SessionHarness, snapshot: Snapshot, label: str, *, ticks: int = 3) -> Snapshot:
    """Follow the first link whose label holds some words; raises StopIteration where there is none."""
    return harness.do(c.FollowLink(next(number for number, text in links(snapshot) if label in text)), ticks=ticks)
