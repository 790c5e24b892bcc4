"""What the program answered before, it answers still; where it does not, the first difference is named."""

import dataclasses
import json
from pathlib import Path

import pytest

from ltvn_core import config
from tools.golden.__main__ import PARTS, USUAL, file_of
from tools.golden.files import FOLDER, Row, difference, made_here, write
from tools.golden.runs import Setting, runs

ROWS = [Row("edge at 3 s", {"blocks": [{"text": "p 0.91", "points": [0.5, 1]}]}), Row("q", "no path", ({"kind": "a"},))]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:No artists with labels")  # A report of results too small for a legend.
@pytest.mark.parametrize("part", USUAL)
def test_the_program_answers_as_before(part: str) -> None:
    if part in ("maps", "runs") and not made_here(file_of(part)):
        pytest.skip("A last bit that differs on another processor may lead a robot another way.")
    found = difference(file_of(part), PARTS[part]())

    assert found is None, f"{found}\nIf this is meant: python -m tools.golden make {part}"


def test_the_golden_files_are_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.glob("[!m]*.json")) < 2_000_000


@pytest.mark.parametrize(
    ("now", "said"),
    [
        ([Row("edge at 3 s", {"blocks": [{"text": "p 0.91", "points": [0.6, 1]}]}), ROWS[1]], "blocks[0].points[0]"),
        ([ROWS[0], Row("q", "no path", ({"kind": "a"}, {"kind": "b"}))], 'event 1 of 1 is now {"kind": "b"}'),
        ([ROWS[0], Row("q", "arrived", ({"kind": "a"},))], "arrived"),
        ([ROWS[0]], "q: is missing"),
        ([*ROWS, Row("new", 1)], "new"),
    ],
)
def test_the_first_difference_is_told_with_its_place(tmp_path: Path, now: list[Row], said: str) -> None:
    write(tmp_path / "part.json", ROWS)

    assert difference(tmp_path / "part.json", ROWS) is None
    assert said in (difference(tmp_path / "part.json", now) or "")


def test_numbers_made_on_another_machine_may_differ_in_their_last_digits(tmp_path: Path) -> None:
    path = tmp_path / "part.json"
    write(path, ROWS)
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | {"made on": "another"}), encoding="utf-8")
    near, far = (Row("edge at 3 s", {"blocks": [{"text": "p 0.91", "points": [x, 1]}]}) for x in (0.5001, 0.6))

    assert difference(path, [near, ROWS[1]]) is None
    assert difference(path, [far, ROWS[1]]) is not None


@pytest.mark.slow
def test_another_number_of_the_method_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    setting = [Setting(name="demo map", queries=1)]
    write(tmp_path / "runs.json", runs(setting))
    slower = dataclasses.replace(config.ROBUST.driving, speed_m_s=0.2)
    monkeypatch.setitem(config.PRESETS, "robust", dataclasses.replace(config.ROBUST, driving=slower))

    assert "query 0" in (difference(tmp_path / "runs.json", runs(setting)) or "")
