"""`ltvn plugins`: what packages add to the toolkit, whether it works, and a test of it."""

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.contracts.contract_check import ContractCheck
    from ltvn_core.contracts.plugin_contracts import PluginRow
    from ltvn_core.plugins import Plugin

_LOG = logging.getLogger(__name__)

TEST = "test"


@dataclass(frozen=True)
class PluginsSummary:
    """All plug-ins, group by group."""

    plugins: "tuple[PluginRow, ...]"
    broken: int
    """How many of them cannot be used."""


@dataclass(frozen=True)
class PluginTestSummary:
    """What came of the contract test of one plug-in."""

    group: str
    name: str
    package: str
    version: str
    passed: bool
    checks: "tuple[ContractCheck, ...]"


@dataclass(frozen=True, kw_only=True)
class PluginsVerb(Verb):
    """List what installed packages add to the toolkit, and whether it works; `ltvn plugins test NAME` tries one of it.

    A test opens the plug-in and looks at every point of its contract; a robot is looked at and not driven. It ends with
    exit code 1 where a point is broken.
    """

    command: Positional[tuple[str, ...]] = ()
    """Nothing lists all plug-ins; `test NAME` tests one."""
    group: str = ""
    """Where several groups have the name: the one meant, as in ltvn.predictors."""

    def run(self) -> Summary:
        """List or test; raises OptionError for a plug-in that is not there."""
        from ltvn_core.contracts.plugin_contracts import installed_plugins, plugin_row

        if not self.command:
            rows = tuple(plugin_row(plugin) for plugin in installed_plugins() if self.group in ("", plugin.group.name))
            return PluginsSummary(rows, sum(not row.works for row in rows))
        if len(self.command) != 2 or self.command[0] != TEST:
            raise OptionError(f"Write `ltvn plugins` or `ltvn plugins {TEST} NAME`, not {' '.join(self.command)!r}.")
        return self._tested(self._find(self.command[1]))

    def exit_code(self, summary: Summary) -> int:
        """Fail where a plug-in breaks its contract."""
        return int(isinstance(summary, PluginTestSummary) and not summary.passed)

    def _find(self, name: str) -> "Plugin":
        from ltvn_core.contracts.plugin_contracts import installed_plugins

        plugins = [each for each in installed_plugins() if self.group in ("", each.group.name)]
        found = [each for each in plugins if each.name == name]
        if not found:
            names = ", ".join(dict.fromkeys(each.name for each in plugins)) or "none"
            raise OptionError(f"No plug-in is called {name!r}; there are: {names}.")
        if len(found) > 1:
            groups = ", ".join(each.group.name for each in found)
            raise OptionError(f"{len(found)} plug-ins are called {name!r}; say --group, one of: {groups}.")
        return found[0]

    def _tested(self, plugin: "Plugin") -> PluginTestSummary:
        from ltvn_core.contracts.plugin_contracts import contract_checks

        _LOG.info("Testing %s.", plugin.title)
        checks = tuple(contract_checks(plugin))
        return PluginTestSummary(
            group=plugin.group.name,
            name=plugin.name,
            package=plugin.package,
            version=plugin.version,
            passed=all(check.passed for check in checks),
            checks=checks,
        )
