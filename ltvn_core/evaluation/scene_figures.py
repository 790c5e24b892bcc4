"""What a measurement in one scene keeps: plain columns, in a file, so that scenes can be measured apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.edge_driver import MeasuredAttempt
from ltvn_core.evaluation.predicted_drive import PredictedDrive
from ltvn_core.geometry import distance

Columns = NDArray[Any]
"""(N,) rows of named columns."""
_ERRORS = np.dtype([("position_m", "f8"), ("d", "f8"), ("straight_m", "f8"), ("overlap", "f8"), ("is_edge", "?")])
_PAIRS = np.dtype([("reachability", "f8"), ("is_reachable", "?")])
_ATTEMPTS = np.dtype([("true", "?"), ("connected", "?"), ("succeeded", "?"), ("arrived", "?")])


@dataclass(frozen=True, slots=True, eq=False)
class SceneFigures:
    """The figures of one scene."""

    scene: str
    images: int
    errors: Columns
    """Of each reachable pair: of its position, of d, its straight distance and overlap, and whether it is an edge."""
    pairs: Columns
    """Of each ordered pair: r, and the truth."""
    attempts: Columns
    """Of each edge that was driven: whether it is true and joined, and whether the robot said and did arrive."""
    not_begun: int

    def save(self, path: Path) -> None:
        """Write a file, whole or not at all. Raises OSError."""
        with atomic_replacement(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file,
                scene=self.scene,
                images=self.images,
                errors=self.errors,
                pairs=self.pairs,
                attempts=self.attempts,
                not_begun=self.not_begun,
            )

    @classmethod
    def load(cls, path: Path) -> "SceneFigures":
        """Read what `save` wrote. Raises OptionError for any other file."""
        try:
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                return cls(
                    scene=str(file["scene"]),
                    images=int(file["images"]),
                    errors=file["errors"],
                    pairs=file["pairs"],
                    attempts=file["attempts"],
                    not_begun=int(file["not_begun"]),
                )
        except (OSError, ValueError, KeyError, BadZipFile) as error:
            raise OptionError(f"{path} holds no measurement of a scene: {error}") from error


def scene_figures(
    drive: PredictedDrive, edges: NDArray[np.bool_], attempted: Sequence[MeasuredAttempt], *, not_begun: int
) -> SceneFigures:
    """Return the figures of a drive, of its edges (N, N) and of those that were driven."""
    true, predicted = (waypoints[drive.reachable] for waypoints in (drive.waypoints, drive.predicted.waypoints))
    errors = np.empty(len(true), _ERRORS)
    errors["position_m"] = np.hypot(*(predicted - true)[:, :2].T)
    errors["d"] = distance(predicted) - distance(true)
    errors["straight_m"] = np.hypot(true[:, 0], true[:, 1])
    errors["overlap"] = drive.overlap[drive.reachable]
    errors["is_edge"] = edges[drive.reachable]
    apart = ~np.eye(len(drive.poses), dtype=bool)
    pairs = np.empty(int(apart.sum()), _PAIRS)
    pairs["reachability"] = drive.predicted.reachability[apart]
    pairs["is_reachable"] = drive.reachable[apart]
    rows = [(each.edge.true, each.edge.connected, each.succeeded, each.arrived) for each in attempted]
    return SceneFigures(
        scene=drive.scene.name,
        images=len(drive.poses),
        errors=errors,
        pairs=pairs,
        attempts=np.array(rows, _ATTEMPTS),
        not_begun=not_begun,
    )
