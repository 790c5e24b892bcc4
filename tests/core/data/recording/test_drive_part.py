"""A part of a drive: halves that have no image in common and none left out."""

import pytest

from ltvn_core.data.recording.drive_part import WHOLE_DRIVE, DrivePart, parse_part
from ltvn_core.errors import OptionError


@pytest.mark.parametrize(("frames", "parts"), [(137, 2), (10, 3), (2, 4), (0, 2)])
def test_the_parts_together_are_the_drive(frames: int, parts: int) -> None:
    drive = tuple(range(frames))
    taken = [DrivePart(number + 1, parts).take(drive) for number in range(parts)]
    assert sum(map(tuple, taken), ()) == drive
    assert max(map(len, taken)) - min(map(len, taken)) <= 1


def test_a_part_is_written_as_a_person_says_it() -> None:
    assert parse_part("2/2") == DrivePart(2, 2)
    assert parse_part("1/1") == WHOLE_DRIVE
    assert str(parse_part("3/4")) == "3/4"


@pytest.mark.parametrize("text", ["", "half", "0/2", "3/2", "1/0", "1/2/3", "-1/2", "1.5/2"])
def test_what_is_no_part_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(OptionError, match="such as 1/2, the first half"):
        parse_part(text)
