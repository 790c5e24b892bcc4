"""The worst pairs of a judgement as one self-contained HTML page: both images, the ground truth and the prediction.

Owns the selection of pairs and the contents of a row. The layout is in `templates/`.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence
from ltvn_core.evaluation.predictor_accuracy.judgement import Judgement
from ltvn_core.evaluation.predictor_accuracy.pair_accuracy import PairScores
from ltvn_core.evaluation.reports.evaluation_tables import ReportTable
from ltvn_core.evaluation.reports.failure_gallery import data_url
from ltvn_core.types import Rgb, Waypoint

_JPEG_QUALITY = 85


@dataclass(frozen=True, slots=True, kw_only=True)
class PairImage:
    """One image of a pair."""

    picture: str
    """The image as a data URL."""
    frame: int
    command: str
    """Command that opens the recording at this image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairRow:
    """A pair in the gallery."""

    source: PairImage
    target: PairImage
    true_place: str
    claimed_place: str
    reachability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PairGroup:
    """The worst pairs of one kind."""

    title: str
    found: int
    """Number of pairs of this kind among the compared ones."""
    compared: int
    rows: tuple[PairRow, ...]


def render_judgement(
    judgement: Judgement,
    looking: JudgedSequence,
    mapped: JudgedSequence,
    *,
    predictor: str,
    most: int,
) -> str:
    """Return the page as HTML, with a limited number of pairs of each kind."""
    world = Environment(
        loader=PackageLoader("ltvn_core.evaluation.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    groups = () if judgement.scores is None else _groups(judgement.scores, looking, mapped, most)
    return world.get_template("judgement.html").render(
        predictor=predictor,
        recording=looking.path.name,
        against="" if looking is mapped else mapped.path.name,
        table=condition_table(judgement),
        groups=groups,
    )


def condition_table(judgement: Judgement) -> ReportTable:
    """Return the main figures, one row for each condition."""
    head = ("camera", "AUC", "near accepted", "far accepted", "waypoint", "nodes", "pieces", "largest piece")
    rows = []
    for condition in judgement.conditions:
        pairs = condition.pairs
        found = condition.map
        looks = condition.localisation
        rows.append(
            (
                condition.name or "as recorded",
                _number(pairs and pairs.auc, "{:.3f}"),
                _number(pairs and pairs.near_recall, "{:.1%}"),
                _number(pairs and pairs.far_fpr, "{:.2%}"),
                _number(pairs and pairs.waypoint_median_m, "{:.3f} m"),
                str(found.nodes),
                str(found.pieces),
                _number(found.largest_piece_share, "{:.1%}"),
                _number(looks and looks.localised_share, "{:.1%}"),
                _number(looks and looks.wrong_place_share, "{:.1%}"),
            )
        )
    caption = (
        "Near: moved less than 0.6 m, turned less than 20°, target in front; far: moved more than 1.5 m or turned more "
        "than 60°. Localised: within 0.5 m and 20° of the truth."
    )
    return ReportTable(head=(*head, "localised", "wrong place"), rows=tuple(rows), caption=caption, words=1)


def _number(value: float | None, pattern: str) -> str:
    return "–" if value is None else pattern.format(value)


def _groups(scores: PairScores, looking: JudgedSequence, mapped: JudgedSequence, most: int) -> tuple[PairGroup, ...]:
    near = scores.sample.is_near
    kinds = (
        ("Far, and accepted", ~near & scores.accepted, ~near, -scores.score),
        ("Near, and refused", near & ~scores.accepted, near, scores.score),
        ("Near and accepted, with the largest errors", near & scores.accepted, near, -scores.position_error_m),
    )
    return tuple(
        PairGroup(
            title=title,
            found=int(chosen.sum()),
            compared=int(kind.sum()),
            rows=tuple(
                _row(scores, pair, looking, mapped) for pair in _worst(scores, np.flatnonzero(chosen), badness, most)
            ),
        )
        for title, chosen, kind, badness in kinds
    )


def _worst(scores: PairScores, pairs: NDArray[np.intp], order: NDArray[np.float64], most: int) -> Sequence[int]:
    """Return the pairs with the lowest `order` (P,).

    Each image is used at most once, so that the pairs show different places.
    """
    shown: set[int] = set()
    found: list[int] = []
    for pair in pairs[np.argsort(order[pairs], kind="stable")]:
        ends = {int(scores.sample.sources[pair]), int(scores.sample.targets[pair])}
        if len(found) < most and not ends & shown:
            shown |= ends
            found.append(int(pair))
    return found


def _row(scores: PairScores, pair: int, looking: JudgedSequence, mapped: JudgedSequence) -> PairRow:
    return PairRow(
        source=_image(looking, int(scores.sample.sources[pair])),
        target=_image(mapped, int(scores.sample.targets[pair])),
        true_place=_place(scores.sample.waypoints[pair]),
        claimed_place=_place(scores.waypoints[pair]) if scores.waypoints[pair].any() else "none",
        reachability=float(scores.reachability[pair]),
    )


def _image(sequence: JudgedSequence, row: int) -> PairImage:
    seen = sequence.observations[row]
    return PairImage(
        picture=_picture(seen.rgb),
        frame=seen.step,
        command=f"ltvn replay {shlex.quote(str(sequence.path))} --at {sequence.time_s(row):.1f}",
    )


def _picture(rgb: Rgb) -> str:
    _, jpeg = cv2.imencode(".jpg", rgb[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY))
    return data_url(jpeg.tobytes())


def _place(waypoint: Waypoint) -> str:
    dx, dy, turn = waypoint
    return f"{dx:+.2f} m ahead, {dy:+.2f} m left, {np.degrees(turn):+.0f}°"
