"""What pages may say to viser: real sockets, messages by hand, and the driver and a watcher at once."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice

import pytest
import viser
from websockets.exceptions import ConnectionClosed

from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.page_gate import Verdict
from tests.viz.hostile_messages import HostileMessages, is_readable, targets_of
from tests.viz.page_sockets import ANY_PACE, PageSockets, open_sockets
from tests.waiting import PATIENCE_S, until


@dataclass
class House:
    """A server with one control of each kind, a driver and a watcher."""

    server: GuardedServer
    driver: PageSockets
    watcher: PageSockets
    number: viser.GuiInputHandle[float]
    button: viser.GuiButtonHandle
    choice: viser.GuiDropdownHandle[str]
    text: viser.GuiInputHandle[str]
    box: viser.GuiInputHandle[bool]
    pressed: list[int | None]


@pytest.fixture
def house() -> Iterator[House]:
    with ExitStack() as stack:
        server = stack.enter_context(GuardedServer(pace=ANY_PACE))
        gui = server.gui
        pressed: list[int | None] = []
        number = gui.add_number("Minutes", 3.0, min=1.0, max=60.0)
        button = gui.add_button("Open")
        choice = gui.add_dropdown("Recording", ["a.rrd", "b.rrd"])
        text = gui.add_text("What", "")
        box = gui.add_checkbox("Follow", initial_value=False)
        button.on_click(lambda event: pressed.append(event.client_id))
        driver, watcher = (stack.enter_context(open_sockets(server)) for _ in range(2))
        driver.take_seat()
        yield House(server, driver, watcher, number, button, choice, text, box, pressed)


def test_the_driver_uses_every_control(house: House) -> None:
    for element, value in ((house.number, 7), (house.choice, "b.rrd"), (house.text, "hello"), (house.box, True)):
        house.driver.set(element._impl.uuid, value)
    house.driver.set(house.button._impl.uuid, True)
    until(lambda: house.pressed)
    house.driver.settle()
    assert (house.number.value, house.choice.value, house.text.value, house.box.value) == (7.0, "b.rrd", "hello", True)


def test_a_watcher_changes_no_shared_control_and_is_told_who_drives(house: House) -> None:
    for element, value in ((house.number, 7), (house.choice, "b.rrd"), (house.text, "hello"), (house.box, True)):
        house.watcher.set(element._impl.uuid, value)
    house.watcher.set(house.button._impl.uuid, True)
    house.watcher.settle()
    assert (house.number.value, house.choice.value, house.text.value, house.box.value) == (3.0, "a.rrd", "", False)
    assert house.pressed == []
    assert house.server.gate.counts[Verdict.WITHOUT_RIGHT] == 5
    told = [house.watcher.drive.recv(timeout=PATIENCE_S) for _ in range(4)]
    assert any('"refused"' in str(text) for text in told)


def test_a_page_that_names_itself_as_another_or_as_nobody_has_no_right(house: House) -> None:
    assert not house.server._drive.may_drive(None)
    assert not house.server._drive.may_drive("0" * 32)
    assert house.server._drive.may_drive(house.driver.key)


def test_the_first_to_use_a_control_takes_a_free_seat(house: House) -> None:
    house.driver.ask("release")
    until(lambda: house.server.seat.state_of(1).driver is None)
    house.watcher.set(house.number._impl.uuid, 9)
    until(lambda: house.number.value == 9.0)
    assert house.server.seat.state_of(1).driver == house.watcher.number


@pytest.mark.parametrize("value", [1e300, float("nan"), float("inf"), 0, 61, -(2**63), True, "7", None, [7], {"a": 1}])
def test_a_number_that_its_control_does_not_take_changes_nothing(house: House, value: object) -> None:
    house.driver.set(house.number._impl.uuid, value)
    house.driver.settle()
    assert house.number.value == 3.0


@pytest.mark.parametrize("name", ["removed", "disabled", "visible", "props", "update_cb", "gui_api"])
def test_nothing_of_a_control_but_its_value_can_be_changed(house: House, name: str) -> None:
    before = getattr(house.button._impl, name, None)
    house.driver.say({"type": "GuiUpdateMessage", "uuid": house.button._impl.uuid, "updates": {name: True}})
    house.driver.settle()
    assert getattr(house.button._impl, name, None) is before
    house.driver.set(house.button._impl.uuid, True)
    until(lambda: house.pressed)


def test_a_hidden_or_disabled_control_and_an_unlisted_choice_are_refused(house: House) -> None:
    house.button.visible = False
    house.number.disabled = True
    for element, value in (
        (house.button, True),
        (house.number, 8),
        (house.choice, "../c.rrd"),
        (house.text, "x" * 20_000),
    ):
        house.driver.set(element._impl.uuid, value)
    house.driver.settle()
    assert (house.pressed, house.number.value, house.choice.value, house.text.value) == ([], 3.0, "a.rrd", "")


def test_bytes_that_are_no_message_cost_only_their_own_page_its_socket(house: House) -> None:
    house.watcher.panels.send(b"\xc1")
    with pytest.raises(ConnectionClosed):
        list(house.watcher.panels)
    house.driver.set(house.number._impl.uuid, 5)
    until(lambda: house.number.value == 5.0)


def test_hostile_messages_change_nothing_and_leave_the_page_working(house: House) -> None:
    before = _values(house)
    messages = HostileMessages(1, targets_of(house.server)).hostile()
    for message in islice(filter(is_readable, messages), 1500):
        house.watcher.panels.send(message)
    house.watcher.settle()
    assert _values(house) == before
    assert house.server.gate.counts[Verdict.ADMITTED] < 20
    house.driver.set(house.button._impl.uuid, True)
    until(lambda: house.pressed)


def test_an_upload_beyond_the_limit_or_out_of_order_is_refused(house: House) -> None:
    button = house.server.gui.add_upload_button("Upload")
    came: list[bytes] = []
    button.on_upload(lambda event: came.append(event.target.value.content))
    start = {
        "type": "FileTransferStartUpload",
        "source_component_uuid": button._impl.uuid,
        "transfer_uuid": "one",
        "filename": "a.png",
        "mime_type": "image/png",
        "part_count": 1,
        "size_bytes": 4,
    }
    part = {
        "type": "FileTransferPart",
        "source_component_uuid": button._impl.uuid,
        "transfer_uuid": "one",
        "part_index": 0,
        "content": b"abcd",
    }
    refused = (
        (start | {"source_component_uuid": house.button._impl.uuid}, part),
        (start | {"size_bytes": 2**30, "part_count": 2048}, part),
        (start | {"part_count": 900}, part),
        (start, part | {"content": b"abcdefgh"}),
        (start, part | {"part_index": 1}),
        (start, part | {"transfer_uuid": "two"}),
    )
    for beginning, piece in refused:
        house.driver.say(beginning)
        house.driver.say(piece)
    house.watcher.say(start)
    house.watcher.say(part)
    house.watcher.settle()
    house.driver.settle()
    assert came == []
    house.driver.say(start)
    house.driver.say(part)
    until(lambda: came == [b"abcd"])


def _values(house: House) -> list[object]:
    elements = (house.number, house.button, house.choice, house.text, house.box)
    return [*((each.value, each.visible, each.disabled, each._impl.removed) for each in elements), *house.pressed]
