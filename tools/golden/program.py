"""Golden texts: imported drives, help and summaries of verbs, tools of the agent, and tables of the documents."""

import contextlib
import io
import json
import os
import re
import shlex
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from figures.baseline_tables import baseline_blocks
from figures.network_comparisons import comparison_tables
from figures.network_tables import network_blocks
from ltvn_core.cli import main
from ltvn_core.data.recording.reader import Recording
from ltvn_core.evaluation.reports.evaluation_files import find_results
from ltvn_core.evaluation.reports.evaluation_tables import overall_table
from ltvn_core.evaluation.reports.result_rows import rows_of
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.weights_file import read_card
from ltvn_core.systems.registry import OWN_SYSTEMS, baseline_systems
from ltvn_core.types import Observation
from ltvn_core.verbs.discovery import find_verbs
from ltvn_viz.agent.arguments import object_schema
from ltvn_viz.agent.named_files import NamedFiles
from ltvn_viz.agent.tools import RecordingTools
from tests.core.data.importing.drives import EXCERPT
from tests.core.data.importing.test_mutated_drives import write_drives
from tools.golden.answers import NAMES, RECORDINGS
from tools.golden.files import Row, plain
from tools.results_page import markdown_tables

MEASUREMENTS = RECORDINGS.parent / "docs" / "measurements"

COMMANDS = (
    "info demo-fault.rrd",
    "verify demo-fault.rrd",
    "repair demo-fault.rrd --output repaired.rrd",
    "why demo-fault.rrd",
    "why demo-fault.rrd --ask failures",
    "plugins",
    "plugins test network",
    "import drives/excerpt --output drive.rrd",
    "build drive.rrd --output map.rrd",
    "judge drive.rrd --predictor geometric",
    "navigate --map demo-map.rrd --queries 1 --recording query.rrd --body planar",
    "export demo-drive.rrd --from 0 --to 5 --output moment.rrd",
    "report measurements/parts --output report.html",
)
"""Commands that follow each other in one folder; of each, the form of its summary is kept."""
_EVALUATION = "--loops 1 --without fine-tuning --processes 1 --body planar"
MORE_COMMANDS = (
    "demo --headless --queries 5 --seed 7 --body planar --recording demo.rrd",
    "collect --loops 1 --output collected.rrd --body planar",
    f"evaluate --episodes 5 --scene apartment-57 {_EVALUATION}",
    f"evaluate --episodes 5 --preset paper {_EVALUATION}",
    *(f"evaluate --episodes 5 --system {name} {_EVALUATION}" for name in OWN_SYSTEMS[1:]),
    f"lifelong --queries 4 --every 2 --episodes 2 {_EVALUATION}",
    f"lifelong --queries 5 --world doors+moving --maintenance persistent {_EVALUATION}",
    "dataset --scenes tune-0 --clusters 4 --processes 1 --folder pairs",
)
_VOLATILE = ("wall_s", "folder", "seconds", "cpu_s", "recording", "at")


def imports() -> Iterator[Row]:
    """Yield the summary and the frames of a drive in each format that the tests write."""
    with _folder() as folder:
        drives = write_drives(folder / "drives")
        shutil.copytree(EXCERPT, drives / "excerpt")
        for drive in sorted(drives.iterdir()):
            output = f"{drive.name}.rrd"
            yield Row(f"{drive.name}: summary", plain(_summary(f"import drives/{drive.name} --output {output}")))
            if Path(output).exists():
                recording = Recording.open(Path(output))
                for frame in recording.frames:
                    yield Row(f"{drive.name}: frame {frame}", _frame(recording.observation(frame)))


def _frame(seen: Observation) -> Any:
    depth = None if seen.depth is None else [*seen.depth.shape, float(np.mean(seen.depth))]
    truth = None if seen.exact_pose is None else seen.exact_pose.tolist()
    colours = [*seen.rgb.shape, float(np.round(np.mean(seen.rgb)))]
    return plain([seen.stamp, seen.odometry.tolist(), truth, seen.tilt, colours, depth])


def help_texts() -> Iterator[Row]:
    """Yield the help of all verbs, without boxes and colours."""
    for words in ([], ["--help"], *([verb, "--help"] for verb in find_verbs())):
        _, text = _run(words)
        lines = (re.sub(r"[─│╭╮╰╯\s]+", " ", line).strip() for line in text.splitlines())
        yield Row(" ".join(["ltvn", *words]), [line for line in lines if line])


def summaries(commands: tuple[str, ...], *, whole: bool = False) -> Iterator[Row]:
    """Yield the form of the JSON summary of each command, or the whole summary without times and places."""
    with _folder() as folder:
        for name in NAMES:
            shutil.copyfile(RECORDINGS / f"{name}.rrd", folder / f"{name}.rrd")
        shutil.copytree(EXCERPT, folder / "drives/excerpt")
        shutil.copytree(MEASUREMENTS / "parts", folder / "measurements/parts")
        for command in commands:
            found = _summary(command)
            yield Row(f"ltvn {command}", _steady(found) if whole else _form(found))
        tools = RecordingTools(NamedFiles([folder / "demo-fault.rrd"])).tools
        yield from (Row(f"tool {name}", [tool.about, object_schema(tool.parameters)]) for name, tool in tools.items())


def tables() -> Iterator[Row]:
    """Yield the tables of the documents, made from the stored results."""
    for section in sorted(path.name for path in MEASUREMENTS.iterdir() if path.is_dir() and path.name != "presence"):
        found = find_results(MEASUREMENTS / section)
        blocks = markdown_tables(found)
        blocks["overall"] = overall_table(rows_of(found)).markdown()
        yield from (Row(f"{section}-{name}", block.splitlines()) for name, block in blocks.items())
    rivals = {entry.name: read_card(entry.weights) for entry in baseline_systems()}
    blocks = network_blocks(read_card(SHIPPED_WEIGHTS)) | baseline_blocks(rivals) | comparison_tables(MEASUREMENTS)
    yield from (Row(f"network-{name}", block.splitlines()) for name, block in blocks.items())


@contextlib.contextmanager
def _folder() -> Iterator[Path]:
    """Work in an empty folder, so that no path depends on the machine."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        yield Path(folder)


def _run(words: list[str]) -> tuple[int, str]:
    """Run a command in this process; return its exit code and what it printed."""
    out, before = io.StringIO(), dict(os.environ)
    os.environ.update({"COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1"})
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
            code = main(words)
    except SystemExit as end:  # tyro ends so after it has shown its help.
        code = int(end.code or 0)
    finally:
        os.environ.clear()
        os.environ.update(before)
    return code, out.getvalue()


def _summary(command: str) -> Any:
    code, text = _run([*shlex.split(command), "--json", "-"])
    return json.loads(text) if code == 0 else {"exit code": code}


def _steady(value: Any) -> Any:
    """Return JSON without what depends on when and where a command runs."""
    if isinstance(value, dict):
        return {key: _steady(each) for key, each in value.items() if key not in _VOLATILE}
    return [_steady(each) for each in value] if isinstance(value, list) else plain(value)


def _form(value: Any) -> Any:
    """Return the keys of JSON and the types of their values; of a list, the first element."""
    if isinstance(value, dict):
        return {key: _form(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_form(each) for each in value[:1]]
    return type(value).__name__
