"""What a page may say on the drive socket; everything else costs it the socket."""

import json

import pytest

from ltvn_viz.server.drive_messages import ActionMessage, DriveMessage, MessageError, parse_message
from ltvn_viz.server.driver_seat import HeldInput
from ltvn_viz.server.keymap import Action, Direction

DRIVE = {"type": "drive", "held": ["forward"], "stick": [0, 0], "slow": False, "epoch": 3, "age": 40}
ACTION = {"type": "action", "action": "stop", "id": None}


def test_a_drive_message_carries_everything_that_is_held() -> None:
    assert parse_message(json.dumps(DRIVE)) == DriveMessage(HeldInput(frozenset({Direction.FORWARD})), 3, 0.04)


def test_an_action_may_name_what_was_clicked() -> None:
    assert parse_message(json.dumps(ACTION | {"id": 17})) == ActionMessage(Action.STOP, 17)


@pytest.mark.parametrize(
    "changed",
    [
        {"held": ["up"]},
        {"held": "forward"},
        {"held": [["forward"]]},
        {"stick": [0, 2]},
        {"stick": [0, float("nan")]},
        {"stick": [0, float("inf")]},
        {"stick": [True, 0]},
        {"slow": 1},
        {"epoch": -1},
        {"epoch": 1.5},
        {"epoch": 2**60},
        {"age": -1},
        {"age": 0.5},
        {"extra": 1},
        {"type": "fly"},
    ],
)
def test_a_drive_message_with_a_wrong_field_is_refused(changed: dict[str, object]) -> None:
    with pytest.raises(MessageError):
        parse_message(json.dumps(DRIVE | changed))


@pytest.mark.parametrize("text", ["", "[]", "3", "{", "[" * 900, '{"type": "action", "action": "explode", "id": null}'])
def test_text_that_is_no_message_is_refused(text: str) -> None:
    with pytest.raises(MessageError):
        parse_message(text)
