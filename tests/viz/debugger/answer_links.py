"""Reading an answer of the Why tab, and following its links by what they say. Owns no assertion."""

from ltvn_core.analysis.answer import Answer
from ltvn_core.analysis.answer_text import answer_text
from ltvn_viz.session.inspection import LINKS_PER_VIEW
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from tests.viz.session_harness import SessionHarness


def answer_of(snapshot: Snapshot) -> Answer:
    """Return the answer on show."""
    return snapshot.inspection.answer.answer


def words(snapshot: Snapshot) -> str:
    """Return the answer on show as text."""
    return answer_text(answer_of(snapshot))


def links(snapshot: Snapshot) -> list[tuple[int, str]]:
    """Return number and label of each link of the answer."""
    first = snapshot.inspection.serial * LINKS_PER_VIEW
    return [(first + place, link.label) for place, link in enumerate(answer_of(snapshot).links())]


def follow(harness: SessionHarness, snapshot: Snapshot, label: str, *, ticks: int = 3) -> Snapshot:
    """Follow the first link whose label holds some words; raises StopIteration where there is none."""
    return harness.do(
        c.Ask(c.Action.FOLLOW, next(number for number, text in links(snapshot) if label in text)), ticks=ticks
    )
