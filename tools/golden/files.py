"""Golden files in `tests/data/golden`: rows of a label and what was found, as JSON that differs by lines.

Owns rounding, the format and the first difference. A file says which processor and libraries made it. There, all
numbers must be equal as they were rounded. Elsewhere the last bits of the network differ, so numbers may differ by
`TOLERANCE`, decimals in texts are not compared, and of an event only its kind, nodes and words must be equal.
"""

import hashlib
import json
import math
import platform
import re
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

FOLDER = Path(__file__).parents[2] / "tests" / "data" / "golden"
DIGITS = 4
"""Digits after the point to which numbers are rounded."""
TOLERANCE = 0.01
"""Greatest difference of two numbers of different machines, absolute or relative."""
_MADE_ON = "made on"
_LIBRARIES = ("numpy", "scipy", "torch", "opencv-python-headless", "rustworkx", "embreex")
_LONGEST_LINE = 160
_SHOWN = 300
_MISSING = "(nothing)"
_DECIMALS = re.compile(r"\d+\.\d+|\d+(?=°)")
_TIMES = ("step", "frame", "stamp", "steps", "at_s")
"""Fields of an event that say when it happened, which is not the same on all machines."""


class Row(NamedTuple):
    """One thing that the program answered."""

    label: str
    value: Any
    """JSON of any form."""
    events: tuple[Mapping[str, Any], ...] = ()
    """Events in JSON, of which the file keeps only fingerprints."""


def plain(value: Any, digits: int = DIGITS) -> Any:
    """Return JSON with its numbers rounded."""
    if isinstance(value, Mapping):
        return {str(key): plain(each, digits) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each, digits) for each in value]
    if isinstance(value, float):
        return round(float(value), digits) + 0.0 if math.isfinite(value) else str(value)
    return value


def write(path: Path, rows: Iterable[Row]) -> int:
    """Write a golden file and return its number of rows."""
    found = {_MADE_ON: _machine()}
    for row in rows:
        assert row.label not in found, row.label
        found[row.label] = _kept(row)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = ",\n".join(f"{json.dumps(label)}: {_json(value)}" for label, value in found.items())
    path.write_text(f"{{\n{text}\n}}\n", encoding="utf-8")
    return len(found) - 1


def difference(path: Path, rows: Iterable[Row]) -> str | None:
    """Return where rows first differ from those of a golden file, in one line; None if they are equal."""
    before = json.loads(path.read_text(encoding="utf-8"))
    before.pop(_MADE_ON)
    is_exact = made_here(path)
    for row in rows:
        if (found := _first_difference(before.pop(row.label, _MISSING), row, is_exact=is_exact)) is not None:
            return f"{path.name}: {row.label}: {found}"
    return f"{path.name}: {next(iter(before))}: is missing now" if before else None


def made_here(path: Path) -> bool:
    """Tell whether a golden file was made on such a processor with these libraries."""
    return bool(json.loads(path.read_text(encoding="utf-8"))[_MADE_ON] == _machine())


def _machine() -> str:
    """Return the processor and the libraries on which the last bits of a number depend."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    said = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in reversed(lines))}
    # A virtual machine names several generations alike: "AMD EPYC".
    name = " ".join(said[key] for key in ("model name", "cpu family", "model", "stepping") if key in said)
    return ", ".join([name or platform.processor() or platform.machine(), *map(_installed, _LIBRARIES)])


def _installed(library: str) -> str:
    try:
        return f"{library} {version(library)}"
    except PackageNotFoundError:
        return f"no {library}"


def _kept(row: Row) -> Any:
    """Return what the file keeps of a row."""
    return {"found": row.value, "events": " ".join(map(_fingerprint, row.events))} if row.events else row.value


def _json(value: Any) -> str:
    """Return JSON on one line, or if that is long, with a line for each part."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return text if len(text) <= _LONGEST_LINE else json.dumps(value, ensure_ascii=False, indent=0)


def _fingerprint(event: Mapping[str, Any]) -> str:
    """Return four digits of what is the same on all machines, and four of everything."""
    digests = (hashlib.sha256(json.dumps(each).encode()).hexdigest() for each in (_sure(event), event))
    return "".join(digest[:4] for digest in digests)


def _sure(value: Any) -> Any:
    """Return JSON without its numbers that are not whole, and without times."""
    if isinstance(value, Mapping):
        return {key: _sure(each) for key, each in value.items() if key not in _TIMES}
    if isinstance(value, list):
        return [_sure(each) for each in value]
    return None if isinstance(value, float) else value


def _first_difference(before: Any, row: Row, *, is_exact: bool) -> str | None:
    if not row.events or before == _MISSING:
        return next(_differences(before, row.value, is_exact=is_exact), None)
    known = before["events"].split()
    digits = 8 if is_exact else 4
    for number, event in enumerate(row.events):
        if number >= len(known) or _fingerprint(event)[:digits] != known[number][:digits]:
            return f"event {number} of {len(known)} is now {json.dumps(event, ensure_ascii=False)}"
    if len(row.events) < len(known):
        return f"ends after event {len(row.events)} of {len(known)}"
    return next(_differences(before["found"], row.value, is_exact=is_exact), None)


def _differences(before: Any, now: Any, place: str = "", *, is_exact: bool) -> Iterator[str]:
    """Yield each place where two JSON values differ."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in before | now:
            yield from _differences(
                before.get(key, _MISSING), now.get(key, _MISSING), f"{place}.{key}", is_exact=is_exact
            )
    elif isinstance(before, list) and isinstance(now, list):
        for number, (old, new) in enumerate(zip_longest(before, now, fillvalue=_MISSING)):
            yield from _differences(old, new, f"{place}[{number}]", is_exact=is_exact)
    elif before != now and (is_exact or not _is_near(before, now)):
        yield f"{place.lstrip('.')} was {_shown(before)}, is now {_shown(now)}".lstrip()


def _is_near(before: Any, now: Any) -> bool:
    """Tell whether two numbers are nearly equal, or two texts are equal but for their numbers that are not whole."""
    if isinstance(before, str) and isinstance(now, str):
        return _DECIMALS.sub("", before) == _DECIMALS.sub("", now)
    if not isinstance(before, float) or not isinstance(now, float):
        return False
    return math.isclose(before, now, rel_tol=TOLERANCE, abs_tol=TOLERANCE)


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
