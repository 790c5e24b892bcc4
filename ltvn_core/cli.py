"""`ltvn`: one program, one verb per job.

Parses, runs, prints, and turns every error a user can cause into one clear line and a non-zero exit code. Owns no job
of its own: verbs are classes in the entry-point group `ltvn.verbs` (`ltvn_core.verbs.discovery`).
"""

import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import EntryPoint, version
from pathlib import Path
from types import FrameType

import tyro

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.extras import naming_the_extra
from ltvn_core.verbs.discovery import GROUP, find_verbs, load_verb, load_verbs
from ltvn_core.verbs.verb import Summary, Verb, to_json, to_text

DESCRIPTION = "See what a robot's topological map believes: collect, build, navigate, replay."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code: 0 done, 1 an error, 2 wrong usage, 130 interrupted, 143 terminated."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given == ["--version"]:
        print(f"ltvn {version('ltvn')}")
        return 0
    verbs = find_verbs()
    if not verbs:
        print(f"ltvn: no package offers {GROUP}; install the toolkit: pip install ltvn (or -e .)", file=sys.stderr)
        return 1
    if given and given[0] in verbs:
        name, *options = given
        try:
            verb = load_verb(verbs[name])
        except LtvnError as error:
            return _say(error)
        return run_verb(f"ltvn {name}", verb, options)
    _show_all(verbs, given)
    return 2


def _show_all(verbs: Mapping[str, EntryPoint], given: Sequence[str]) -> None:
    """Show the help of all verbs, or say what is wrong with the usage, and exit."""
    loaded = load_verbs(verbs)
    for line in loaded.broken:
        print(f"ltvn: {line}", file=sys.stderr)
    tyro.extras.subcommand_cli_from_dict(
        dict(loaded.classes), prog="ltvn", description=DESCRIPTION, args=given, sort_subcommands=False
    )


def run_verb(program: str, verb: type[Verb], arguments: Sequence[str] | None = None) -> int:
    """Parse a verb's options, run it and return the exit code; prints what came of it.

    Args:
        program: What a person types for this verb, for its help.
        verb: The class whose fields are the options.
        arguments: The options; those of the command line if not given.
    """
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    chosen = tyro.cli(verb, prog=program, args=arguments)
    try:
        with naming_the_extra(), _unwinding_at_sigterm():
            report(chosen)
    except LtvnError as error:
        return _say(error)
    except _Terminated:
        print("ltvn: terminated", file=sys.stderr)
        return 143
    except KeyboardInterrupt:
        print("ltvn: interrupted", file=sys.stderr)
        return 130
    return 0


class _Terminated(KeyboardInterrupt):
    """Somebody asked the program to end, politely."""


@contextmanager
def _unwinding_at_sigterm() -> Iterator[None]:
    """Let SIGTERM end the block as Ctrl-C does, so that files are finished; a second one ends the process at once."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python allows no one else to say what a signal does.
        return
    process = os.getpid()

    def end(number: int, _frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        if os.getpid() != process:
            os.kill(os.getpid(), number)  # A child that was forked from here ends as it would have.
        raise _Terminated

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def report(verb: Verb) -> None:
    """Run the verb and print its summary, or write it as JSON where the user asked for that."""
    summary = verb.run()
    if verb.json is None:
        print(to_text(summary))
    elif verb.json == Path("-"):
        print(to_json(summary))
    else:
        _write_summary(verb.json, summary)


def _say(error: LtvnError) -> int:
    print(f"ltvn: {error}", file=sys.stderr)
    return 1


def _write_summary(path: Path, summary: Summary) -> None:
    """Write a summary; where the file cannot be written, print it, so that nothing of a long run is lost."""
    try:
        path.write_text(to_json(summary) + "\n")
    except OSError as error:
        print(to_json(summary))
        raise OptionError(f"{path}: the summary could not be written ({error}); it is printed instead.") from error


if __name__ == "__main__":
    sys.exit(main())
