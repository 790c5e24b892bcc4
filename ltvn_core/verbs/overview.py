"""What `ltvn` and `ltvn --help` print: where to begin, and all verbs in groups with the first sentence of each."""

import shutil
import textwrap
from collections.abc import Mapping

from ltvn_core.verbs.discovery import GROUPS
from ltvn_core.verbs.verb import Verb

DESCRIPTION = "See what a robot's topological map believes: collect, build, navigate, replay."

BEGINNING = f"""{DESCRIPTION}

Four commands to begin with:

  ltvn app                                     the page on the demo apartment: click a goal, and watch
  ltvn import DRIVE --output drive.rrd         your own drive: a bag, a data set, a folder of pictures
  ltvn build drive.rrd --output map.rrd        a map of it, which ltvn app --map opens
  ltvn replay drive.rrd                        what was recorded, with a slider over its time

ltvn --help lists all verbs, and ltvn VERB --help the options of one."""

_OTHERS = "From other packages"
_WIDEST = 100
_INDENT = 18


def overview(verbs: Mapping[str, type[Verb]]) -> str:
    """Return the help of all verbs, in groups; verbs of other packages have the last one."""
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
    """Return a verb's name and the first paragraph of what it says of itself."""
    first = (verb.__doc__ or "").strip().partition("\n\n")[0]
    width = min(shutil.get_terminal_size().columns, _WIDEST)
    return textwrap.fill(
        " ".join(first.split()), width, initial_indent=f"  {name:<{_INDENT - 2}}", subsequent_indent=" " * _INDENT
    )
