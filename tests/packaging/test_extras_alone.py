"""Each extra, alone in an environment of its own, does what `docs/index.md` says of it.

Two extras take their turn in each run, by the number of commits; LTVN_EXTRAS=plain,sim names others, and `all` all.
"""

import json
import os
import secrets
import subprocess
from pathlib import Path

import msgspec
import pytest
import viser
from websockets.sync.client import connect

from ltvn_core.data.recording.demo_files import DEMO_MAP
from tests.packaging import smoke
from tests.packaging.environments import extras_of, install_with_extra
from tests.repository import RECORDINGS

ROOT = Path(__file__).parents[2]
DEBUG = """
import json, sys
from pathlib import Path
from ltvn_core.analysis.answer_text import answer_text
from ltvn_viz.debugger.file_context import FileCase
from ltvn_viz.debugger.file_questions import FileAsk, ask_file, offered_questions
told = {}
for name in sys.argv[1:]:
    case = FileCase(Path(name))
    told[name] = {word: answer_text(ask_file(case, FileAsk(question=word)).answer) for word in offered_questions(case)}
print(json.dumps(told))
"""
"""Asks every question about each recording."""
PLAIN = ""
"""No extra at all."""
EXTRAS = (PLAIN, "app", "network", "sim", "place", "train", "import", "ros", "cluster", "docs", "agent", "onnx", "all")
EACH_RUN = 2

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def _turn() -> tuple[str, ...]:
    """Return the extras whose turn it is."""
    named = os.environ.get("LTVN_EXTRAS")
    if named is not None:
        return EXTRAS if named == "all" else tuple("" if each == "plain" else each for each in named.split(","))
    count = subprocess.run(["git", "rev-list", "--count", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    first = EACH_RUN * int(count.stdout or 0)
    return tuple(EXTRAS[(first + k) % len(EXTRAS)] for k in range(EACH_RUN))


def test_every_extra_of_the_wheel_is_tested(wheel: Path) -> None:
    assert {PLAIN, "dev", *extras_of(wheel)} == {"dev", *EXTRAS}


@pytest.mark.parametrize("extra", _turn())
def test_an_extra_alone_does_its_job(extra: str, wheel: Path, tmp_path: Path) -> None:
    program = install_with_extra(tmp_path / "venv", wheel, extra)
    folder = tmp_path / "empty"
    folder.mkdir()
    assert json.loads(smoke.run(program, "info", _recording(DEMO_MAP), "--json", "-", folder=folder))["nodes"] == 327

    for arguments in JOBS[extra]:
        smoke.run(program, *arguments, folder=folder)
    for code in IMPORTS.get(extra, ()):
        _python(program, "-c", code, folder=folder)
    if extra == PLAIN:
        _debug(program, folder, sorted(map(str, RECORDINGS.glob("*.rrd"))))
    if extra == "all":
        _debug(program, folder, [_recording("demo-fault.rrd")])
    if extra in REFUSED:
        arguments, missing = REFUSED[extra]
        _check_refusal(program, arguments, missing, folder)


def _recording(name: str) -> str:
    return str(RECORDINGS / name)


JOBS: dict[str, tuple[tuple[str, ...], ...]] = {
    PLAIN: (
        ("verify", _recording("demo-fault.rrd")),
        ("why", _recording("demo-fault.rrd"), "--query", "1"),
        ("plugins",),
        ("export", _recording("demo-fault.rrd"), "--html", "map.html", "--svg", "map.svg"),
    ),
    "app": (("plugins",),),
    "network": (("finetune", "--help"),),
    "sim": (("collect", "--scene", "demo", "--loops", "1", "--output", "drive.rrd"),),
    "place": (("plugins",),),
    "onnx": (("plugins",),),
    "train": (("train", "--help"), ("dataset", "--help")),
    "import": (("export", _recording("demo-drive.rrd"), "--to", "mcap", "--output", "drive.mcap"),),
    "ros": (("serve", "--help"),),
    "cluster": (("evaluate", "--help"),),
    "docs": (("report", "--help"),),
    "agent": (("mcp", "--help"),),
    "all": (("collect", "--scene", "demo", "--loops", "1", "--output", "drive.rrd"),),
}
"""What each extra must be able to do."""

IMPORTS: dict[str, tuple[str, ...]] = {
    "network": ("from ltvn_core.network.predictor import load_predictor; load_predictor()",),
    "place": ("from ltvn_core.predictors.opening import open_predictor; open_predictor('composed')",),
    "train": ("import ltvn_core.network.training_data.shards, ltvn_core.network.optimization.trainer, tensorboard",),
    "ros": ("import ltvn_core.robots.ros2, zenoh, rosbags",),
    "cluster": ("import distributed",),
    "agent": ("import mcp, ltvn_viz.agent.server",),
    "docs": ("import ltvn_core.evaluation.reports.evaluation_page, jinja2, matplotlib, mkdocs, mkdocstrings",),
}
"""What must be importable where no verb shows it in seconds."""

REFUSED: dict[str, tuple[tuple[str, ...], str]] = {
    PLAIN: (("app", "--port", "0"), "'ltvn[network,sim]'"),
    "all": (("app", "--scene", "nowhere", "--port", "0"), "nowhere"),
}
"""What must say what is missing before it prints a link."""


def _debug(program: Path, folder: Path, recordings: list[str]) -> None:
    """Open a recording in the page, over both of its sockets, and ask all questions about each."""
    smoke.replay(program, recordings[0], folder=folder, meanwhile=_open_socket)
    for answers in json.loads(_python(program, "-c", DEBUG, *recordings, folder=folder)).values():
        assert all(answers.values()), answers
        assert "truth" in answers


def _open_socket(link: str) -> None:
    """Hear viser's first message on a page's socket, where its token goes first."""
    address = link.split("/#")[0]
    token = smoke.open_link(link)
    with connect(
        f"{address.replace('http', 'ws')}/?page={secrets.token_hex(16)}",
        origin=address,  # pyright: ignore[reportArgumentType]
        subprotocols=[f"viser-v{viser.__version__}"],  # pyright: ignore[reportArgumentType]
        open_timeout=60,
        max_size=None,
    ) as panels:
        panels.send(msgspec.msgpack.encode({"type": "proof", "token": token}))
        assert panels.recv(timeout=60)


def _check_refusal(program: Path, arguments: tuple[str, ...], missing: str, folder: Path) -> None:
    done = subprocess.run(
        [str(program), *arguments], cwd=folder, env=smoke.environment(), capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 1, done.stderr
    assert missing in done.stderr
    assert "http://" not in done.stderr


def _python(program: Path, *arguments: str, folder: Path) -> str:
    return smoke.run(next(program.parent.glob("python*")), *arguments, folder=folder)
