"""`ltvn judge`: measures the accuracy of a predictor on a recording with true poses."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.data.recording.drive_part import WHOLE_DRIVE, DrivePart, parse_part
from ltvn_core.errors import OptionError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.verbs.option_types import AUTO, DeviceOption, PredictorName
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.data.recording.reader import Recording
    from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence
    from ltvn_core.evaluation.predictor_accuracy.judgement import Judgement
    from ltvn_core.evaluation.predictor_accuracy.map_accuracy import LocalisationAccuracy, MapAccuracy
    from ltvn_core.evaluation.predictor_accuracy.pair_accuracy import PairAccuracy
    from ltvn_core.predictors.choice import PredictorChoice
    from ltvn_core.types import Predictor


@dataclass(frozen=True, kw_only=True)
class JudgeSummary(WithDoubts):
    """Accuracy of a predictor; None for a figure that the recording has no true poses or no pairs for."""

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
    pairs: "PairAccuracy | None"
    """All figures of pairs."""
    map: "MapAccuracy"
    """All figures of the map."""
    localisation: "LocalisationAccuracy | None"
    """All figures of localisation."""
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
    findings: tuple[Finding, ...]
    """Warnings about these figures."""


@dataclass(frozen=True, kw_only=True)
class JudgeVerb(Verb):
    """Evaluate a predictor on a recording with true poses: on pairs of images, on a map, and on localisation in it."""

    recording: Positional[Path]
    """The recording; its images need true poses, which simulated and many imported recordings have."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; by default the better one for the recording's camera."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    device: DeviceOption = "auto"
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings, which decide when two images are joined."""
    against: Path | None = None
    """Another recording of the same place, with true poses in the same frame. The map is built from it, and the images
    of the first recording are localised in this map."""
    pairs: int = 20_000
    """Greatest number of far pairs to compare; the number of near pairs is an eighth of it."""
    images: int = 2000
    """Greatest number of images to read of a recording, evenly spaced."""
    part: str = "1/1"
    """Evaluate only on this part of the recording, for instance 2/2 for the second half; --against is used
    completely."""
    left_out: float = 0.2
    """Share of the images, evenly spaced, that are left out of the map and then localised in it."""
    without_truth: bool = False
    """Check only that the map is connected, which needs no true poses."""
    seed: int = 0
    """Seed of the pairs, the left-out images and the order of building."""

    def run(self) -> Summary:
        """Evaluate and summarise.

        Raises RecordingError, ImageError, MapError, WeightsError, DatasetError and OptionError.
        """
        from ltvn_core.data.recording.reader import Recording
        from ltvn_core.evaluation.predictor_accuracy.judgement import JudgementPlan, judge
        from ltvn_core.graph.ltvn import ltvn_system
        from ltvn_core.predictors.choice import ImageSource
        from ltvn_core.predictors.opening import open_method, open_predictor

        _check(self)
        plan = JudgementPlan(pairs=self.pairs, left_out=self.left_out, seed=self.seed)
        recording = Recording.open(self.recording)
        choice = ImageSource.of(recording.meta).choose_anew(self.predictor)
        meta = recording.meta
        predictor = open_predictor(choice.name, meta.scene, self.weights, camera=meta.camera, device=self.device)
        part = parse_part(self.part)
        looking = _read(self, recording, predictor, part)
        mapped = looking if self.against is None else _read(self, Recording.open(self.against), predictor, WHOLE_DRIVE)
        judgement = judge(
            looking,
            mapped,
            predictor=predictor,
            system=ltvn_system(open_method(self.preset, predictor)),
            plan=plan,
            bars=_bar,
        )
        return _summary(self, judgement, looking, mapped, choice=choice, fingerprint=predictor.fingerprint)


def _check(options: JudgeVerb) -> None:
    if not 0 < options.left_out < 1:
        raise OptionError(f"--left-out must lie between 0 and 1, got {options.left_out}.")
    if options.pairs < 1 or options.images < 2:
        raise OptionError(
            f"--pairs must be 1 or more and --images 2 or more, got {options.pairs} and {options.images}."
        )


def _read(options: JudgeVerb, recording: "Recording", predictor: "Predictor", part: DrivePart) -> "JudgedSequence":
    from ltvn_core.evaluation.predictor_accuracy.judged_sequence import read_sequence

    with _bar("read", min(len(part.take(recording.frames)), options.images), "image") as progress:
        return read_sequence(
            recording,
            predictor,
            most=options.images,
            with_truth=not options.without_truth,
            progress=progress,
            part=part,
        )


def _summary(
    options: JudgeVerb,
    judgement: "Judgement",
    looking: "JudgedSequence",
    mapped: "JudgedSequence",
    *,
    choice: "PredictorChoice",
    fingerprint: str,
) -> JudgeSummary:
    from ltvn_core.evaluation.predictor_accuracy.judgement import judgement_findings

    pairs = judgement.pairs
    found = judgement.map
    looks = judgement.localisation
    both = (looking,) if looking is mapped else (looking, mapped)
    return JudgeSummary(
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
        findings=judgement_findings(judgement, both, predictor_name=choice.name),
    )


@contextmanager
def _bar(step: str, total: int, unit: str) -> Iterator[Callable[[int], object]]:
    from tqdm import tqdm

    with tqdm(total=total, desc=step, unit=unit) as bar:
        yield bar.update
