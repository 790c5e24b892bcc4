"""Opens a recording or a map for the questions of the debugger, with a page or without one.

Owns the context of questions for an open recording, and opening a recording without page, session and robot. Writes no
files.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.data.recording.metadata import RecordingMetadata
from ltvn_core.errors import LtvnError, OptionError, RecordingError
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.predictors.opening import open_method
from ltvn_core.systems.maintenance import recorded_filter
from ltvn_core.systems.registry import open_system
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.session.activities.playback import Playback, ReplayMethod, read_replay
from ltvn_viz.session.backend import AbsentPredictor, predictor_for
from ltvn_viz.session.inspection import QuestionAnswer
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.recording_library import RecordingLibrary, rerun_unavailable
from ltvn_viz.session.saved_files import SavedFile, SavedFiles
from ltvn_viz.timeline.run_moment import RunMoment

_NAMES = 10

ResultT = TypeVar("ResultT")


def replay_context(
    replay: Playback,
    moment: RunMoment,
    comparison: Callable[[], ReplayMethod],
    *,
    known_events: int,
    live: Timeline,
    in_background: BackgroundCache,
    library: RecordingLibrary,
    rerun: Callable[[Path], str] = rerun_unavailable,
    offer_file: Callable[[Path], SavedFile] | None = None,
    floor_plan: FloorPlan | None = None,
) -> DebugContext:
    """Return the context of questions at a moment of an open recording.

    `comparison` returns how its images are compared.
    """
    run = replay.timeline
    return DebugContext(
        name=replay.name,
        scene=replay.scene,
        start_s=run.start_s,
        moment=moment,
        step=run.instant_at(moment.stamp).step,
        timeline=run,
        known_events=known_events,
        observation=replay.observation,
        camera=replay.camera_model,
        comparison=comparison,
        weights=replay.weights,
        system=replay.system,
        presence_filter=recorded_filter(replay.maintenance),
        live_map=None,
        live=live,
        in_background=in_background,
        library=library,
        rerun=rerun,
        offer_file=offer_file or SavedFiles().offer,
        floor_plan=floor_plan,
        unsure=replay.unsure,
    )


class JobsAtOnce:
    """Runs each job immediately in the calling thread."""

    def __init__(self, longest_s: float = math.inf) -> None:
        """Set the deadline, in seconds from now, after which no more jobs are started."""
        self.done = 0
        self._longest_s = longest_s
        self._deadline = time.monotonic() + longest_s

    def submit(self, job: Callable[[], ResultT], then: Callable[[ResultT], None]) -> None:
        """Run a job, then its follow-up. Raises LtvnError after the deadline."""
        if time.monotonic() > self._deadline:
            raise LtvnError(f"This takes longer than {self._longest_s:.0f} s; ask about a shorter run, or in the page.")
        self.done += 1
        then(job())

    def complete(self, ask: Callable[[], QuestionAnswer]) -> QuestionAnswer:
        """Ask again and again, until no part of the answer is pending or no job is left to run."""
        answer, before = ask(), -1
        while answer.is_pending and self.done != before:
            before = self.done
            answer = ask()
        return ask() if self.done else answer  # An answer may be whole without what the last job found.


class _FolderAndPaths(RecordingLibrary):
    """The recordings in a folder by name, and others by path: in a terminal, whoever asks may read them."""

    def path(self, name: str) -> Path:
        """Return the path of a recording. Raises RecordingError."""
        if name in self.names():
            return super().path(name)
        path = Path(name).expanduser()
        if not path.is_file():
            known = ", ".join(self.names()[:_NAMES]) or "none"
            raise RecordingError(
                f"There is no file {name!r:.200}, and no recording of that name in {self.folder} ({known}). Give the "
                "path of a .rrd file, or one of these names."
            )
        return path


class FileCase:
    """An open recording or map for questions. For one thread at a time."""

    def __init__(self, path: Path, library: RecordingLibrary | None = None, *, weights: Path | None = None) -> None:
        """Open a file; questions may use the other recordings of `library`, by default those in the file's folder and
        those named by a path, and compare images with `weights`, by default the shipped ones.

        Raises RecordingError.
        """
        if not path.is_file():
            raise RecordingError(f"{path} does not exist or is not a file; give the path of a .rrd recording or map.")
        self.path = path
        self._weights = weights
        self.library = library or _FolderAndPaths(path.absolute().parent)
        self.replay = read_replay(path, self._remember)
        """The open recording, with its images and its length."""

    @property
    def timeline(self) -> Timeline:
        """All events of the recording."""
        return self.replay.timeline

    def context(self, at_s: float, jobs: JobsAtOnce) -> DebugContext:
        """Return the context of questions at a time in seconds after the beginning, without cached answers.

        Raises OptionError for a time outside the recording.
        """
        length_s = self.replay.length_s
        if not 0 <= at_s <= length_s + _ROUNDING_S:  # False for NaN too.
            raise OptionError(f"{self.path.name} has times from 0 to {length_s:.1f} s, so {at_s:g} s is outside.")
        self.replay.seek(at_s)
        return replay_context(
            self.replay,
            self.replay.moment(),
            lambda: self._comparison,
            known_events=len(self.timeline.events),
            live=Timeline(),
            in_background=BackgroundCache(jobs.submit, lambda: None),
            library=self.library,
        )

    def _remember(self, meta: RecordingMetadata) -> None:
        self._meta = meta

    @cached_property
    def _comparison(self) -> ReplayMethod:
        """How the images are compared; opened only for a question that compares them, because that takes seconds.

        A stand-in compares nothing and says why if it cannot be opened.
        """
        defaults = AppOptions(replay="", weights=self._weights)
        try:
            choice = ImageSource.of(self._meta).choose()
            options = replace(defaults, predictor=choice.name, scene=self._meta.scene)
            predictor = predictor_for(options, self._meta.camera)
        except LtvnError as missing:
            predictor = AbsentPredictor(missing)
        return ReplayMethod(predictor, open_system(defaults.system, open_method(defaults.preset, predictor)).method)


_ROUNDING_S = 0.1
"""Tolerance in seconds: times are written with one decimal, so rounding may move the last one past the end."""
