"""What a reader of other people's drives must do: know its own format, and be calm about all others."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ltvn_core.contracts.contract_check import ContractCheck, require, run_checks
from ltvn_core.plugins import Plugin


def reader_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Show a reader files that are none of its business."""
    return run_checks(
        ("can be asked and opened", lambda: _has_parts(plugin)),
        [("recognises nothing in what holds nothing", lambda: _recognises_nothing(plugin))],
    )


def _has_parts(plugin: Plugin) -> str:
    reader = plugin.load()
    missing = [name for name in ("recognises", "open") if not callable(getattr(reader, name, None))]
    require(not missing, f"it lacks the class methods {' and '.join(missing)}")
    return ""


def _recognises_nothing(plugin: Plugin) -> str:
    reader: Any = plugin.load()
    with tempfile.TemporaryDirectory(prefix="ltvn-") as name:
        folder = Path(name)
        (folder / "empty").mkdir()
        (folder / "noise.bin").write_bytes(bytes(range(256)) * 16)
        (folder / "nothing.txt").write_bytes(b"")
        for place in ("empty", "noise.bin", "nothing.txt", "not-there"):
            require(reader.recognises(folder / place) is False, f"it says that it can read {place}")
    return ""
