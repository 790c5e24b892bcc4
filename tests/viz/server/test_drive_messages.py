"""What a page may say on the drive socket; everything else costs it the socket."""

import json

import pytest

from ltvn_viz.server.drive_messages import DriveMessage, MessageError, parse_message
from ltvn_viz.server.keymap import Direction
from ltvn_viz.wishes.commands import Action, Ask
from ltvn_viz.wishes.wish import MAX_TEXT

DRIVE = {"type": "drive", "held": ["forward"], "stick": [0, 0], "slow": False, "epoch": 3, "age": 40}
ACTION = {"type": "action", "action": "stop", "value": None}


def test_a_drive_message_carries_everything_that_is_held() -> None:
    assert parse_message(json.dumps(DRIVE)) == DriveMessage(frozenset({Direction.FORWARD}), (0, 0), False, 3, 40)


def test_an_action_may_name_what_was_clicked() -> None:
    assert parse_message(json.dumps(ACTION | {"action": "pick", "value": 17})) == Ask(Action.PICK, 17)


@pytest.mark.parametrize(
    ("action", "value"),
    [
        (Action.STOP, 17),
        (Action.PICK, None),
        (Action.PICK, -1),
        (Action.PICK, 2**60),
        (Action.PICK, 1.5),
        (Action.PICK, True),
        (Action.PICK, "17"),
        (Action.KEEP_GOING, 2),
        (Action.OPEN, 3),
        (Action.OPEN, "x" * (MAX_TEXT + 1)),
        (Action.PUT_BOX, [1]),
        (Action.PUT_BOX, [1, "2"]),
        (Action.PUT_BOX, [1e300, 0]),
        (Action.PUT_BOX, [float("nan"), 0]),
    ],
)
def test_an_action_with_a_value_that_it_does_not_carry_is_refused(action: Action, value: object) -> None:
    with pytest.raises(MessageError):
        parse_message(json.dumps(ACTION | {"action": action, "value": value}))


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


@pytest.mark.parametrize(
    "text", ["", "[]", "3", "{", "[" * 900, '{"type": "action", "action": "explode", "value": null}']
)
def test_text_that_is_no_message_is_refused(text: str) -> None:
    with pytest.raises(MessageError):
        parse_message(text)


def test_half_a_surrogate_pair_in_a_message_is_replaced() -> None:
    opened = parse_message('{"type": "action", "action": "open", "value": "\\ud800.rrd"}')
    assert opened == Ask(Action.OPEN, "\ufffd.rrd")
