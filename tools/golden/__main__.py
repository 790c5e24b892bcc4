"""Write golden files, or compare with them: `python -m tools.golden make` or `compare`, of all parts or the named ones.

The parts `more-...` take minutes. They are made only if named, and git ignores their files.
"""

import argparse
import logging
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from tools.golden import program, runs
from tools.golden.answers import NAMES, answers, told_answers
from tools.golden.files import FOLDER, Row, difference, write

PARTS: Mapping[str, Callable[[], Iterator[Row]]] = {
    **{f"answers-{name}": partial(answers, name) for name in NAMES},
    "answers-told": told_answers,
    "maps": partial(runs.maps, 120, ["robust", "paper"]),
    "runs": partial(runs.runs, runs.SETTINGS),
    "imports": program.imports,
    "help": program.help_texts,
    "summaries": partial(program.summaries, program.COMMANDS),
    "tables": program.tables,
    "more-maps": partial(runs.maps, None, ["robust"]),
    "more-runs": partial(runs.runs, runs.MORE_SETTINGS),
    "more-summaries": partial(program.summaries, program.MORE_COMMANDS, whole=True),
}
"""What each golden file holds."""
USUAL = tuple(name for name in PARTS if not name.startswith("more-"))


def file_of(part: str) -> Path:
    """Return the golden file of a part."""
    return FOLDER / f"{part}.json"


def main(arguments: Sequence[str] | None = None) -> int:
    """Make or compare files, and return 1 where one differs."""
    parser = argparse.ArgumentParser(prog="python -m tools.golden", description=__doc__)
    parser.add_argument("task", choices=("make", "compare"))
    parser.add_argument("part", nargs="*", help=", ".join(PARTS), choices=[*PARTS, []])
    options = parser.parse_args(arguments)
    logging.disable(logging.WARNING)
    differs = False
    for part in options.part or USUAL:
        started = time.process_time()
        if options.task == "make":
            said = f"{write(file_of(part), PARTS[part]())} rows"
        else:
            found = difference(file_of(part), PARTS[part]())
            said, differs = found or "as before", differs or found is not None
        sys.stdout.write(f"{part}: {said} ({time.process_time() - started:.0f} s of one core)\n")
        sys.stdout.flush()
    return int(differs)


if __name__ == "__main__":
    sys.exit(main())
