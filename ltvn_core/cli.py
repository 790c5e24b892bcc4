"""`ltvn`: one program, with one verb for each job.

Parses, runs, prints, and turns every failure that is not a programming error into one clear line and a non-zero exit
code; `--debug`, or the variable LTVN_DEBUG, also shows the traceback. Owns no job of its own: verbs are classes in the
entry-point group `ltvn.verbs` (`ltvn_core.verbs.discovery`). Imports almost nothing before `main`, so that Ctrl-C
during the imports is handled as well.
"""

import gc
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NoReturn

from ltvn_core.errors import LtvnError, OptionError, remedy

if TYPE_CHECKING:
    from pathlib import Path
    from types import FrameType

    from ltvn_core.plugins import Plugin
    from ltvn_core.verbs.verb import Summary, Verb

_COLLECTED_AFTER = 20_000
"""Number of new objects after which garbage is collected; with Python's 700, importing libraries takes a fifth
longer."""
FAILED = 1
WRONG_USAGE = 2
INTERRUPTED = 130
"""Exit code of shells after SIGINT: 128 plus the number of the signal."""
CLOSED_PIPE = 141
"""Exit code of shells after SIGPIPE: the reader of the output, such as `head`, closed it early."""
TERMINATED = 143
"""Exit code of shells after SIGTERM: 128 plus the number of the signal."""
HUNG_UP = 129
"""Exit code of shells after SIGHUP: the terminal or the connection to it was closed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code.

    The code is 0 for success, 1 for an error, 2 for wrong usage, 129 after SIGHUP, 130 after an interruption, 141 if
    the output was closed, and 143 after SIGTERM.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    return _exit_code(lambda: _main(given), debug="--debug" in given)


def run_verb(program: str, verb: "type[Verb]", arguments: Sequence[str] | None = None) -> int:
    """Parse a verb's options, run it and return the exit code; prints the result.

    Args:
        program: What a person types for this verb, for its help.
        verb: The class whose fields are the options.
        arguments: The options; those of the command line if not given.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    return _exit_code(lambda: _run(program, verb, given), debug="--debug" in given)


def report(verb: "Verb") -> int:
    """Run the verb, print its summary or write it as JSON where the user asked for that, and return the exit code."""
    from ltvn_core.atomic_files import is_standard_output
    from ltvn_core.terminal_text import shown_plainly
    from ltvn_core.verbs.outputs import outputs_of
    from ltvn_core.verbs.verb import require_summary, to_json, to_text

    verb.check_options()
    summary = require_summary(verb, verb.run())
    if verb.json is None:
        if text := to_text(summary):
            is_taken = any(is_standard_output(path) for path, _ in outputs_of(verb))
            print(shown_plainly(text), file=sys.stderr if is_taken else sys.stdout)
    elif str(verb.json) == "-":
        print(to_json(summary))
    else:
        _write_summary(verb.json, summary)
    return verb.exit_code(summary)


def _main(given: Sequence[str]) -> int:
    from importlib.metadata import version

    from ltvn_core.plugins import VERBS
    from ltvn_core.verbs.discovery import BEGINNING, find_verbs, load_parsed_verb

    if given == ["--version"]:
        print(f"ltvn {version('ltvn')}")
        return 0
    verbs = find_verbs()
    if not verbs:
        raise OptionError(f"no package offers {VERBS.name}; install the toolkit: pip install ltvn (or -e .)")
    if given and given[0] in verbs:
        name, *options = given
        return _run(f"ltvn {name}", load_parsed_verb(verbs[name]), options)
    if not given:
        print(BEGINNING)
        return 0
    if given[0].startswith("--tyro-"):
        _print_completion(verbs, given)
    if given[0] not in ("-h", "--help"):
        from ltvn_core.terminal_text import which_name

        print(
            f"ltvn: there is no verb {given[0]!r}. {which_name(given[0], verbs)}; ltvn --help says what each does.",
            file=sys.stderr,
        )
        return WRONG_USAGE
    _show_all(verbs)
    return 0


