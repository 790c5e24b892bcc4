"""Which verbs there are: the plug-ins `name = "package.module:VerbClass"` of the entry-point group `ltvn.verbs`.

Ours are found the same way as other people's, so the core needs no import of the page to offer its verbs. Owns the
groups and the order in which they are shown.
"""

from collections.abc import Mapping

from ltvn_core.plugins import VERBS, Plugin, find_plugins
from ltvn_core.verbs.verb import Verb

GROUPS: Mapping[str, tuple[str, ...]] = {
    "Drive and map": ("app", "demo", "build", "navigate", "collect", "robot", "guard", "serve"),
    "Look and ask": ("replay", "view", "info", "verify", "report", "pairs"),
    "Bring in and out": ("import", "export", "repair", "plugins"),
    "Learn and measure": (
        "evaluate",
        "evaluate-robot",
        "lifelong",
        "judge",
        "finetune",
        "train",
        "dataset",
        "measure",
        "baseline",
        "plant",
    ),
}
"""Headings of the help and the verbs under each, as a first-time user needs them."""
FIRST_SHOWN = tuple(name for names in GROUPS.values() for name in names)
"""The order in which verbs are shown. Verbs that are not named here follow by name."""


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
    return verb
