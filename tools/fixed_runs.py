"""Run a fixed set of navigation runs and write what happened: `python -m tools.fixed_runs FOLDER`.

A change that is meant to move code and nothing else is held against this set: run it before and after, in two folders,
and compare the two `fixed.json`, which must be equal. It holds every event of a lifelong run in the demo apartment and
every number of episodes in an apartment, a plain building, a changing world, and of each rival. About 15 minutes of one
core; a run that is there already is not made again.
"""

import argparse
import hashlib
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from ltvn_core.data.recording.reader import Recording

RIVALS = ("sptm", "ving", "meng", "sgm", "sorb", "htm", "brm", "placenav")
VOLATILE = ("wall_s", "folder", "seconds", "cpu_s", "recording", "at")
"""Fields of a result that differ from run to run, by how fast the computer is and where it writes."""
_EVALUATE = ("evaluate", "--loops", "1", "--without", "fine-tuning", "--processes", "1", "--episodes")
_LIFELONG = ("lifelong", "--loops", "1", "--without", "fine-tuning", "--processes", "1")

RUNS: Mapping[str, tuple[str, ...]] = {
    "demo": ("demo", "--headless", "--queries", "5", "--seed", "7"),
    "apartment": (*_EVALUATE, "5", "--scene", "apartment-57"),
    "paper": (*_EVALUATE, "5", "--scene", "demo", "--preset", "paper"),
    "plain": (*_EVALUATE, "3", "--scene", "plain-0"),
    **{rival: (*_EVALUATE, "5", "--scene", "demo", "--system", rival) for rival in RIVALS},
    "lifelong": (*_LIFELONG, "--queries", "4", "--every", "2", "--episodes", "2"),
    "world": (*_LIFELONG, "--queries", "5", "--world", "doors+moving", "--maintenance", "persistent"),
}


def run(name: str, folder: Path) -> None:
    """Make one run in a folder of its own, unless it is there."""
    summary = folder / f"{name}.json"
    if summary.exists():
        return
    extra = ("--recording", str(folder / f"{name}.rrd")) if name == "demo" else ("--folder", str(folder / name))
    command = [sys.executable, "-m", "ltvn_core.cli", *RUNS[name], *extra, "--json", str(summary)]
    with (folder / f"{name}.log").open("w", encoding="utf-8") as log:
        subprocess.run(command, check=True, stdout=log, stderr=log)


def what_happened(name: str, folder: Path) -> object:
    """Return everything about a run that must not depend on when and where it was made."""
    summary = _steady(json.loads((folder / f"{name}.json").read_text(encoding="utf-8")))
    if name == "demo":
        return {"summary": summary, "events": _events(folder / f"{name}.rrd")}
    episodes = {
        str(path.relative_to(folder / name)): _steady(json.loads(path.read_text(encoding="utf-8")))
        for path in sorted((folder / name).rglob("*.json"))
        if "plan" not in path.name
    }
    return {"summary": summary, "files": episodes}


def _events(path: Path) -> object:
    events = Recording.open(path).events
    digest = hashlib.sha256("\n".join(f"{each.step} {each.event!r}" for each in events).encode()).hexdigest()
    return {"counts": dict(sorted(Counter(type(each.event).__name__ for each in events).items())), "sha256": digest}


def _steady(value: object) -> object:
    if isinstance(value, dict):
        return {key: _steady(each) for key, each in value.items() if key not in VOLATILE}
    if isinstance(value, list):
        return [_steady(each) for each in value]
    return value


def main() -> int:
    """Make all runs and write `fixed.json` into the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", choices=tuple(RUNS), default=tuple(RUNS))
    options = parser.parse_args()
    folder = options.folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    for name in options.only:
        run(name, folder)
        sys.stdout.write(f"{name}\n")
        sys.stdout.flush()
    found = {name: what_happened(name, folder) for name in options.only}
    (folder / "fixed.json").write_text(json.dumps(found, indent=1, sort_keys=True), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
