"""`ltvn plugins`: lists the plug-ins of all packages, whether they work, and tests one of them."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.plugins import (
    GROUPS,
    PREDICTORS,
    QUESTIONS,
    READERS,
    ROBOTS,
    SCENES,
    SYSTEMS,
    VERBS,
    Plugin,
    PluginGroup,
    find_plugins,
    left_out_plugins,
)
from ltvn_core.systems.registry import OWN_SYSTEMS, load_system
from ltvn_core.verbs.discovery import load_parsed_verb
from ltvn_core.verbs.verb import Summary, Verb

_LOG = logging.getLogger(__name__)
TEST = "test"


@dataclass(frozen=True, slots=True)
class PluginRow:
    """One plug-in of the list, and whether it can be used."""

    group: str
    name: str
    package: str
    version: str
    works: bool
    """Whether it can be loaded and has the right type; `ltvn plugins test NAME` checks more."""
    why: str
    """The problem; empty if it works."""

    def __str__(self) -> str:
        mark = "works" if self.works else f"cannot be used: {self.why}"
        return f"{self.group:<16} {self.name:<14} {self.package} {self.version}  {mark}"


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
    why: str
    """The requirement that the plug-in does not meet, or what it raised; empty if it passed."""


@dataclass(frozen=True, kw_only=True)
class PluginsVerb(Verb):
    """List the plug-ins of installed packages and whether they work; `ltvn plugins test NAME` tests one of them.

    A test opens the plug-in and checks its whole contract; a robot is not driven. The exit code is 1 if the contract is
    broken.
    """

    command: Positional[tuple[str, ...]] = ()
    """Without arguments, lists all plug-ins; `test NAME` tests one."""
    group: str = ""
    """Group of the plug-in, such as ltvn.predictors, if several groups have one of that name."""
    weights: Path | None = None
    """Weights or card of the predictor that is tested, as in `ltvn plugins test onnx --weights gnm.toml`."""
    drive: Path | None = None
    """A drive for the reader that is tested, as in `ltvn plugins test my-format --drive tour.bin`."""

    def exit_code(self, summary: Summary) -> int:
        """Return 1 if a plug-in breaks its contract."""
        return int(not getattr(summary, "passed", True))

    def run(self) -> Summary:
        """List or test; raises OptionError if the plug-in is not installed."""
        if not self.command:
            groups = [group for group in GROUPS if self.group in ("", group.name)]
            rows = [plugin_row(plugin) for plugin in _installed() if plugin.group in groups]
            rows += [_left_out_row(*both) for group in groups for both in left_out_plugins(group)]
            return PluginsSummary(tuple(rows), sum(not row.works for row in rows))
        if len(self.command) != 2 or self.command[0] != TEST:
            raise OptionError(f"Write `ltvn plugins` or `ltvn plugins {TEST} NAME`, not {' '.join(self.command)!r}.")
        return _tested(self, _find(self, self.command[1]))


def plugin_row(plugin: Plugin) -> PluginRow:
    """Load a plug-in without creating an object with it."""
    try:
        _load(plugin)
        why = ""
    except LtvnError as error:
        why = str(error)
    return PluginRow(plugin.group.name, plugin.name, plugin.package, plugin.version, works=not why, why=why)


def broken_contract(plugin: Plugin, *, weights: Path | None = None, drive: Path | None = None) -> str:
    """Test a plug-in, and return the first requirement that it does not meet, or what it raised; empty if none.

    Only a predictor takes weights, and only a reader a drive.
    """
    from ltvn_core import testing

    checks: dict[PluginGroup, Callable[..., None]] = {
        PREDICTORS: partial(testing.check_predictor, weights=weights),
        SYSTEMS: testing.check_system,
        ROBOTS: testing.check_robot,
        READERS: partial(testing.check_reader, path=drive),
        SCENES: testing.check_scene,
        # By its name, as the command line finds jobs: the page knows the core, and the core knows no page.
        QUESTIONS: lambda made: import_module("ltvn_viz.debugger.question_check").ask_about_demo(made),
        VERBS: _check_verb,
    }
    try:
        checks[plugin.group](_load(plugin))
    except (AssertionError, LtvnError) as error:
        return str(error) or type(error).__name__
    except (Exception, SystemExit) as error:  # Another person's code may raise anything.
        return f"{type(error).__name__}: {error}"
    return ""


def _check_verb(verb: type[Verb]) -> None:
    """Check what loading a verb does not; the verb does not run."""
    assert str(verb.__doc__ or "").strip(), "it has no docstring, which is its help"
    if verb.job:
        module, _, function = verb.job.partition(":")
        assert callable(getattr(import_module(module), function, None)), f"its job {verb.job} is no function"


def _installed() -> list[Plugin]:
    """Return all plug-ins, group by group."""
    from ltvn_core.predictors.opening import OWN_PREDICTORS

    first = {PREDICTORS: OWN_PREDICTORS, SYSTEMS: OWN_SYSTEMS}
    return [plugin for group in GROUPS for plugin in find_plugins(group, first=first.get(group, ())).values()]


def _left_out_row(plugin: Plugin, used: Plugin) -> PluginRow:
    why = f"the package {used.package} has a {used.group.noun} of that name, which is used; rename or uninstall one."
    return PluginRow(plugin.group.name, plugin.name, plugin.package, plugin.version, works=False, why=why)


def _load(plugin: Plugin) -> Any:
    """Load what a plug-in names. Raises PluginError if it is not what its group takes."""
    from ltvn_core.data.importing.reader_registry import load_reader

    match plugin.group.name:
        case SYSTEMS.name:
            return load_system(plugin)
        case VERBS.name:
            return load_parsed_verb(plugin)
        case READERS.name:
            return load_reader(plugin)
        case SCENES.name:
            from ltvn_core.simulation.scene_registry import load_scene_factory  # The simulator may not be installed.

            return load_scene_factory(plugin)
        case _:
            loaded = plugin.load()
            if not callable(loaded):
                raise plugin.refusal("cannot be called")
            return loaded


def _find(options: PluginsVerb, name: str) -> Plugin:
    plugins = [each for each in _installed() if options.group in ("", each.group.name)]
    found = [each for each in plugins if each.name == name]
    if not found:
        names = ", ".join(dict.fromkeys(each.name for each in plugins)) or "none"
        raise OptionError(f"No plug-in is called {name!r}; there are: {names}.")
    if len(found) > 1:
        groups = ", ".join(each.group.name for each in found)
        raise OptionError(f"{len(found)} plug-ins are called {name!r}; say --group, one of: {groups}.")
    return found[0]


def _tested(options: PluginsVerb, plugin: Plugin) -> PluginTestSummary:
    for option, value, group in (("--weights", options.weights, PREDICTORS), ("--drive", options.drive, READERS)):
        if value is not None and plugin.group != group:
            raise OptionError(f"{option} belongs to a {group.noun}; {plugin.name} is a {plugin.group.noun}.")
    if options.drive is not None and not options.drive.exists():
        raise OptionError(
            f"There is no file or folder {options.drive}; --drive names a drive that the reader can read."
        )
    _LOG.info("Testing %s.", plugin.title)
    if plugin.group == READERS and options.drive is None:
        _LOG.info("Reading is not tested: give a drive by --drive.")
    why = broken_contract(plugin, weights=options.weights, drive=options.drive)
    return PluginTestSummary(plugin.group.name, plugin.name, plugin.package, plugin.version, passed=not why, why=why)
