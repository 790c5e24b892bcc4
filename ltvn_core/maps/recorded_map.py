"""Builds a map from a recording: chooses the predictor, the system and the settings.

Owns nothing of the method; `topological_map` builds the map. The command line and the page share this module, so that
both make the same map.
"""

import logging
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import NamedTuple

from ltvn_core.data.recording.metadata import is_lens_known
from ltvn_core.data.recording.reader import Recording
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.joined_drives import join_drives
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.predictors.choice import AUTO, ImageSource, PredictorChoice
from ltvn_core.predictors.opening import open_method, open_predictor
from ltvn_core.predictors.remembered_answers import RememberedPredictor
from ltvn_core.predictors.request import predictor_card
from ltvn_core.robots.robot_spec import NeededSpace
from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_core.types import FrameId, Observation

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildOptions:
    """Options of a map."""

    preset: str = "robust"
    """Name of the method's settings."""
    system: str = DEFAULT_SYSTEM
    """Name of the navigation system that builds the map."""
    predictor: str = AUTO
    """Name of the predictor that compares images."""
    weights: Path | None = None
    """Path of weights to use instead of those that come with the system."""
    device: str = "cpu"
    """Where a network computes, see `open_predictor`."""
    goals: tuple[FrameId, ...] = ()
    """Images that must become nodes because they are goals."""
    seed: int = 0
    """Seed of the order in which images are sampled."""


class RecordedMap(NamedTuple):
    """A new map, with the recording, predictor and settings that made it."""

    map: TopologicalMap
    choice: PredictorChoice
    observations: list[Observation]
    """All images of the recordings, N of them."""


def build_recorded_map(
    paths: Path | str | Sequence[Path | str],
    options: BuildOptions,
    progress: ProgressCallback = lambda _done, _total: None,
    *,
    answers: Path | str | None = None,
) -> RecordedMap:
    """Build a map from the images of one recording, or of several drives of one place.

    `progress` is called with the number of images done and the number of all images. `answers` is a file in which the
    predictor's answers are kept until the map is built, so that an interrupted build can go on.

    Raises RecordingError, MapError, OptionError and WeightsError.
    """
    recordings = [Recording.open(path) for path in ([paths] if isinstance(paths, Path | str) else paths)]
    meta = recordings[0].meta
    choice = ImageSource.of(meta).choose_anew(options.predictor)
    joined = join_drives(recordings)
    for finding in joined.findings:
        log.warning(finding)
    entry = system_entry(options.system)
    weights = entry.weights_for(choice.name, options.weights)
    predictor = open_predictor(choice.name, meta.scene, weights, camera=meta.camera, device=options.device)
    named = choice.name, meta.scene
    with (
        nullcontext(predictor)
        if answers is None
        else RememberedPredictor(predictor, Path(answers), named=named) as asked
    ):
        built = build_map(
            joined.observations,
            predictor=asked,
            predictor_name=choice.name,
            system=entry.factory(open_method(options.preset, predictor)),
            scene=meta.scene,
            camera=meta.camera,
            is_lens_known=is_lens_known(meta),
            seed=options.seed,
            goals=options.goals,
            drives=joined.drives,
            space=_needed_space(recordings),
            progress=progress,
        )
    built = replace(built, findings=(*joined.findings, *built.findings), scene_glb=recordings[0].scene_glb())
    return RecordedMap(built, choice, joined.observations)


def _needed_space(recordings: Sequence[Recording]) -> NeededSpace | None:
    """Return the space in which the robots of all recordings fit; None if no robot is known."""
    known = [NeededSpace.recorded(recording.meta.config) for recording in recordings]
    if not any(known):
        return None
    spaces = [
        space or NeededSpace.assumed(recording.meta.camera) for space, recording in zip(known, recordings, strict=True)
    ]
    return reduce(NeededSpace.covering, spaces)


def save_recorded_map(built: TopologicalMap, output: Path | str, options: BuildOptions) -> None:
    """Write a map to a new file, with how it was built. Raises MapError and RecordingError."""
    device = predictor_card(built.predictor).device
    built.save(output, config={"verb": "build", "preset": options.preset, "seed": options.seed, "device": device})
