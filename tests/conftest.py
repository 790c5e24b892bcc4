"""How the whole suite runs: with a cache of its own, what takes long first, and on a plain installation what it can."""

import gc
import os
import shutil
import tempfile
from collections.abc import Generator
from importlib.util import find_spec

import pytest
from xdist.remote import Producer

from ltvn_core.extras import EXTRAS
from tests.longest_first import ModuleTimes, OneBrowser, longest_first

ONLY_FOR_TESTS = ("nbclient", "nbformat", "playwright")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option with which a run of all tests writes down how long each module took."""
    parser.addoption("--keep-times", action="store_true", help="write tests/module_seconds.txt anew")


def pytest_configure(config: pytest.Config) -> None:
    """Give this run, with all processes that test for it, an empty cache; nothing of the user's is read or written."""
    if hasattr(config, "workerinput"):  # A process of pytest-xdist gets the cache of the one that started it.
        return
    config.pluginmanager.register(ModuleTimes(are_kept=bool(config.getoption("--keep-times"))), "module-times")
    folder = tempfile.mkdtemp(prefix="ltvn-test-cache-")
    os.environ["XDG_CACHE_HOME"] = folder
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


def pytest_collection_finish() -> None:
    """Keep modules and tests, which live to the end, out of every garbage collection: a tenth of the whole run."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Skip the modules that import a library which is not installed here, as Embree cannot be on ARM Linux."""
    report = yield
    if report.outcome == "failed" and (missing := _missing_library(str(report.longrepr))) is not None:
        report.outcome = "skipped"
        report.longrepr = (str(collector.path), 1, f"Skipped: {missing} is not installed")
    return report


def _missing_library(text: str) -> str | None:
    """Return which library of ours that may be missing is named in an import error and is missing."""
    named = [each for each in (*EXTRAS, *ONLY_FOR_TESTS) if f"No module named '{each}'" in text]
    return next((each for each in named if find_spec(each) is None), None)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the modules that take long first."""
    longest_first(items)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> OneBrowser:
    """Let one process alone open browsers."""
    return OneBrowser(config, log)
