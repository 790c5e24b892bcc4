"""How the whole suite runs: with a cache of its own, and with what takes long first."""

import os
import shutil
import tempfile
from itertools import chain, zip_longest

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Give this run, with all processes that test for it, an empty cache; nothing of the user's is read or written."""
    if hasattr(config, "workerinput"):  # A process of pytest-xdist gets the cache of the one that started it.
        return
    folder = tempfile.mkdtemp(prefix="ltvn-test-cache-")
    os.environ["XDG_CACHE_HOME"] = folder
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the modules that take long first, so that in the end no process waits for another one.

    Those that mostly compute and those that mostly wait for a browser come by turns, and so side by side.
    """
    browser = _paths_with(items, "browser")
    slow = _paths_with(items, "slow")
    turns = [path for path in chain(*zip_longest(slow, browser)) if path is not None]
    rank = {path: number for number, path in enumerate(turns)}
    items.sort(key=lambda item: rank.get(str(item.path), len(rank)))


def _paths_with(items: list[pytest.Item], marker: str) -> list[str]:
    """Return the modules in which a test has a marker, in their order."""
    return [*dict.fromkeys(str(item.path) for item in items if item.get_closest_marker(marker) is not None)]
