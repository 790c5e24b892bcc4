"""Make result files small enough to be committed: `python -m tools.slim_results docs/measurements`.

Result files written before held a map's nodes, edges and floor as JSON, which is 97 % of them. This writes each drawing
that a figure of `ltvn report` shows beside its result, and the result again without any. Results that are still large
are then gzipped, with the same bytes whenever that is done. All else stays as it is.
"""

import json
import os
import re
import sys
from pathlib import Path
from typing import Any

import cattrs

from ltvn_core.evaluation.results import MapDrawing, drawing_path, pack, save_drawing

_DRAWN = "*.trial.json", "*.lifelong.json"
_OTHERS = ("*.world.json",)
_LARGE_BYTES = 20_000
"""Smaller results stay plain, so that a change of them can be read where it is reviewed."""
_ENDING = re.compile(r"(-(\d+|every))*\.(trial|lifelong)\.json$")


def slim(path: Path) -> None:
    """Take the drawings out of one result file; one without any stays as it is."""
    results = json.loads(path.read_text(encoding="utf-8"))
    trials = [point["trial"] for point in results["points"]] if "points" in results else [results]
    for trial in (trials[0], trials[-1]):
        if _is_shown(path, trial):
            _keep_drawing(path, trial)
    for trial in trials:
        trial["floorplan"] = None
    part = path.with_suffix(".part")
    part.write_text(json.dumps(results, separators=(",", ":")), encoding="utf-8")
    os.replace(part, path)


def _results(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    return sorted(path for pattern in patterns for path in folder.rglob(pattern))


def _is_shown(path: Path, trial: dict[str, Any]) -> bool:
    """Figures show the maps of the first seed, and those before and after a lifelong test."""
    return trial["floorplan"] is not None and trial["seed"] == 0


def _keep_drawing(path: Path, trial: dict[str, Any]) -> None:
    place = drawing_path(path.parent, _ENDING.sub("", path.name), trial["queries"])
    if not place.exists():
        save_drawing(place, cattrs.structure(trial["floorplan"], MapDrawing))


def main(folders: list[str]) -> int:
    """Convert all results below some folders, and say what that saves."""
    for folder in map(Path, folders):
        drawn, others = (_results(folder, patterns) for patterns in (_DRAWN, _OTHERS))
        paths = [*drawn, *others]
        before = sum(path.stat().st_size for path in [*paths, *folder.rglob("*-map-*.npz")])
        for path in drawn:
            slim(path)
        paths = [pack(path) if path.stat().st_size > _LARGE_BYTES else path for path in paths]
        after = sum(path.stat().st_size for path in [*paths, *folder.rglob("*-map-*.npz")])
        sys.stdout.write(f"{folder}: {len(paths)} results, {before / 1e6:.1f} MB before, {after / 1e6:.1f} MB now\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
