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

from benchmarks.bench import BenchVerb
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.verbs.baseline import BaselineVerb
from ltvn_core.verbs.build import BuildVerb
from ltvn_core.verbs.collect import CollectVerb
from ltvn_core.verbs.dataset import DatasetVerb
from ltvn_core.verbs.demo import DemoVerb
from ltvn_core.verbs.evaluate import EvaluateVerb
from ltvn_core.verbs.export import ExportVerb
from ltvn_core.verbs.figures import FiguresVerb
from ltvn_core.verbs.finetune import FinetuneVerb
from ltvn_core.verbs.lifelong import LifelongVerb
from ltvn_core.verbs.measure import MeasureVerb
from ltvn_core.verbs.navigate import NavigateVerb
from ltvn_core.verbs.plant import PlantVerb
from ltvn_core.verbs.recording_files import InfoVerb, RepairVerb, VerifyVerb
from ltvn_core.verbs.report import ReportVerb
from ltvn_core.verbs.train import TrainVerb
from ltvn_core.verbs.verb import Summary, Verb, to_json, to_text
from ltvn_core.verbs.view import ViewVerb
from ltvn_viz.verbs.app import AppVerb, ReplayVerb
from ltvn_viz.verbs.pairs import PairsVerb

AnyVerb: TypeAlias = (
    Annotated[AppVerb, subcommand("app", prefix_name=False)]
    | Annotated[DemoVerb, subcommand("demo", prefix_name=False)]
    | Annotated[CollectVerb, subcommand("collect", prefix_name=False)]
    | Annotated[BuildVerb, subcommand("build", prefix_name=False)]
    | Annotated[NavigateVerb, subcommand("navigate", prefix_name=False)]
    | Annotated[PlantVerb, subcommand("plant", prefix_name=False)]
    | Annotated[EvaluateVerb, subcommand("evaluate", prefix_name=False)]
    | Annotated[LifelongVerb, subcommand("lifelong", prefix_name=False)]
    | Annotated[ReplayVerb, subcommand("replay", prefix_name=False)]
    | Annotated[ViewVerb, subcommand("view", prefix_name=False)]
    | Annotated[DatasetVerb, subcommand("dataset", prefix_name=False)]
    | Annotated[PairsVerb, subcommand("pairs", prefix_name=False)]
    | Annotated[TrainVerb, subcommand("train", prefix_name=False)]
    | Annotated[FinetuneVerb, subcommand("finetune", prefix_name=False)]
    | Annotated[BaselineVerb, subcommand("baseline", prefix_name=False)]
    | Annotated[MeasureVerb, subcommand("measure", prefix_name=False)]
    | Annotated[FiguresVerb, subcommand("figures", prefix_name=False)]
    | Annotated[ReportVerb, subcommand("report", prefix_name=False)]
    | Annotated[InfoVerb, subcommand("info", prefix_name=False)]
    | Annotated[VerifyVerb, subcommand("verify", prefix_name=False)]
    | Annotated[RepairVerb, subcommand("repair", prefix_name=False)]
    | Annotated[ExportVerb, subcommand("export", prefix_name=False)]
    | Annotated[BenchVerb, subcommand("bench", prefix_name=False)]
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
