"""Results name the command that made them, but not the folders of the person who ran it."""

import sys

import pytest

from ltvn_core.verbs.evaluate import command


def test_folders_that_lead_to_a_file_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    given = ["/jo/bin/ltvn", "evaluate", "--scene", "/jo/a house.glb", "--folder=/jo/runs", "--seed", "0"]
    monkeypatch.setattr(sys, "argv", given)
    assert command() == "ltvn evaluate --scene 'a house.glb' --folder=runs --seed 0"
