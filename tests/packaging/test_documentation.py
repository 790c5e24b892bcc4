"""The documentation site builds without a warning, and a reader's browser fetches nothing from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("site")
    # Without --quiet, which also hides the warnings from --strict.
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(build, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def test_a_page_loads_nothing_from_another_machine(site: Path) -> None:
    for page in site.rglob("*.html"):
        loaded = re.findall(
            r"<(?:script|img|link|iframe)\b[^>]*?(?:src|href)=[\"']?([^\"' >]+)", page.read_text(encoding="utf-8")
        )
        assert [each for each in loaded if each.startswith(("http:", "https:", "//"))] == []


def test_the_tutorial_names_commands_that_exist() -> None:
    from ltvn_core.verbs.discovery import find_verbs

    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    named = {
        verb
        for page in pages
        for verb in re.findall(r"(?:^|`) *ltvn ([a-z][a-z-]*)", page.read_text(encoding="utf-8"), re.MULTILINE)
    }

    assert named <= set(find_verbs()) | {"figures"}
