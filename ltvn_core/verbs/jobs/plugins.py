"""`ltvn plugins`: lists the plug-ins of all packages, whether they work, and tests one of them."""

import logging
from dataclasses import dataclass

from ltvn_core.errors import OptionError
from ltvn_core.plugins import PREDICTORS, Plugin
from ltvn_core.verbs.contracts.plugin_contracts import PluginRow, contract_checks, installed_plugins, plugin_row
from ltvn_core.verbs.contracts.predictor_contract import ContractCheck
from ltvn_core.verbs.plugins import PluginsVerb
from ltvn_core.verbs.verb import Summary

_LOG = logging.getLogger(__name__)

TEST = "test"


@dataclass(frozen=True)
class PluginsSummary:
    """All plug-ins, group by group."""

    plugins: tuple[PluginRow, ...]
    broken: int
    """Number of plug-ins that cannot be used."""


@dataclass(frozen=True)
class PluginTestSummary:
    """Result of the contract test of one plug-in."""

    group: str
    name: str
    package: str
    version: str
    passed: bool
    checks: tuple[ContractCheck, ...]


def list_or_test(options: PluginsVerb) -> Summary:
    """List or test; raises OptionError if the plug-in is not installed."""
    if not options.command:
        rows = tuple(plugin_row(plugin) for plugin in installed_plugins() if options.group in ("", plugin.group.name))
        return PluginsSummary(rows, sum(not row.works for row in rows))
    if len(options.command) != 2 or options.command[0] != TEST:
        raise OptionError(f"Write `ltvn plugins` or `ltvn plugins {TEST} NAME`, not {' '.join(options.command)!r}.")
    return _tested(options, _find(options, options.command[1]))


def _find(options: PluginsVerb, name: str) -> Plugin:
    plugins = [each for each in installed_plugins() if options.group in ("", each.group.name)]
    found = [each for each in plugins if each.name == name]
    if not found:
        names = ", ".join(dict.fromkeys(each.name for each in plugins)) or "none"
        raise OptionError(f"No plug-in is called {name!r}; there are: {names}.")
    if len(found) > 1:
        groups = ", ".join(each.group.name for each in found)
        raise OptionError(f"{len(found)} plug-ins are called {name!r}; say --group, one of: {groups}.")
    return found[0]


def _tested(options: PluginsVerb, plugin: Plugin) -> PluginTestSummary:
    if options.weights is not None and plugin.group != PREDICTORS:
        raise OptionError(f"--weights belongs to a predictor; {plugin.name} is a {plugin.group.noun}.")
    _LOG.info("Testing %s.", plugin.title)
    checks = tuple(contract_checks(plugin, options.weights))
    return PluginTestSummary(
        group=plugin.group.name,
        name=plugin.name,
        package=plugin.package,
        version=plugin.version,
        passed=all(check.passed for check in checks),
        checks=checks,
    )
