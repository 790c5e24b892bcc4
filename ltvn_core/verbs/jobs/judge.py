"""`ltvn judge`: measures the accuracy of a predictor on a recording with true poses."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.data.recording.drive_part import WHOLE_DRIVE, DrivePart, parse_part
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.perturbations import chosen_perturbations
from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence, encode_sequence, read_sequence
from ltvn_core.evaluation.predictor_accuracy.judgement import (
    Condition,
    Judgement,
    JudgementPlan,
    judge,
    judgement_findings,
)
from ltvn_core.evaluation.predictor_accuracy.map_accuracy import LocalisationAccuracy, MapAccuracy
from ltvn_core.evaluation.predictor_accuracy.pair_accuracy import PairAccuracy
from ltvn_core.evaluation.predictor_accuracy.revisits import RevisitAccuracy, read_revisits, revisit_accuracy
from ltvn_core.extras import require_libraries
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.predictors.choice import ImageSource, PredictorChoice
from ltvn_core.predictors.opening import open_method, open_predictor
from ltvn_core.types import Predictor
from ltvn_core.verbs.judge import JudgeVerb
from ltvn_core.verbs.verb import Summary


@dataclass(frozen=True, kw_only=True)
class ConditionSummary:
    """The figures under one condition; None for a figure that the recording has no true poses or no pairs for."""

    auc: float | None
    near_recall: float | None
    """Share of the near pairs that the method would join; near is moved < 0.6 m, turned < 20 degrees, and target in
    front."""
    far_fpr: float | None
    """Share of the far pairs that the method would join; far is moved > 1.5 m or turned > 60 degrees."""
    waypoint_median_m: float | None
    """Median position error of the waypoints of joined near pairs, in metres."""
    waypoint_p90_m: float | None
    yaw_median_deg: float | None
    ece: float | None
    """Expected calibration error."""
    nodes: int
    """Number of nodes of the map, which is built without the left-out images."""
    edges: int
    pieces: int
    largest_piece_share: float
    """Share of the images that are in the map's largest piece, or recognised as one of its nodes."""
    localised_share: float | None
    """Share of the left-out images that are localised within 0.5 m and 20 degrees."""
    wrong_place_share: float | None
    """Share of the left-out images that are localised at a far node."""
    pairs: PairAccuracy | None
    """All figures of pairs."""
    map: MapAccuracy
    """All figures of the map."""
    localisation: LocalisationAccuracy | None
    """All figures of localisation."""


@dataclass(frozen=True, kw_only=True)
class JudgeSummary(ConditionSummary, WithDoubts):
    """Accuracy of a predictor."""

    recording: Path
    part: str
    """Part of the recording that was judged."""
    against: Path | None
    predictor: str
    predictor_reason: str
    """Reason for the choice of the predictor."""
    weights: Path | None
    """Weights that were used instead of the predictor's own; None for its own."""
    fingerprint: str
    """Fingerprint of the weights."""
    images: int
    """Number of evaluated images."""
    without_truth: int
    """Number of images left out because they have no true pose."""
    without_depth: int
    """Number of images left out because they have no depth and the predictor needs it."""
    skipped: int
    """Number of images left out because there are more than --images."""
    revisits: RevisitAccuracy | None
    """Accuracy of recognising places again, with --revisits; None without it."""
    perturbed: dict[str, ConditionSummary]
    """The same figures under each perturbation."""
    findings: tuple[Finding, ...]
    """Warnings about these figures."""
    report: Path | None


def judge_predictor(options: JudgeVerb) -> Summary:
    """Evaluate and summarise; raises RecordingError, ImageError, MapError, WeightsError, DatasetError, OptionError."""
    _check(options)
    if options.report is not None:
        require_libraries("matplotlib", "jinja2")
    plan = JudgementPlan(
        pairs=options.pairs,
        left_out=options.left_out,
        perturbations=chosen_perturbations(options.perturb),
        seed=options.seed,
    )
    recording = Recording.open(options.recording)
    choice = ImageSource.of(recording.meta).choose_anew(options.predictor)
    predictor = open_predictor(choice.name, recording.meta.scene, options.weights, camera=recording.meta.camera)
    part = parse_part(options.part)
    looking = _read(options, recording, predictor, part)
    mapped = (
        looking if options.against is None else _read(options, Recording.open(options.against), predictor, WHOLE_DRIVE)
    )
    revisits = _revisits(options, recording, looking, predictor)
    judgement = judge(
        looking,
        mapped,
        predictor=predictor,
        system=ltvn_system(open_method(options.preset, predictor)),
        plan=plan,
        bars=_bar,
    )
    if options.report is not None:
        _write_report(options, judgement, looking, mapped, choice.name)
    return _summary(
        options, judgement, looking, mapped, choice=choice, fingerprint=predictor.fingerprint, revisits=revisits
    )


