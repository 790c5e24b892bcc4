"""Which verbs there are: those that installed packages offer in the entry-point group `ltvn.verbs`.

Ours are found the same way as other people's, so the core needs no import of the page to offer its verbs. Owns the
order in which they are shown. Loads a verb's module only when that verb is asked for.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points

from ltvn_core.errors import LtvnError, MissingLibraryError, PluginError
from ltvn_core.extras import naming_the_extra
from ltvn_core.verbs.verb import Verb

GROUP = "ltvn.verbs"
"""Name of the entry-point group; an entry is `name = "package.module:VerbClass"`."""

OWN_PACKAGE = "ltvn"

FIRST_SHOWN = (
    "app",
    "demo",
    "collect",
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
    "measure",
    "report",
    "info",
    "verify",
    "repair",
    "export",
)
"""The order in which verbs are shown: as a first-time user needs them. Verbs that are not named here follow by name."""


@dataclass(frozen=True, slots=True)
class LoadedVerbs:
    """Verbs that can be run, and what is wrong with the others."""

    classes: Mapping[str, type[Verb]]
    broken: Sequence[str]
    """One clear line for each verb that could not be loaded."""


def find_verbs(entries: Iterable[EntryPoint] | None = None) -> dict[str, EntryPoint]:
    """Return the installed verbs by name, in the order in which they are shown. Nothing is imported.

    Where two packages offer one name, the toolkit's own verb stands, else the package that comes first by name.

    Args:
        entries: Where to look instead of in the installed packages.
    """
    offered = entry_points(group=GROUP) if entries is None else entries
    found: dict[str, EntryPoint] = {}
    for entry in sorted(offered, key=lambda entry: (package_of(entry) != OWN_PACKAGE, package_of(entry))):
        found.setdefault(entry.name, entry)
    return dict(sorted(found.items(), key=lambda item: (_place(item[0]), item[0])))


def load_verb(entry: EntryPoint) -> type[Verb]:
    """Import a verb's class.

    Raises:
        PluginError: The module cannot be imported or does not hold a verb.
        MissingLibraryError: It needs a library that an extra installs.
    """
    try:
        with naming_the_extra():
            verb = entry.load()
    except MissingLibraryError:
        raise
    except Exception as error:  # Another package's module may raise anything while it is imported.
        raise PluginError(
            f"The verb {entry.name} of the package {package_of(entry)} cannot be loaded "
            f"({type(error).__name__}: {error}); update or uninstall that package."
        ) from error
    if not (isinstance(verb, type) and issubclass(verb, Verb)):
        raise PluginError(
            f"The verb {entry.name} of the package {package_of(entry)} is {entry.value}, which is no subclass of "
            "ltvn_core.verbs.verb.Verb; update or uninstall that package."
        )
    return verb


def load_verbs(entries: Mapping[str, EntryPoint]) -> LoadedVerbs:
    """Import all verbs; one that cannot be loaded is named and does not keep the others away."""
    classes: dict[str, type[Verb]] = {}
    broken: list[str] = []
    for name, entry in entries.items():
        try:
            classes[name] = load_verb(entry)
        except LtvnError as error:
            broken.append(str(error))
    return LoadedVerbs(classes, broken)


def package_of(entry: EntryPoint) -> str:
    """Name the package that offers a verb."""
    return entry.dist.name if entry.dist is not None else "unknown"


def _place(name: str) -> int:
    return FIRST_SHOWN.index(name) if name in FIRST_SHOWN else len(FIRST_SHOWN)