def _show_all(verbs: "Mapping[str, Plugin]") -> None:
    """Print all verbs, and name those that cannot be loaded."""
    from ltvn_core.plugins import load_plugins
    from ltvn_core.terminal_text import shown_plainly
    from ltvn_core.verbs.discovery import load_verb, overview

    loaded = load_plugins(verbs, load_verb)
    for line in loaded.broken:
        print(f"ltvn: {shown_plainly(line)}", file=sys.stderr)
    print(shown_plainly(overview(loaded.by_name)))


def _print_completion(verbs: "Mapping[str, Plugin]", given: Sequence[str]) -> NoReturn:
    """Let tyro print the shell completion for verbs and options, and exit."""
    import tyro

    from ltvn_core.plugins import load_plugins
    from ltvn_core.verbs.discovery import load_parsed_verb

    by_name = dict(load_plugins(verbs, load_parsed_verb).by_name)
    tyro.extras.subcommand_cli_from_dict(by_name, prog="ltvn", args=given, sort_subcommands=False)
    raise AssertionError("tyro exits once it has printed")


def _run(program: str, verb: "type[Verb]", given: Sequence[str]) -> int:
    import tyro

    from ltvn_core.atomic_files import owner_only
    from ltvn_core.extras import naming_the_extra

    gc.set_threshold(_COLLECTED_AFTER)
    _show_log()
    chosen = tyro.cli(verb, prog=program, args=given)
    with naming_the_extra(), _unwinding_at_signals(), owner_only():
        return report(chosen)


