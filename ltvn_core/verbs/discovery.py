"""Finds the installed verbs, and makes the text of `ltvn` and `ltvn --help`: first steps, then all verbs in groups.

Verbs are plug-ins, `name = "package.module:VerbClass"`, of the entry-point group `ltvn.verbs`. The toolkit's own verbs
are found in the same way as those of other packages, so that the core does not import the page. Owns the groups and
their order.
"""

import shutil
import textwrap
from collections.abc import Mapping

from ltvn_core.plugins import OWN_PACKAGE, VERBS, Plugin, find_plugins
from ltvn_core.verbs.verb import Verb

GROUPS: Mapping[str, tuple[str, ...]] = {
    "Drive and map": ("app", "demo", "build", "navigate", "collect", "robot", "guard", "serve"),
    "Look and ask": ("replay", "why", "view", "info", "verify", "report", "mcp"),
    "Import and export": ("import", "export", "repair", "plugins"),
    "Learn and measure": (
        "evaluate",
        "evaluate-robot",
        "lifelong",
        "judge",
        "finetune",
        "train",
        "dataset",
    ),
}
"""Headings of the help, and the verbs below each, in the order that helps a new user."""
FIRST_SHOWN = tuple(name for names in GROUPS.values() for name in names)
"""Order in which verbs are shown. Verbs that are not in this list follow in alphabetical order."""


def find_verbs() -> dict[str, Plugin]:
    """Return the installed verbs by name, in the order in which they are shown. Nothing is imported."""
    return find_plugins(VERBS, first=FIRST_SHOWN)


def load_verb(plugin: Plugin) -> type[Verb]:
    """Import a verb's class.

    Raises:
        PluginError: The module cannot be imported or does not hold a verb.
        MissingLibraryError: It needs a library that an extra installs.
    """
    verb = plugin.load()
    if not (isinstance(verb, type) and issubclass(verb, Verb)):
        raise plugin.refusal("is no subclass of ltvn_core.verbs.verb.Verb")
    with plugin.running("cannot be used"):
        if not isinstance(verb.__doc__ or "", str) or not isinstance(verb.job, str):
            raise plugin.refusal("has a `job` or a docstring that is no text")
        if not verb.job and verb.run is Verb.run:
            raise plugin.refusal('has neither `job = "package.module:function"` nor a method `run`')
    return verb


def load_parsed_verb(plugin: Plugin) -> type[Verb]:
    """Import a verb's class, and let tyro read its options. Raises PluginError and MissingLibraryError."""
    verb = load_verb(plugin)
    if plugin.package != OWN_PACKAGE:
        import tyro

        with plugin.running("has options that no command line can have"):
            tyro.extras.get_parser(verb)
    return verb


DESCRIPTION = "See what a robot's topological map believes: collect, build, navigate, replay."

BEGINNING = f"""{DESCRIPTION}

Four commands to begin with:

  ltvn app                                     the page on the demo apartment: click a goal, and watch
  ltvn import DRIVE --output drive.rrd         your own drive: a bag, a data set, a folder of images
  ltvn build drive.rrd --output map.rrd        a map of it, which ltvn app --map opens
  ltvn replay drive.rrd                        what was recorded, with a slider over its time

ltvn --help lists all verbs, and ltvn VERB --help the options of one."""

_OTHERS = "From other packages"
_WIDEST = 100
_INDENT = 18


def overview(verbs: Mapping[str, type[Verb]]) -> str:
    """Return the help of all verbs in groups; verbs of other packages are in the last group."""
    known = {name for names in GROUPS.values() for name in names}
    groups = {**GROUPS, _OTHERS: tuple(name for name in verbs if name not in known)}
    parts = ["usage: ltvn [-h] [--version] VERB [OPTIONS]", DESCRIPTION]
    for heading, names in groups.items():
        rows = [_row(name, verbs[name]) for name in names if name in verbs]
        if rows:
            parts.append("\n".join([f"{heading}:", *rows]))
    parts.append("ltvn VERB --help lists the options of a verb.")
    return "\n\n".join(parts)


def _row(name: str, verb: type[Verb]) -> str:
    """Return a verb's name and the first paragraph of its description."""
    first = (verb.__doc__ or "").strip().partition("\n\n")[0]
    width = min(shutil.get_terminal_size().columns, _WIDEST)
    return textwrap.fill(
        " ".join(first.split()), width, initial_indent=f"  {name:<{_INDENT - 2}}", subsequent_indent=" " * _INDENT
    )
