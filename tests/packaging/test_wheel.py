"""From a wheel, in an empty folder, the toolkit opens on its demo map."""

import re
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPResponse
from pathlib import Path
from urllib.request import ProxyHandler, build_opener
from zipfile import ZipFile

import pytest

from ltvn_core.data.recording.demo_files import DEMO_MAP, DEMO_RECORDING
from tests.packaging import smoke
from tests.packaging.environments import program_of

MAX_WHEEL_BYTES = 8_500_000

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def program(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`ltvn`, installed from the wheel into an environment of its own that borrows only the libraries of this one."""
    folder = tmp_path_factory.mktemp("installed") / "venv"
    venv.create(folder, with_pip=False)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    (packages / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "--python", str(folder), "install", "--quiet", "--ignore-installed"]
    subprocess.run([*pip, "--no-deps", "--no-index", str(wheel)], check=True)
    return program_of(folder)


@pytest.fixture
def empty_folder(tmp_path: Path) -> Path:
    """Where a person begins."""
    folder = tmp_path / "empty"
    folder.mkdir()
    return folder


def test_the_wheel_is_small_and_holds_the_demo_files(wheel: Path) -> None:
    names = set(ZipFile(wheel).namelist())

    assert wheel.stat().st_size <= MAX_WHEEL_BYTES
    assert {f"ltvn_core/data/recording/demo/{name}" for name in (DEMO_MAP, DEMO_RECORDING)} <= names
    assert {name.split("/")[0] for name in names} <= {"ltvn_core", "ltvn_viz", _metadata_folder(names)}


def test_the_program_says_its_version_and_its_verbs(program: Path, empty_folder: Path) -> None:
    assert re.fullmatch(r"ltvn \d+\.\d+\.\d+\S*\n", smoke.run(program, "--version", folder=empty_folder))
    assert "navigate" in smoke.run(program, "--help", folder=empty_folder)


def test_the_demo_map_comes_with_the_package(program: Path, empty_folder: Path) -> None:
    ask = f"from ltvn_core.data.recording.demo_files import demo_file; print(demo_file({DEMO_MAP!r}))"
    path = smoke.run(program.with_name("python"), "-c", ask, folder=empty_folder).strip()

    assert Path(path).is_relative_to(program.parents[1])
    assert '"nodes": 327' in smoke.run(program, "info", path, "--json", "-", folder=empty_folder)


def test_the_app_opens_on_the_demo_map(program: Path, empty_folder: Path) -> None:
    pytest.importorskip("embreex")
    pytest.importorskip("torch")
    with _started(program, "app", "--port", "0", folder=empty_folder) as app:
        said, link = _until_the_link(app)
        assert any("327 nodes" in line for line in said)
        with _browse(link) as page:
            assert page.status == 200
            assert b"<html" in page.read().lower()


def test_the_smoke_test_of_a_release_passes(program: Path) -> None:
    smoke.main(program)


@contextmanager
def _started(program: Path, *arguments: str, folder: Path) -> "Iterator[subprocess.Popen[str]]":
    """A program that runs until the block ends."""
    process = subprocess.Popen(
        [str(program), *arguments],
        cwd=folder,
        env=smoke.environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=60)


def _until_the_link(app: "subprocess.Popen[str]") -> tuple[list[str], str]:
    said: list[str] = []
    assert app.stderr is not None
    for line in app.stderr:
        said.append(line)
        if line.startswith("Ready."):
            links = [found[0] for each in said if (found := re.search(r"http://127\.0\.0\.1:\d+/\S*", each))]
            return said, links[0]
    raise AssertionError("The app ended without a link:\n" + "".join(said))


def _browse(link: str) -> HTTPResponse:
    """Open a link as a browser does."""
    return build_opener(ProxyHandler({})).open(link, timeout=60)


def _metadata_folder(names: set[str]) -> str:
    return next(name.split("/")[0] for name in names if ".dist-info/" in name)
