"""Finds the results of an evaluation in a folder, and the images and recordings of its failed episodes.

Finds and checks the files, and finds the moment of a failure in the recording of an episode. Computes no metrics;
drives and recordings are only read.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.evaluation.reports.failure_gallery import FailureRow
from ltvn_core.evaluation.reports.result_rows import setup_of
from ltvn_core.evaluation.results import (
    EvaluationResults,
    LifelongResult,
    TrialResult,
    WorldResult,
    drawing_path,
    load_drawing,
    load_results,
    stored_results,
)
from ltvn_core.evaluation.trial_plans import TrialFiles
from ltvn_core.graph.deltas import Cause
from ltvn_core.navigation.events import AttemptEnded, Collided, GraphChanged, QueryEnded, StampedEvent
from ltvn_core.types import FrameId

BEFORE_S = 3.0
"""Time from the start of playback to the failure, in seconds."""
TRIALS = "*.trial.json"
LIFELONG = "*.lifelong.json"
WORLDS = "*.world.json"
_Result = TypeVar("_Result", TrialResult, LifelongResult)


def moment_s(recording: Path, failure: FailureCause | None) -> float | None:
    """Return the start of playback, in seconds after the recording's beginning; None if the recording is unreadable.

    Playback starts shortly before one of three events: the last collision, if the robot collided too often; the last
    failed attempt, for spurious edges, wrong localisations and the step limit; the end of the query in all other cases.
    """
    try:
        opened = Recording.open(recording)
        events = opened.events
    except LtvnError:
        return None
    stamps = [stamped.stamp for stamped in events if _tells(stamped, failure)]
    ends = [stamped.stamp for stamped in events if isinstance(stamped.event, QueryEnded)]
    if not stamps and not ends:
        return None
    return max(0.0, (stamps or ends)[-1] - _beginning_s(opened, events) - BEFORE_S)


def _tells(stamped: StampedEvent, failure: FailureCause | None) -> bool:
    if failure is FailureCause.COLLISION:
        return isinstance(stamped.event, Collided)
    if failure in (FailureCause.SPURIOUS_EDGE, FailureCause.MISLOCALISED, FailureCause.STEP_LIMIT):
        return isinstance(stamped.event, AttemptEnded) and not stamped.event.succeeded
    return False


def _beginning_s(recording: Recording, events: list[StampedEvent]) -> float:
    """Return the stamp of the first image of the drive; images of a loaded map are older."""
    first = events[0]
    poses = recording.poses
    loaded = isinstance(first.event, GraphChanged) and first.event.delta.cause is Cause.LOAD
    stamps = poses.stamps[poses.steps > first.step] if loaded else poses.stamps
    return float(np.min(stamps, initial=np.inf)) if len(stamps) else first.stamp


@dataclass(frozen=True)
class FoundResults:
    """The results in a folder."""

    results: EvaluationResults
    """The results as stored in the files."""
    drawn: EvaluationResults
    """The same results with the drawings of their maps, read from the files beside them."""
    failures: tuple[FailureRow, ...]
    """All failed episodes of the trials, with their recordings, still without images."""
    worlds: tuple[WorldResult, ...] = ()
    """Queries in worlds that change."""


def find_results(folder: Path) -> FoundResults:
    """Read all results below a folder. Raises OptionError for an empty folder, a damaged file, or two results of one
    trial."""
    if not folder.is_dir():
        raise OptionError(f"{folder} is no folder; name the one that `ltvn evaluate --folder` wrote to.")
    trials = _longest((path, _trial(path)) for path in stored_results(folder, TRIALS))
    lifelong = _longest((path, _lifelong(path)) for path in stored_results(folder, LIFELONG))
    worlds = tuple(_world(path) for path in stored_results(folder, WORLDS))
    if not trials and not lifelong and not worlds:
        raise OptionError(f"{folder} holds no {TRIALS}, {LIFELONG} or {WORLDS}; make some with `ltvn evaluate`.")
    return FoundResults(
        results=EvaluationResults(tuple(trials.values()), tuple(lifelong.values())),
        drawn=EvaluationResults(
            tuple(_drawn_trial(path, trial) for path, trial in trials.items()),
            tuple(_drawn_lifelong(path, result) for path, result in lifelong.items()),
        ),
        failures=tuple(row for path, trial in trials.items() for row in _failures(path, trial)),
        worlds=worlds,
    )


def with_images(rows: Iterable[FailureRow]) -> tuple[FailureRow, ...]:
    """Add start and goal images to rows whose drive exists, and the moment of failure to rows with a recording.

    Unreadable files are skipped, because a report is useful without images.
    """
    return tuple(_illustrated(row) for row in rows)


def _trial(path: Path) -> TrialResult:
    trial = load_results(path, TrialResult)
    if not trial.episodes:
        raise OptionError(f"{path} holds no episode; evaluate it again.")
    if (plan := trial.floorplan) is not None:
        known = {node for node, *_ in plan.nodes}
        if not known.issuperset(node for edge in plan.edges for node in edge[:2]):
            raise OptionError(f"{path} has edges between nodes that it does not know; evaluate it again.")
        if len({len(row) for row in plan.free}) > 1:
            raise OptionError(f"{path} has a floor plan with rows of different lengths; evaluate it again.")
    return trial


def _lifelong(path: Path) -> LifelongResult:
    result = load_results(path, LifelongResult)
    if not result.points or not all(point.trial.episodes for point in result.points):
        raise OptionError(f"{path} has no test, or one without episodes; run `ltvn lifelong` again.")
    return result


def _world(path: Path) -> WorldResult:
    result = load_results(path, WorldResult)
    if not result.queries:
        raise OptionError(f"{path} holds no query; run `ltvn lifelong --world` again.")
    return result


def _drawn_trial(path: Path, trial: TrialResult) -> TrialResult:
    folder, label = _plan(path)
    drawing = drawing_path(folder, label, trial.queries)
    if trial.floorplan is not None or not drawing.exists():
        return trial
    return replace(trial, floorplan=load_drawing(drawing))


def _drawn_lifelong(path: Path, result: LifelongResult) -> LifelongResult:
    points = tuple(replace(point, trial=_drawn_trial(path, point.trial)) for point in result.points)
    return replace(result, points=points)


def _longest(found: Iterable[tuple[Path, _Result]]) -> dict[Path, _Result]:
    """Keep the longest of several results of one plan; the shorter results contain its first episodes."""
    kept: dict[object, tuple[Path, _Result]] = {}
    for path, result in found:
        before, other = kept.get(key := _key(result), (path, result))
        if _plan(before) != _plan(path):
            raise OptionError(f"{before} and {path} are results of the same trial; move one of them away.")
        kept[key] = (path, result) if _length(result) >= _length(other) else (before, other)
    return dict(kept.values())


def _plan(path: Path) -> tuple[Path, str]:
    """Return folder and label of a result; its file name ends with its length."""
    return path.parent, re.sub(r"(-(\d+|every))*\.(trial|lifelong)\.json(\.gz)?$", "", path.name)


def _key(result: TrialResult | LifelongResult) -> object:
    trial = result.points[0].trial if isinstance(result, LifelongResult) else result
    return setup_of(trial), trial.seed


def _length(result: TrialResult | LifelongResult) -> tuple[int, int]:
    if isinstance(result, LifelongResult):
        return len(result.queries), len(result.points[0].trial.episodes)
    return len(result.episodes), 0


def _failures(path: Path, trial: TrialResult) -> Iterator[FailureRow]:
    folder, label = _plan(path)
    files = TrialFiles(folder, label)
    for episode in trial.episodes:
        if not episode.reached:
            recording = files.failure(episode.query)
            yield FailureRow(
                trial=trial, episode=episode, drive=files.drive, recording=recording if recording.exists() else None
            )


def _illustrated(row: FailureRow) -> FailureRow:
    start, goal = (_stored_image(row.drive, frame) for frame in (row.episode.start, row.episode.goal))
    at = None if row.recording is None else moment_s(row.recording, row.episode.failure)
    return replace(
        row, start=row.start or start, goal=row.goal or goal, time_s=at if row.time_s is None else row.time_s
    )


def _stored_image(drive: Path | None, frame: FrameId | None) -> bytes | None:
    """Return an image of a drive as it is stored."""
    recording = None if drive is None else _opened(drive)
    if recording is None or frame is None or frame not in recording.frames:
        return None
    return recording.stored_frame(frame).frame.rgb


@lru_cache(maxsize=2)
def _opened(drive: Path) -> Recording | None:
    """Return a drive; None if it is missing or damaged. Cached, because rows of one drive follow each other."""
    try:
        return Recording.open(drive)
    except LtvnError:
        return None
