"""Navigation systems are found by name, those of other packages too, and a broken one says whose it is."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from ltvn_core.config import ROBUST
from ltvn_core.errors import OptionError, PluginError
from ltvn_core.graph.navigation_system import NoMaintenance
from ltvn_core.systems.entry import SystemEntry
from ltvn_core.systems.registry import (
    DEFAULT_SYSTEM,
    OWN_SYSTEMS,
    known_system,
    network_owner,
    own_systems,
    recorded_system,
    system_entry,
    system_names,
)
from tests.core.plugin_packages import install

FOREIGN_MODULE = """
from dataclasses import replace
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.systems.entry import SystemEntry

def cautious_system(method):
    return replace(ltvn_system(method), name="cautious")

CAUTIOUS = SystemEntry(name="cautious", label="Cautious", factory=cautious_system)
NOT_A_SYSTEM = 7
"""


@pytest.fixture
def offer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Put a package beside ours that brings one entry point."""

    def install_with(entry_point: str) -> None:
        install(tmp_path, "cautious-robots", f"[ltvn.systems]\n{entry_point}\n", source=FOREIGN_MODULE)
        monkeypatch.syspath_prepend(str(tmp_path))
        monkeypatch.delitem(sys.modules, "cautious_robots", raising=False)

    return install_with


@pytest.mark.parametrize("entry", [*own_systems()], ids=lambda entry: entry.name)
def test_each_own_entry_agrees_with_its_system_and_its_weights_are_there(entry: SystemEntry) -> None:
    assert system_entry(entry.name) is entry
    assert entry.factory(ROBUST).name == entry.name
    assert entry.weights.is_file()


@pytest.mark.parametrize("entry", [*own_systems()], ids=lambda entry: entry.name)
def test_no_system_changes_its_map_where_the_method_does_not_maintain(entry: SystemEntry) -> None:
    assert type(entry.factory(replace(ROBUST, maintain=False)).maintenance) is NoMaintenance


def test_systems_whose_networks_learn_the_same_share_one() -> None:
    shared = {name: network_owner(name) for name in OWN_SYSTEMS}
    assert {name for name, owner in shared.items() if owner == "ltvn"} == {"ltvn", "meng", "brm", "placenav"}
    assert {name for name, owner in shared.items() if owner == "ving"} == {"ving", "sgm"}
    assert all(shared[name] == name for name in ("sptm", "sorb", "htm"))


def test_a_system_of_another_package_is_found_by_its_name(offer: Callable[[str], None]) -> None:
    offer("cautious = cautious_robots:CAUTIOUS")
    assert system_names() == (*OWN_SYSTEMS, "cautious")
    assert "cautious_robots" not in sys.modules
    entry = system_entry("cautious")
    assert (entry.label, entry.factory(ROBUST).name) == ("Cautious", "cautious")


def test_a_plain_function_is_a_system_too(offer: Callable[[str], None]) -> None:
    offer("cautious = cautious_robots:cautious_system")
    entry = system_entry("cautious")
    assert (entry.label, entry.weights) == ("cautious", system_entry(DEFAULT_SYSTEM).weights)
    assert entry.factory(ROBUST).name == "cautious"


def test_no_other_package_takes_the_place_of_an_own_system(offer: Callable[[str], None]) -> None:
    offer("ltvn = cautious_robots:CAUTIOUS")
    assert system_names() == OWN_SYSTEMS
    assert system_entry("ltvn").label == "LTVN"


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("cautious_robots:MISSING", "cannot be loaded .*MISSING.* repair or uninstall"),
        ("cautious_robots:NOT_A_SYSTEM", "neither a SystemEntry with that name nor a function"),
    ],
)
def test_a_broken_system_is_refused_with_the_name_of_its_package(
    offer: Callable[[str], None], value: str, reason: str
) -> None:
    offer(f"cautious = {value}")
    with pytest.raises(PluginError, match=rf"cautious of the package cautious-robots .*{reason}"):
        system_entry("cautious")


def test_an_unknown_name_is_refused_with_those_that_exist() -> None:
    with pytest.raises(OptionError, match=r"'orb'.*ltvn, sptm, ving"):
        system_entry("orb")
    assert known_system("orb") is None


def test_maps_name_their_system_and_old_ones_that_do_not_are_the_papers() -> None:
    assert recorded_system({"system": "ving"}).name == "ving"
    assert recorded_system({}).name == DEFAULT_SYSTEM
    with pytest.raises(OptionError, match=r"'orb', which is not installed here.*Install the package"):
        recorded_system({"system": "orb"})