def _show_log() -> None:
    import logging

    from ltvn_core.terminal_text import PlainFormatter

    shown = logging.StreamHandler(sys.stderr)
    shown.setFormatter(PlainFormatter("%(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[shown])


class _Terminated(KeyboardInterrupt):
    """The program received SIGTERM."""


class _HungUp(KeyboardInterrupt):
    """The program received SIGHUP."""


@contextmanager
def _unwinding_at_signals() -> Iterator[None]:
    """Make SIGTERM and SIGHUP end the block as Ctrl-C does, so that files are finished.

    A second SIGTERM ends the process at once. A second SIGHUP is ignored, because shells repeat that of the terminal.
    A program that was started by nohup ignores every SIGHUP.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Python allows only the main thread to set a handler.
        return
    process = os.getpid()
    raised: dict[int, type[KeyboardInterrupt]] = {signal.SIGTERM: _Terminated}
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        raised[signal.SIGHUP] = _HungUp

    def end(number: int, _frame: "FrameType | None") -> None:
        signal.signal(number, signal.SIG_DFL)
        if os.getpid() != process:
            os.kill(os.getpid(), number)  # A forked child process ends as it would have without this handler.
        if raised[number] is _HungUp:
            signal.signal(number, signal.SIG_IGN)
            _leave_closed_terminal()
        raise raised[number]

    before = {number: signal.signal(number, end) for number in raised}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave_closed_terminal() -> None:
    """Discard what is printed from now on to a terminal that is gone, where printing would fail."""
    for number in (1, 2):
        with suppress(OSError):
            watched = select.poll()
            watched.register(number, 0)
            if any(what & (select.POLLHUP | select.POLLERR) for _, what in watched.poll(0)):
                os.dup2(os.open(os.devnull, os.O_WRONLY), number)


def _exit_code(job: Callable[[], int], *, debug: bool) -> int:
    """Do a job and return its exit code; the failures of all verbs are handled here."""
    _open_closed_streams()
    _allow_any_file_name()
    _honour_no_color()
    try:
        try:
            code = job()
        finally:
            sys.stdout.flush()  # A closed pipe raises here, not when Python exits.
        return code
    except _Terminated as terminated:
        return _say("terminated", terminated, TERMINATED, debug=debug)
    except _HungUp as hung_up:
        return _say("the terminal was closed", hung_up, HUNG_UP, debug=debug)
    except KeyboardInterrupt as interrupted:
        return _say("interrupted", interrupted, INTERRUPTED, debug=debug)
    except BrokenPipeError as error:
        if _is_output_closed():
            return CLOSED_PIPE
        return _say(_system_failure(error), error, FAILED, debug=debug)
    except LtvnError as error:
        return _say(str(error), error, FAILED, debug=debug)
    except OSError as error:
        return _say(_system_failure(error), error, FAILED, debug=debug)
    except MemoryError as error:
        text = (
            f"there is not enough memory ({error or 'all of it is used'}); close other programs, or choose smaller "
            "numbers."
        )
        return _say(text, error, FAILED, debug=debug)
    except UnicodeError as error:
        text = f"a name or a text is not UTF-8 ({error}); rename the file, or save the text as UTF-8."
        return _say(text, error, FAILED, debug=debug)
    except OverflowError as error:
        return _say(f"a number is too large ({error}); give a smaller one.", error, FAILED, debug=debug)
    except Exception as error:
        from ltvn_core.plugins import plugin_at_fault

        if (plugin := plugin_at_fault(error)) is None:
            raise  # A programming error of ours: the traceback is for its report.
        text = f"{plugin.title} failed ({type(error).__name__}: {error}); {plugin.remedy}. --debug shows where."
        return _say(text, error, FAILED, debug=debug)


def _system_failure(error: OSError) -> str:
    """Return which operation the system refused, for which file, and what to do next."""
    names = " and ".join(str(name) for name in (error.filename, error.filename2) if name is not None)
    what = error.strerror or str(error) or type(error).__name__
    advice = remedy(error)
    if "temporary directory" in what:
        advice = "set TMPDIR to a folder with free space"
    return f"{names}: {what}; {advice}." if names else f"{what}; {advice}."


def _say(text: str, error: BaseException, code: int, *, debug: bool) -> int:
    """Print a failure as one line, after its traceback if the user asked for that; return the code."""
    from ltvn_core.terminal_text import shown_plainly

    if debug or os.environ.get("LTVN_DEBUG"):
        import traceback

        print(shown_plainly("".join(traceback.format_exception(error))), end="", file=sys.stderr)
    line = " ".join(part.strip() for part in text.splitlines() if part.strip())
    print(f"ltvn: {shown_plainly(line)}", file=sys.stderr)
    return code


def _open_closed_streams() -> None:
    """Discard what is printed to standard streams that were closed at the start, as by cron and `2>&-`.

    Their numbers are taken first, so that no file of ours gets them, into which a library could then print.
    """
    names = ("stdin", "stdout", "stderr")
    if all(getattr(sys, name) is not None for name in names):
        return
    while (number := os.open(os.devnull, os.O_RDWR)) < len(names):
        pass
    os.close(number)
    for name in names:
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115


def _allow_any_file_name() -> None:
    """Print file names that are not valid UTF-8 with escaped bytes, instead of raising an exception."""
    reconfigure = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="backslashreplace")


def _honour_no_color() -> None:
    """Print help without colours if NO_COLOR is set (https://no-color.org), because tyro reads only TERM."""
    if os.environ.get("NO_COLOR"):
        os.environ["TERM"] = "dumb"


def _is_output_closed() -> bool:
    """Tell whether the output was closed; if so, discard the rest of it."""
    with suppress(OSError, ValueError, AttributeError):  # For a stream without a file, or a system without poll.
        pipe = select.poll()
        pipe.register(sys.stdout.fileno(), 0)
        if any(what & select.POLLERR for _, what in pipe.poll(0)):
            # Python flushes once more when it exits, which would fail.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return True
    return False


def _write_summary(path: "Path", summary: "Summary") -> None:
    """Write a summary to a file; if that fails, print it, so that the result of a long run is not lost."""
    from ltvn_core.atomic_files import is_stream
    from ltvn_core.verbs.outputs import require_summary_file
    from ltvn_core.verbs.verb import to_json

    try:
        if not is_stream(path):
            require_summary_file(path)
            path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(to_json(summary) + "\n", encoding="utf-8")
    except (OSError, ValueError, LtvnError) as error:
        print(to_json(summary))
        raise OptionError(f"{path}: the summary could not be written ({error}); it is printed instead.") from error


if __name__ == "__main__":
    sys.exit(main())
