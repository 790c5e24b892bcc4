"""Finds the results of an evaluation in a folder, and the images and recordings of its failed episodes.

Finds and checks the files, and finds the moment of a failure in the recording of an episode. Computes no metrics;
drives and recordings are only read.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.evaluation.map_drawing import load_drawing
from ltvn_core.evaluation.plans import refuse_older_results
from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.evaluation.reports.failure_gallery import FailureRow
from ltvn_core.evaluation.results import ROWS, Run, drawing_path, failure_path, read_runs, rows_in
from ltvn_core.graph.deltas import Cause
from ltvn_core.navigation.events import AttemptEnded, Collided, GraphChanged, QueryEnded, StampedEvent
from ltvn_core.types import FrameId

BEFORE_S = 3.0
"""Time from the start of playback to the failure, in seconds."""


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


def find_results(folder: Path) -> tuple[Run, ...]:
    """Read all results below a folder, with the drawings of their maps.

    Raises OptionError for an empty folder, a damaged file, results of older versions, or two folders with one run.
    """
    if not folder.is_dir():
        raise OptionError(f"{folder} is no folder; name the one that `ltvn evaluate --folder` wrote to.")
    refuse_older_results(folder, (f"**/*.{kind}.json*" for kind in ("trial", "lifelong", "world")))
    runs = tuple(drawn for run in read_runs(rows_in(folder)) if (drawn := _drawn(run)).maps)
    if not runs:
        raise OptionError(f"{folder} holds no results ({ROWS}); make some with `ltvn evaluate`.")
    return runs


def _drawn(run: Run) -> Run:
    """Return a run with its drawings, and without maps at which nothing was driven yet."""
    assert run.folder is not None
    places = {known.after: drawing_path(run.folder, known.after) for known in run.maps}
    maps = (
        replace(known, floorplan=load_drawing(place) if (place := places[known.after]).exists() else None)
        for known in run.maps
        if known.episodes or (run.columns.world and run.queries)
    )
    return replace(run, maps=tuple(maps))


def failed_episodes(runs: Iterable[Run]) -> tuple[FailureRow, ...]:
    """Return all failed episodes of static tests, with their recordings, still without images."""
    return tuple(
        FailureRow(trial=known, episode=episode, drive=drive, recording=recording if recording.exists() else None)
        for run in runs
        if run.columns.maintenance is None and run.folder is not None
        for drive in [run.folder.parent / "drive.rrd"]
        for known in run.maps
        for episode in known.episodes
        if not episode.reached
        for recording in [failure_path(run.folder, episode.query)]
    )


def with_images(rows: Iterable[FailureRow]) -> tuple[FailureRow, ...]:
    """Add start and goal images to rows whose drive exists, and the moment of failure to rows with a recording.

    Unreadable files are skipped, because a report is useful without images.
    """
    return tuple(_illustrated(row) for row in rows)


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
