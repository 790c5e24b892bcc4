"""The page under attack: whatever is sent to it, nothing changes for others, and it goes on."""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import TypeVar

import pytest

from ltvn_viz.server.drive_messages import MessageError, parse_message
from ltvn_viz.server.page_messages import read_viser_message
from tests.browser.flat_app import FlatApp, serving
from tests.campaigns.tally import Tally
from tests.viz.hostile_messages import HostileMessages, Targets, is_readable, targets_of
from tests.viz.page_sockets import PageSockets, open_sockets
from tests.viz.test_watchers import require_unchanged, state_of

SEED = 14
WATCHERS = 30
IDLE_S = 3600.0
"""The driver does nothing meanwhile and keeps the seat all the same; a free one would be anybody's."""
BATCH = 600
"""Messages after which the page must have judged them all; also the most that may be on their way."""

_Sent = TypeVar("_Sent")


@contextmanager
def crowd(folder: Path, watchers: int) -> Iterator[tuple[FlatApp, PageSockets, list[PageSockets]]]:
    """Serve the page to a driver and to watchers, who all read what they are told."""
    (folder / "old.rrd").write_bytes(b"")
    with serving(folder, idle_s=IDLE_S) as app, ExitStack() as stack:
        pages = [stack.enter_context(open_sockets(app.server)) for _ in range(1 + watchers)]
        for page in pages:
            stack.enter_context(page.reading())
            stack.enter_context(page.staying())
        pages[0].take_seat()
        yield app, pages[0], pages[1:]


def aims(app: FlatApp, pages: Iterable[PageSockets]) -> Targets:
    """Return all that hostile pages could aim at."""
    graph_nodes = app.harness.now.moment.graph.ids.tolist()
    return targets_of(app.server, graph_nodes, ["old.rrd"], [page.client for page in pages])


def take(messages: Iterator[_Sent], numbers: range) -> list[_Sent]:
    return list(islice(messages, len(numbers)))


@pytest.mark.campaign(asked=30_000, share=0.07)
def test_watchers(tally: Tally, tmp_path: Path) -> None:
    with crowd(tmp_path, WATCHERS) as (app, driver, watchers):
        before = state_of(app)
        messages = [HostileMessages(SEED + each, aims(app, [driver, watchers[each]])) for each in range(WATCHERS)]
        turns = deque(zip(watchers, [(m.well_formed(), m.drive_well_formed()) for m in messages], strict=True))
        for numbers in tally.batches(BATCH):
            for _ in numbers[::2]:
                watcher, (panels, drive) = turns[0]
                watcher.panels.send(next(panels))
                watcher.drive.send(next(drive))
                turns.rotate()
            for watcher in watchers:
                watcher.settle()
            tally.add(len(numbers))
        tally.add(watchers=WATCHERS)
        require_unchanged(app, driver, watchers[0], before)


@pytest.mark.campaign(asked=40_000, share=0.03)
def test_hostile_messages_sent(tally: Tally, tmp_path: Path) -> None:
    with crowd(tmp_path, 1) as (app, driver, (watcher,)):
        before = state_of(app)
        # Bytes that are no message at all close the socket of the page that sent them, and the app's tests see to that.
        messages = filter(is_readable, HostileMessages(SEED, aims(app, [driver, watcher])).hostile())
        for numbers in tally.batches(BATCH):
            for message in take(messages, numbers):
                watcher.panels.send(message)
            watcher.settle()
            tally.add(len(numbers))
        require_unchanged(app, driver, watcher, before)


@pytest.mark.campaign(asked=150_000, share=0.02)
def test_hostile_messages_read(tally: Tally) -> None:
    targets = Targets([("an-element", None)], ["/graph/nodes"], [3], ["a.rrd"])
    panels, drive = HostileMessages(SEED, targets).hostile(), HostileMessages(SEED, targets).drive_hostile()

    def read(numbers: range) -> None:
        for viser_message, text in zip(take(panels, numbers[::2]), take(drive, numbers[::2]), strict=True):
            tally.add(2, accepted=_is_accepted(viser_message) + _is_text_accepted(text))

    tally.spread(read, batch=BATCH)
    assert tally.failures == []
    assert tally.findings["accepted"] < tally.done / 4


def _is_accepted(message: bytes) -> bool:
    """Tell whether a message is taken; any other error than a refusal is raised."""
    try:
        return read_viser_message(message) is not None
    except MessageError:
        return False


def _is_text_accepted(text: str | bytes) -> bool:
    try:
        parse_message(text)
    except MessageError:
        return False
    return True
