"""Which verbs there are: the plug-ins `name = "package.module:VerbClass"` of the entry-point group `ltvn.verbs`.

Ours are found the same way as other people's, so the core needs no import of the page to offer its verbs. Owns the
order in which they are shown.
"""

from ltvn_core.plugins import VERBS, Plugin, find_plugins
from ltvn_core.verbs.verb import Verb

FIRST_SHOWN = (
    "app",
    "demo",
    "collect",
    "import",
    "build",
    "navigate",
    "plant",
    "evaluate",
    "lifelong",
    "replay",
    "view",
    "dataset",
    "pairs",
    "train",
    "finetune",
    "baseline",
    "judge",
    "measure",
    "report",
    "serve",
    "guard",
    "robot",
    "info",
    "verify",
    "repair",
    "export",
    "plugins",
)
"""The order in which verbs are shown: as a first-time user needs them. Verbs that are not named here follow by name."""


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
