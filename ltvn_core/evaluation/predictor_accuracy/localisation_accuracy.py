"""Images that a map was not built from: are they localised, how well, and how often in a wrong place, by true poses."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.predictor_accuracy.map_accuracy import JudgedMap
from ltvn_core.geometry import compose, distance, invert, relative
from ltvn_core.graph.localiser import NO_PRIOR
from ltvn_core.network.metrics.binned_metrics import or_none
from ltvn_core.network.metrics.reachability_metrics import quantile
from ltvn_core.training_data.truth_limits import LIMITS, TrueViews
from ltvn_core.types import Features, Pose

LOCALISED_M = 0.5
LOCALISED_RAD = float(np.deg2rad(20))
"""An image is localised where the map says so within these of its true pose."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalisationAccuracy:
    """How images are found in a map. The four shares add up to 1; None without images."""

    looks: int
    """Images that were looked for,"""
    looks_elsewhere: int
    """and those that were not, because the map has no image within D_l of them."""
    localised_share: float | None
    """Within 0.5 m and 20 degrees of the truth."""
    wrong_place_share: float | None
    """Taken for a node that is truly far away."""
    inaccurate_share: float | None
    """Taken for a node that is not far, but not within 0.5 m and 20 degrees."""
    lost_share: float | None
    """Taken for no node."""
    position_median_m: float | None
    """Error of those that are localised."""
    position_p90_m: float | None
    yaw_median_deg: float | None


@dataclass(frozen=True, slots=True)
class _Look:
    pose: Pose | None
    """(3,) as the map says; None where it does not know."""
    is_far: bool
    """The node that it is taken for is truly far."""


def localisation_accuracy(
    built: JudgedMap, features: Features, views: TrueViews, *, progress: Callable[[int], object]
) -> LocalisationAccuracy:
    """Look for L images with features (L, F) in a map.

    The position that the map gives is its node's true pose and the predicted waypoint from there, so that only the
    predictor's errors count and not those of odometry.

    Args:
        built: A map with true views.
        features: Of the images.
        views: Where they were truly taken.
        progress: Called with the number of further images that are done.
    """
    assert built.views is not None
    reach = built.map.system.method.localising.distance
    can: NDArray[np.bool_] = np.any(distance(views.moves_to(built.views)) < reach, axis=1)
    looks = []
    for row in range(len(views)):
        if can[row]:
            looks.append(_look(built, features[row : row + 1], views.take([row])))
        progress(1)
    return _summary(looks, views.take(np.flatnonzero(can)), elsewhere=int((~can).sum()))


def _look(built: JudgedMap, features: Features, view: TrueViews) -> _Look:
    assert built.views is not None
    found = built.map.system.localise(features, built.map.graph, NO_PRIOR, built.matcher)
    if found.node is None:
        return _Look(pose=None, is_far=False)
    row = built.row_of[found.node]
    is_far = bool(LIMITS.far(view.moves_to(built.views.take([row])))[0, 0])
    return _Look(pose=compose(built.views.poses[row], invert(found.waypoint)), is_far=is_far)


def _summary(looks: list[_Look], views: TrueViews, *, elsewhere: int) -> LocalisationAccuracy:
    lost = np.array([look.pose is None for look in looks], bool)
    nowhere = np.full(3, np.nan)
    claimed = np.array([nowhere if look.pose is None else look.pose for look in looks])
    errors = relative(views.poses, claimed.reshape(-1, 3))
    off_m, off_rad = np.hypot(*errors[:, :2].T), np.abs(errors[:, 2])
    wrong = np.array([look.is_far for look in looks], bool)
    right = ~lost & ~wrong & (off_m < LOCALISED_M) & (off_rad < LOCALISED_RAD)
    return LocalisationAccuracy(
        looks=len(looks),
        looks_elsewhere=elsewhere,
        localised_share=_share(right),
        wrong_place_share=_share(wrong),
        inaccurate_share=_share(~lost & ~wrong & ~right),
        lost_share=_share(lost),
        position_median_m=or_none(quantile(off_m[right], 0.5)),
        position_p90_m=or_none(quantile(off_m[right], 0.9)),
        yaw_median_deg=or_none(float(np.degrees(quantile(off_rad[right], 0.5)))),
    )


def _share(chosen: NDArray[np.bool_]) -> float | None:
    return float(chosen.mean()) if len(chosen) else None