def _check(options: JudgeVerb) -> None:
    if not 0 < options.left_out < 1:
        raise OptionError(f"--left-out must lie between 0 and 1, got {options.left_out}.")
    if options.pairs < 1 or options.images < 2 or options.worst < 0:
        raise OptionError(
            "--pairs must be 1 or more, --images 2 or more and --worst 0 or more, got "
            f"{options.pairs}, {options.images} and {options.worst}."
        )
    if options.report is not None and options.report.suffix != ".html":
        raise OptionError(f"--report {options.report} must end in .html.")


def _read(options: JudgeVerb, recording: Recording, predictor: Predictor, part: DrivePart) -> JudgedSequence:
    no_truth = options.without_truth or (options.revisits is not None and recording.poses.exact is None)
    with _bar("read", min(len(part.take(recording.frames)), options.images), "image") as progress:
        return read_sequence(
            recording, predictor, most=options.images, with_truth=not no_truth, progress=progress, part=part
        )


def _revisits(
    options: JudgeVerb, recording: Recording, looking: JudgedSequence, predictor: Predictor
) -> RevisitAccuracy | None:
    if options.revisits is None:
        return None
    same_place = read_revisits(options.revisits, len(recording.frames))
    kept = [recording.frames.index(seen.step) for seen in looking.observations]
    with _bar("encode", len(kept), "image") as progress:
        features = encode_sequence(predictor, looking.observations, progress)
    with _bar("revisits", len(kept), "image") as progress:
        return revisit_accuracy(predictor, features, same_place[kept][:, kept], progress=progress)


def _write_report(
    options: JudgeVerb, judgement: Judgement, looking: JudgedSequence, mapped: JudgedSequence, predictor: str
) -> None:
    from ltvn_core.evaluation.reports.judgement_page import render_judgement  # Needs an extra of its own.

    assert options.report is not None
    html = render_judgement(judgement, looking, mapped, predictor=predictor, most=options.worst)
    try:
        with atomic_replacement(options.report) as part:
            part.write_text(html, encoding="utf-8")
    except OSError as error:
        raise OptionError(f"{options.report} cannot be written ({error.strerror}); name another --report.") from error


def _summary(
    options: JudgeVerb,
    judgement: Judgement,
    looking: JudgedSequence,
    mapped: JudgedSequence,
    *,
    choice: PredictorChoice,
    fingerprint: str,
    revisits: RevisitAccuracy | None,
) -> JudgeSummary:
    recorded, *worse = judgement.conditions
    both = (looking,) if looking is mapped else (looking, mapped)
    return JudgeSummary(
        **vars(_condition_summary(recorded)),
        recording=options.recording,
        part=options.part,
        against=options.against,
        predictor=choice.name,
        predictor_reason=choice.reason,
        weights=options.weights,
        fingerprint=fingerprint,
        images=sum(len(each.observations) for each in both),
        without_truth=sum(each.without_truth for each in both),
        without_depth=sum(each.without_depth for each in both),
        skipped=sum(each.skipped for each in both),
        revisits=revisits,
        perturbed={condition.name: _condition_summary(condition) for condition in worse},
        findings=judgement_findings(judgement, both, predictor_name=choice.name),
        report=options.report,
    )


def _condition_summary(condition: Condition) -> ConditionSummary:
    pairs = condition.pairs
    found = condition.map
    looks = condition.localisation
    return ConditionSummary(
        auc=pairs and pairs.auc,
        near_recall=pairs and pairs.near_recall,
        far_fpr=pairs and pairs.far_fpr,
        waypoint_median_m=pairs and pairs.waypoint_median_m,
        waypoint_p90_m=pairs and pairs.waypoint_p90_m,
        yaw_median_deg=pairs and pairs.yaw_median_deg,
        ece=pairs and pairs.ece,
        nodes=found.nodes,
        edges=found.edges,
        pieces=found.pieces,
        largest_piece_share=found.largest_piece_share,
        localised_share=looks and looks.localised_share,
        wrong_place_share=looks and looks.wrong_place_share,
        pairs=pairs,
        map=found,
        localisation=looks,
    )


@contextmanager
def _bar(step: str, total: int, unit: str) -> Iterator[Callable[[int], object]]:
    with tqdm(total=total, desc=step, unit=unit) as bar:
        yield bar.update
