"""`ltvn`: one program, one verb per job.

Parses, runs, prints, and turns every error a user can cause into one clear line and a non-zero exit code. Owns no job
of its own; those are in `ltvn_core.verbs`.
"""

import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, TypeAlias

import tyro
from tyro.conf import subcommand

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.verbs.app import App, Replay
from ltvn_core.verbs.bench import Bench
from ltvn_core.verbs.build import Build
from ltvn_core.verbs.collect import Collect
from ltvn_core.verbs.dataset import Dataset
from ltvn_core.verbs.demo import Demo
from ltvn_core.verbs.evaluate import Evaluate
from ltvn_core.verbs.export import Export
from ltvn_core.verbs.figures import Figures
from ltvn_core.verbs.files import Info, Repair, Verify
from ltvn_core.verbs.finetune import Finetune
from ltvn_core.verbs.lifelong import Lifelong
from ltvn_core.verbs.measure import Measure
from ltvn_core.verbs.navigate import Navigate
from ltvn_core.verbs.pairs import Pairs
from ltvn_core.verbs.plant import Plant
from ltvn_core.verbs.report import Report
from ltvn_core.verbs.rival import Rival
from ltvn_core.verbs.train import Train
from ltvn_core.verbs.verb import Summary, Verb, to_json, to_text
from ltvn_core.verbs.view import View

AnyVerb: TypeAlias = (
    Annotated[App, subcommand("app", prefix_name=False)]
    | Annotated[Demo, subcommand("demo", prefix_name=False)]
    | Annotated[Collect, subcommand("collect", prefix_name=False)]
    | Annotated[Build, subcommand("build", prefix_name=False)]
    | Annotated[Navigate, subcommand("navigate", prefix_name=False)]
    | Annotated[Plant, subcommand("plant", prefix_name=False)]
    | Annotated[Evaluate, subcommand("evaluate", prefix_name=False)]
    | Annotated[Lifelong, subcommand("lifelong", prefix_name=False)]
    | Annotated[Replay, subcommand("replay", prefix_name=False)]
    | Annotated[View, subcommand("view", prefix_name=False)]
    | Annotated[Dataset, subcommand("dataset", prefix_name=False)]
    | Annotated[Pairs, subcommand("pairs", prefix_name=False)]
    | Annotated[Train, subcommand("train", prefix_name=False)]
    | Annotated[Finetune, subcommand("finetune", prefix_name=False)]
    | Annotated[Rival, subcommand("rival", prefix_name=False)]
    | Annotated[Measure, subcommand("measure", prefix_name=False)]
    | Annotated[Figures, subcommand("figures", prefix_name=False)]
    | Annotated[Report, subcommand("report", prefix_name=False)]
    | Annotated[Info, subcommand("info", prefix_name=False)]
    | Annotated[Verify, subcommand("verify", prefix_name=False)]
    | Annotated[Repair, subcommand("repair", prefix_name=False)]
    | Annotated[Export, subcommand("export", prefix_name=False)]
    | Annotated[Bench, subcommand("bench", prefix_name=False)]
)

DESCRIPTION = "See what a robot's topological map believes: collect, build, navigate, replay."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code: 0 done, 1 a clear error, 2 wrong usage, 130 interrupted."""
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    verb: Verb = tyro.cli(AnyVerb, prog="ltvn", description=DESCRIPTION, args=arguments)  # type: ignore[call-overload]
    try:
        report(verb)
    except LtvnError as error:
        print(f"ltvn: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("ltvn: interrupted", file=sys.stderr)
        return 130
    return 0


def report(verb: Verb) -> None:
    """Run the verb and print its summary, or write it as JSON where the user asked for that."""
    summary = verb.run()
    if verb.json is None:
        print(to_text(summary))
    elif verb.json == Path("-"):
        print(to_json(summary))
    else:
        _write_summary(verb.json, summary)


def _write_summary(path: Path, summary: Summary) -> None:
    """Write a summary; where the file cannot be written, print it, so that nothing of a long run is lost."""
    try:
        path.write_text(to_json(summary) + "\n")
    except OSError as error:
        print(to_json(summary))
        raise OptionError(f"{path}: the summary could not be written ({error}); it is printed instead.") from error


if __name__ == "__main__":
    sys.exit(main())
