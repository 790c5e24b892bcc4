"""Which contract belongs to which kind of plug-in, and what can be told of a plug-in without trying it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from ltvn_core.contracts.contract_check import ContractCheck, run_checks
from ltvn_core.contracts.predictor_contract import predictor_checks
from ltvn_core.contracts.reader_contract import reader_checks
from ltvn_core.contracts.robot_contract import robot_checks
from ltvn_core.contracts.system_contract import system_checks
from ltvn_core.errors import LtvnError
from ltvn_core.plugins import (
    GROUPS,
    PREDICTORS,
    READERS,
    ROBOTS,
    SCENES,
    SYSTEMS,
    Plugin,
    PluginGroup,
    find_plugins,
)
from ltvn_core.predictors.registry import OWN_PREDICTORS
from ltvn_core.systems.registry import OWN_SYSTEMS, load_system

_FIRST: Mapping[PluginGroup, tuple[str, ...]] = {PREDICTORS: OWN_PREDICTORS, SYSTEMS: OWN_SYSTEMS}


@dataclass(frozen=True, slots=True)
class PluginRow:
    """A plug-in, and whether it can be used."""

    group: str
    name: str
    package: str
    version: str
    works: bool
    """It can be loaded and looks like one; `ltvn plugins test NAME` tells more."""
    why: str
    """What is wrong with it; empty where it works."""

    def __str__(self) -> str:
        mark = "works" if self.works else f"cannot be used: {self.why}"
        return f"{self.group:<16} {self.name:<14} {self.package} {self.version}  {mark}"


def installed_plugins() -> list[Plugin]:
    """Return all plug-ins, group by group."""
    return [plugin for group in GROUPS for plugin in find_plugins(group, first=_FIRST.get(group, ())).values()]


def plugin_row(plugin: Plugin) -> PluginRow:
    """Load a plug-in, and make nothing of it."""
    try:
        _load(plugin)
        why = ""
    except LtvnError as error:
        why = str(error)
    return PluginRow(plugin.group.name, plugin.name, plugin.package, plugin.version, works=not why, why=why)


def contract_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Look at all points of a plug-in's contract, one after the other."""
    checks = _CONTRACTS.get(plugin.group, _loads)
    return checks(plugin)


def _loads(plugin: Plugin) -> Iterator[ContractCheck]:
    """All that can be told of a verb or a question."""

    def load() -> str:
        _load(plugin)
        return plugin.place

    return run_checks(("can be loaded", load), ())


def _scene_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    from ltvn_core.contracts.scene_contract import scene_checks  # Needs the simulator's libraries.

    return scene_checks(plugin)


def _load(plugin: Plugin) -> None:
    """Load a plug-in. Raises PluginError where it is nothing that can be called, or no system."""
    if plugin.group == SYSTEMS:
        load_system(plugin)
    elif not callable(plugin.load()):
        raise plugin.refusal("cannot be called")


_CONTRACTS: Mapping[PluginGroup, Callable[[Plugin], Iterator[ContractCheck]]] = {
    PREDICTORS: predictor_checks,
    SYSTEMS: system_checks,
    ROBOTS: robot_checks,
    READERS: reader_checks,
    SCENES: _scene_checks,
}
