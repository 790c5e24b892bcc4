"""`ltvn judge`: how good a predictor is on a recording whose true poses are known."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.errors import OptionError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.reports.docs_extra import require_docs_extra
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence
    from ltvn_core.evaluation.predictor_accuracy.judgement import Condition, Judgement
    from ltvn_core.evaluation.predictor_accuracy.localisation_accuracy import LocalisationAccuracy
    from ltvn_core.evaluation.predictor_accuracy.map_accuracy import MapAccuracy
    from ltvn_core.evaluation.predictor_accuracy.pair_accuracy import PairAccuracy
    from ltvn_core.evaluation.predictor_accuracy.revisits import RevisitAccuracy
    from ltvn_core.predictors.choice import PredictorChoice
    from ltvn_core.recording.drive_part import DrivePart
    from ltvn_core.recording.reader import Recording
    from ltvn_core.types import Predictor


@dataclass(frozen=True, kw_only=True)
class ConditionSummary:
    """The figures of one condition; None where they need truth, or pairs, that the recording does not have."""

    auc: float | None
    near_recall: float | None
    """Share of the near pairs that the method would join (moved < 0.6 m, turned < 20 degrees, target in front),"""
    far_fpr: float | None
    """and of the far pairs (moved > 1.5 m or turned > 60 degrees)."""
    waypoint_median_m: float | None
    """Error of the waypoints of near pairs that are joined."""
    waypoint_p90_m: float | None
    yaw_median_deg: float | None
    ece: float | None
    """Expected calibration error."""
    nodes: int
    """Of a map that is built from the images but those left out."""
    edges: int
    pieces: int
    largest_piece_share: float
    """Share of the images in the map's largest piece, or recognised as one of its nodes."""
    localised_share: float | None
    """Share of the images left out that are localised within 0.5 m and 20 degrees."""
    wrong_place_share: float | None
    """Share of them that are taken for a node that is far."""
    pairs: "PairAccuracy | None"
    """All figures of pairs,"""
    map: "MapAccuracy"
    """of the map,"""
    localisation: "LocalisationAccuracy | None"
    """and of localising."""


@dataclass(frozen=True, kw_only=True)
class JudgeSummary(ConditionSummary, WithDoubts):
    """What a predictor was judged to be worth."""

    recording: Path
    part: str
    """Of it, that was judged."""
    against: Path | None
    predictor: str
    predictor_reason: str
    """Why this one."""
    weights: Path | None
    """Those instead of the predictor's own."""
    fingerprint: str
    """Names the weights."""
    images: int
    """Images that were judged,"""
    without_truth: int
    """images without a true pose,"""
    without_depth: int
    """without the depth that the predictor needs,"""
    skipped: int
    """and those beyond --images."""
    revisits: "RevisitAccuracy | None"
    """Places recognised again, with --revisits."""
    perturbed: dict[str, ConditionSummary]
    """The same figures under each perturbation."""
    findings: tuple[Finding, ...]
    """What is doubtful of these figures."""
    report: Path | None


