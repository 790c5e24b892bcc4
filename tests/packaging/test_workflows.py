"""The workflows can be read, and test the Pythons and versions of Rerun that we allow; the tests run in any shell."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _jobs(name: str) -> dict[str, Any]:
    """Return the jobs of a workflow by name."""
    yaml = pytest.importorskip("yaml")  # Comes with mkdocs.
    return yaml.safe_load((ROOT / ".github" / "workflows" / name).read_text(encoding="utf-8"))["jobs"]


@pytest.mark.parametrize("name", ["ci.yml", "release.yml"])
def test_every_job_of_a_workflow_has_a_machine_and_steps(name: str) -> None:
    jobs = _jobs(name)

    assert jobs
    assert all({"runs-on", "steps"} <= set(job) and job["steps"] for job in jobs.values())


def test_the_core_is_tested_on_all_pythons_that_are_supported() -> None:
    tested = _jobs("ci.yml")["core"]["strategy"]["matrix"]["python"]
    named = [each.rsplit(" ", 1)[1] for each in PROJECT["classifiers"] if "Python :: 3." in each]

    assert tested == named
    assert all(each in SpecifierSet(PROJECT["requires-python"]) for each in tested)


def test_only_a_version_of_rerun_above_the_range_may_fail() -> None:
    job = _jobs("ci.yml")["rerun"]
    allowed = next(each for each in map(Requirement, PROJECT["dependencies"]) if each.name == "rerun-sdk").specifier
    named = [each.removeprefix("==").removesuffix(".*") for each in job["strategy"]["matrix"]["rerun"] if each]

    assert all(f"{each}.0" in allowed for each in named)
    assert job["continue-on-error"] == "${{ matrix.rerun == '' }}"


def test_a_release_is_tried_as_the_plain_wheel() -> None:
    commands = [step.get("run", "") for step in _jobs("release.yml")["smoke"]["steps"]]

    assert any("pip install dist/*.whl" in each for each in commands)


@pytest.mark.slow
def test_the_tests_run_where_plug_ins_of_others_cannot_be_loaded(tmp_path: Path) -> None:
    """As after `source /opt/ros/...`, whose plug-ins of pytest need libraries that are not here."""
    about = tmp_path / "foreign-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign\nVersion: 1.0\n", encoding="utf-8")
    (about / "entry_points.txt").write_text("[pytest11]\nforeign = foreign_plugin\n", encoding="utf-8")
    (tmp_path / "foreign_plugin.py").write_text("import a_library_that_nobody_has\n", encoding="utf-8")

    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "1", "-q", "tests/core/test_palette.py"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )

    assert run.returncode == 0, run.stdout + run.stderr
