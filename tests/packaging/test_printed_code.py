"""Every program and command that README and documentation print works as printed."""

import re
import runpy
import shlex
import shutil
import tomllib
from contextlib import chdir
from importlib.util import find_spec
from pathlib import Path

import pytest
import tyro
from packaging.requirements import Requirement

from ltvn_core.cli import main
from ltvn_core.verbs.discovery import find_verbs, load_verb
from tests.program import ltvn_here
from tests.repository import DEMO_DRIVE, DEMO_MAP, RECORDINGS, ROOT

GUIDES = [page for page in (ROOT / "docs").rglob("*.md") if page.parent.name != "lab-notebook"]
"""All but the notebook, which keeps the commands of its day."""
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", RECORDINGS / "README.md", *GUIDES])

READERS_OWN = {
    "docs/how-to/extend.md": """
from ltvn_core.graph.navigation_system import NoMaintenance

my_maintenance = NoMaintenance()
""",
    "docs/how-to/floors.md": """
import ltvn_core as ltvn

robot = ltvn.open_simulation("demo", seed=0, body="planar").robot
call_the_lift, is_at_the_floor = print, lambda: True
""",
    "docs/how-to/own-images.md": """
import numpy as np

import ltvn_core as ltvn

drive = ltvn.Recording.open("recordings/demo-drive.rrd")
seen = [drive.observation(frame) for frame in drive.frames[:5]]
my_frames = [(each.rgb, each.depth, each.odometry, each.stamp) for each in seen]
""",
    "docs/how-to/own-policy.md": """
import torch


class Model(torch.nn.Module):
    def forward(self, seen, goal):
        distance = (seen[:, :3] - goal).abs().mean((1, 2, 3))[:, None]
        return distance, distance[:, :, None].repeat(1, 5, 2)


model = Model()
""",
}
"""What a page leaves to its reader: their images, their model, their robot."""

COMMAND = re.compile(r"(?:(?:robot|desk)?\$ +)?((?:ltvn|python|pip|make|rerun) .+)")
RUN_AS_PRINTED = re.compile(r"ltvn (?:info|verify|why|export) recordings/")


def fences(page: Path, *languages: str) -> list[str]:
    """Return the fenced blocks of a page that are in one of these languages."""
    found = re.findall(r"^ *```(\w*)[^\n]*\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [text for language, text in found if language in languages]


def commands(page: Path) -> list[str]:
    """Return the commands in the shell's fences and in indented blocks, each as one line."""
    text = page.read_text(encoding="utf-8")
    indented = re.findall(r"^ {4,}\S.*$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    lines = "\n".join([*indented, *fences(page, "console", "bash", "sh")]).replace("\\\n", " ").splitlines()
    return [found[1] for line in lines if (found := COMMAND.fullmatch(line.strip()))]


PRINTED = [(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in commands(page)]


def test_the_pages_print_commands() -> None:
    assert len(PRINTED) > 80


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that the pages name; the drive is short, because a map is built from it."""
    folder = tmp_path_factory.mktemp("files")
    shutil.copyfile(DEMO_MAP, folder / "house.rrd")
    shutil.copytree(RECORDINGS, folder / "recordings", ignore=shutil.ignore_patterns(DEMO_DRIVE.name))
    short = str(folder / "recordings" / DEMO_DRIVE.name)
    assert main(["export", str(DEMO_DRIVE), "--from", "0", "--to", "20", "--output", short]) == 0
    return folder


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # As for a reader of the page, whom a warning does not stop.
@pytest.mark.parametrize("page", [page for page in PAGES if fences(page, "python")], ids=lambda page: page.stem)
def test_a_page_s_python_runs_as_printed(page: Path, files: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    own = READERS_OWN.get(page.relative_to(ROOT).as_posix(), "")
    program = tmp_path / "printed.py"
    program.write_text("\n".join([own, *fences(page, "python")]), encoding="utf-8")

    with chdir(tmp_path):  # In this process, which has imported all that takes long.
        runpy.run_path(str(program), run_name="__main__")


@pytest.mark.parametrize(("page", "line"), PRINTED, ids=[f"{page}: {line[:60]}" for page, line in PRINTED])
def test_a_printed_command_is_one_that_can_be_given(page: str, line: str) -> None:
    program, *words = shlex.split(line, comments=True)
    if program == "ltvn" and not words[0].startswith("-"):
        verb = load_verb(find_verbs()[words[0]])
        tyro.cli(verb, args=words[1:])
    elif words[0] == "-m":
        assert find_spec(words[1].split(".")[0])
        assert find_spec(words[1])
    elif program == "python":
        assert (ROOT / words[0]).is_file()
    elif program == "make":
        assert re.search(rf"^{words[0]}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    elif program == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
            "optional-dependencies"
        ]
        for named in [word for word in words[1:] if "[" in word]:
            assert named.startswith("."), "the toolkit is installed from a checkout"
            assert Requirement(f"ltvn{named[1:]}").extras <= set(extras)


@pytest.mark.slow
@pytest.mark.parametrize("line", sorted({line for _, line in PRINTED if RUN_AS_PRINTED.match(line)}))
def test_a_printed_command_about_the_demo_files_succeeds(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(RECORDINGS, tmp_path / "recordings")
    monkeypatch.chdir(tmp_path)

    answered = ltvn_here(capsys, *shlex.split(line, comments=True)[1:])

    assert answered.code == 0, answered.stderr
