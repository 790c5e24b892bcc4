"""From a wheel, in an empty folder, the toolkit opens on its demo map."""

import re
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
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


def test_the_app_opens_on_the_demo_map(program: Path, empty_folder: Path) -> None:
    pytest.importorskip("embreex")
    pytest.importorskip("torch")
    assert "327 nodes" in smoke.serve(program, "app", folder=empty_folder)


def test_the_smoke_test_of_a_release_passes(program: Path) -> None:
    smoke.main(program)


def _metadata_folder(names: set[str]) -> str:
    return next(name.split("/")[0] for name in names if ".dist-info/" in name)
