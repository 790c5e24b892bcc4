"""Whatever a hostile page sends is read or refused; no reading ends in another error."""

from collections import Counter
from itertools import islice

import pytest

from ltvn_viz.server.drive_messages import MessageError, parse_message
from ltvn_viz.server.page_messages import read_viser_message
from tests.viz.hostile_messages import HostileMessages, Targets

COUNT = 5000
TARGETS = Targets(elements=[("an-element", None)], nodes=["/graph/nodes"], graph_nodes=[3], recordings=["a.rrd"])


@pytest.mark.parametrize("seed", [1, 2])
def test_every_message_to_viser_is_read_or_refused(seed: int) -> None:
    verdicts: Counter[str] = Counter()
    for message in islice(HostileMessages(seed, TARGETS).hostile(), COUNT):
        try:
            verdicts["refused" if read_viser_message(message) is None else "read"] += 1
        except MessageError:
            verdicts["unreadable"] += 1
    assert verdicts.total() == COUNT
    assert verdicts["read"] < COUNT / 4


@pytest.mark.parametrize("seed", [1, 2])
def test_every_message_of_the_drive_socket_is_read_or_refused(seed: int) -> None:
    verdicts: Counter[str] = Counter()
    for text in islice(HostileMessages(seed, TARGETS).drive_hostile(), COUNT):
        try:
            parse_message(text)
            verdicts["read"] += 1
        except MessageError:
            verdicts["refused"] += 1
    assert verdicts["read"] < COUNT / 4