@dataclass(frozen=True, kw_only=True)
class JudgeVerb(Verb):
    """Judge a predictor on a recording with true poses: pairs of images, a map, finding one's place in it."""

    recording: Positional[Path]
    """The recording; its images need true poses, as simulated and imported recordings have them."""
    predictor: PredictorName = AUTO
    """What compares images; by default the better one for the recording's camera."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings, which say when two images are joined."""
    against: Path | None = None
    """Another recording of the same place, with true poses in the same frame: the map is built from that one, and the
    images of the first look for those of the second."""
    pairs: int = 20_000
    """Far pairs to compare at most, and an eighth as many near pairs."""
    images: int = 2000
    """Images to read of a recording at most, evenly spaced."""
    part: str = "1/1"
    """Judge by this stretch of the recording alone, for instance 2/2, the second half; --against is taken whole."""
    left_out: float = 0.2
    """Share of the images, evenly spaced, that the map is not built from, and that are then looked for in it."""
    perturb: str = ""
    """What to spoil of the images that look, one after the other: a list of blur, exposure, flare, depth-holes, lens,
    noise, white-balance, jpeg, dropped-frames, separated by commas; or all."""
    without_truth: bool = False
    """Judge only whether the map hangs together, which needs no true poses."""
    revisits: Path | None = None
    """A matrix of loop closures, a row and a column per image, as text or as a picture: measures how well places are
    recognised again. No true poses are needed then."""
    report: Path | None = None
    """A page (.html) to write, with pictures of the worst pairs."""
    worst: int = 12
    """Pairs of each kind to show on that page at most."""
    seed: int = 0
    """Draws pairs, the images left out, the order of building, and perturbations."""

    def run(self) -> Summary:
        """Judge and summarise; raises RecordingError, ImageError, MapError, WeightsError, DatasetError, OptionError."""
        from ltvn_core.evaluation.perturbations.perturbation_registry import parse_perturbations
        from ltvn_core.evaluation.predictor_accuracy.judgement import JudgementPlan, judge
        from ltvn_core.graph.ltvn import ltvn_system
        from ltvn_core.predictors.choice import ImageSource
        from ltvn_core.predictors.opening import open_method, open_predictor
        from ltvn_core.recording.drive_part import WHOLE_DRIVE, parse_part
        from ltvn_core.recording.reader import Recording

        self._check()
        if self.report is not None:
            require_docs_extra()
        plan = JudgementPlan(
            pairs=self.pairs,
            left_out=self.left_out,
            perturbations=parse_perturbations(self.perturb),
            seed=self.seed,
        )
        recording = Recording.open(self.recording)
        choice = ImageSource.of(recording.meta).choose_anew(self.predictor)
        predictor = open_predictor(choice.name, recording.meta.scene, self.weights, camera=recording.meta.camera)
        part = parse_part(self.part)
        looking = self._read(recording, predictor, part)
        mapped = looking if self.against is None else self._read(Recording.open(self.against), predictor, WHOLE_DRIVE)
        revisits = self._revisits(recording, looking, predictor)
        judgement = judge(
            looking,
            mapped,
            predictor=predictor,
            system=ltvn_system(open_method(self.preset, predictor)),
            plan=plan,
            bars=_bar,
        )
        if self.report is not None:
            self._write_report(judgement, looking, mapped, choice.name)
        return self._summary(
            judgement, looking, mapped, choice=choice, fingerprint=predictor.fingerprint, revisits=revisits
        )

    def _check(self) -> None:
        if not 0 < self.left_out < 1:
            raise OptionError(f"--left-out must lie between 0 and 1, got {self.left_out}.")
        if self.pairs < 1 or self.images < 2 or self.worst < 0:
            raise OptionError(
                "--pairs must be 1 or more, --images 2 or more and --worst 0 or more, got "
                f"{self.pairs}, {self.images} and {self.worst}."
            )
        if self.report is not None and self.report.suffix != ".html":
            raise OptionError(f"--report {self.report} must end in .html.")

    def _read(self, recording: "Recording", predictor: "Predictor", part: "DrivePart") -> "JudgedSequence":
        from ltvn_core.evaluation.predictor_accuracy.judged_sequence import read_sequence

        no_truth = self.without_truth or (self.revisits is not None and recording.poses.exact is None)
        with _bar("read", min(len(part.take(recording.frames)), self.images), "image") as progress:
            return read_sequence(
                recording, predictor, most=self.images, with_truth=not no_truth, progress=progress, part=part
            )

    def _revisits(
        self, recording: "Recording", looking: "JudgedSequence", predictor: "Predictor"
    ) -> "RevisitAccuracy | None":
        if self.revisits is None:
            return None
        from ltvn_core.evaluation.predictor_accuracy.judged_sequence import encode_sequence
        from ltvn_core.evaluation.predictor_accuracy.revisits import read_revisits, revisit_accuracy

        same_place = read_revisits(self.revisits, len(recording.frames))
        kept = [recording.frames.index(seen.step) for seen in looking.observations]
        with _bar("encode", len(kept), "image") as progress:
            features = encode_sequence(predictor, looking.observations, progress)
        with _bar("revisits", len(kept), "image") as progress:
            return revisit_accuracy(predictor, features, same_place[kept][:, kept], progress=progress)

    def _write_report(
        self, judgement: "Judgement", looking: "JudgedSequence", mapped: "JudgedSequence", predictor: str
    ) -> None:
        from ltvn_core.reports.judgement_page import render_judgement

        assert self.report is not None
        html = render_judgement(judgement, looking, mapped, predictor=predictor, most=self.worst)
        try:
            with atomic_replacement(self.report) as part:
                part.write_text(html, encoding="utf-8")
        except OSError as error:
            raise OptionError(f"{self.report} cannot be written ({error.strerror}); name another --report.") from error

    def _summary(
        self,
        judgement: "Judgement",
        looking: "JudgedSequence",
        mapped: "JudgedSequence",
        *,
        choice: "PredictorChoice",
        fingerprint: str,
        revisits: "RevisitAccuracy | None",
    ) -> JudgeSummary:
        from ltvn_core.evaluation.predictor_accuracy.judgement import judgement_findings

        recorded, *worse = judgement.conditions
        figures = _condition_summary(recorded)
        both = (looking,) if looking is mapped else (looking, mapped)
        return JudgeSummary(
            auc=figures.auc,
            near_recall=figures.near_recall,
            far_fpr=figures.far_fpr,
            waypoint_median_m=figures.waypoint_median_m,
            waypoint_p90_m=figures.waypoint_p90_m,
            yaw_median_deg=figures.yaw_median_deg,
            ece=figures.ece,
            nodes=figures.nodes,
            edges=figures.edges,
            pieces=figures.pieces,
            largest_piece_share=figures.largest_piece_share,
            localised_share=figures.localised_share,
            wrong_place_share=figures.wrong_place_share,
            pairs=figures.pairs,
            map=figures.map,
            localisation=figures.localisation,
            recording=self.recording,
            part=self.part,
            against=self.against,
            predictor=choice.name,
            predictor_reason=choice.reason,
            weights=self.weights,
            fingerprint=fingerprint,
            images=sum(len(each.observations) for each in both),
            without_truth=sum(each.without_truth for each in both),
            without_depth=sum(each.without_depth for each in both),
            skipped=sum(each.skipped for each in both),
            revisits=revisits,
            perturbed={condition.name: _condition_summary(condition) for condition in worse},
            findings=judgement_findings(judgement, both, predictor_name=choice.name),
            report=self.report,
        )


def _condition_summary(condition: "Condition") -> ConditionSummary:
    pairs, found, looks = condition.pairs, condition.map, condition.localisation
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
    from tqdm import tqdm

    with tqdm(total=total, desc=step, unit=unit) as bar:
        yield bar.update
