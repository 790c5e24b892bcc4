"""Builds the snapshot of the app's state, with a hint about what to do next."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ltvn_core.navigation.event_table import NavigationProgress
from ltvn_core.navigation.events import Outcome
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.camera_feed import LargerImage
from ltvn_viz.session.floor_plan_clicks import aligning_hint
from ltvn_viz.session.map_handlers import drive_name
from ltvn_viz.session.snapshot import FineTuningPhase, LoopRates, Snapshot, TimelineStatus, WayNodes
from ltvn_viz.session.world_handlers import no_story
from ltvn_viz.timeline.run_moment import RunMoment, moment_of
from ltvn_viz.wishes.modes import Mode

LIST_EVERY_S = 2.0
"""Interval between searches of the folder of recordings, in seconds."""

WINDOW_S = 1.0
"""Time over which rates are averaged, in seconds."""
FEW_NODES = 8
FEW_IMAGES = 5
"""Number of images below which the robot counts as not driven yet."""


class RateMeter:
    """Counts events in a sliding window."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Measure by `clock`, in seconds."""
        self._clock = clock
        self._times: deque[float] = deque()
        self._began: float | None = None

    def count(self) -> None:
        """Count one event at the current time."""
        now = self._clock()
        if self._began is None:
            self._began = now
        self._times.append(now)
        while self._times[0] < now - WINDOW_S:
            self._times.popleft()

    @property
    def hz(self) -> float:
        """Recent events per second; 0 until a whole window has passed, because a short burst gives no rate."""
        if self._began is None or self._times[-1] - self._began < WINDOW_S:
            return 0.0
        return len(self._times) / WINDOW_S


class SnapshotBuilder:
    """Builds snapshots, and caches their slowly changing parts."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Measure rates by `clock`."""
        self._clock = clock
        self._meter = RateMeter(clock)
        self._listed_at = float("-inf")
        self._recorded: Mapping[str, str] = {}
        self._sources: tuple[str, ...] = ()

    def build(self, state: AppState) -> Snapshot:
        """Return the snapshot for now."""
        self._meter.count()
        activity = state.activity
        making = state.making.work
        learning = state.fine_tuning.status
        if learning.phase is not FineTuningPhase.LEARNING:
            learning = replace(learning, drive=drive_name(state))
        snapshot = _replayed(activity) if isinstance(activity, Playback) else _live(state)
        # This is needed even while no question is on show, because the offered questions depend on the run.
        state.debugger.refresh(state, snapshot.moment)
        snapshot = replace(
            snapshot,
            mode=activity.mode,
            rates=replace(snapshot.rates, loop_hz=self._meter.hz),
            recording=state.live.recorder.status,
            recordings=self._recordings(state),
            sources=self._sources,
            is_making=making is not None,
            timeline=_time(state, snapshot.moment),
            destination=activity.goal if isinstance(activity, Navigation) and not activity.is_stopping else None,
            pause_notice=activity.held_because if isinstance(activity, Navigation) else "",
            keeps_going=state.keeps_going if state.live.robot.clock.is_simulated else None,
            is_open_loop=bool(state.open_loop),
            drive_is_over=None if state.played is None else state.played.is_over,
            message=state.message,
            floor_plan=None if state.alignment is None else state.alignment.view,
            fine_tuning=learning,
            inspection=state.debugger.shown,
            weights=state.live_map.fingerprint,
            can_undo_build=state.live_map.can_undo_rebuild,
            work=activity.work if isinstance(activity, MapBuilding) else state.work or making,
        )
        return state.floor.of(replace(snapshot, hint=hint(snapshot)))

    def _recordings(self, state: AppState) -> Mapping[str, str]:
        if self._clock() - self._listed_at >= LIST_EVERY_S:
            self._listed_at = self._clock()
            self._recorded = state.library.words()
            self._sources = state.library.sources()
        under_way = state.live.recorder.status.name
        return {name: words for name, words in self._recorded.items() if name != under_way}


def _time(state: AppState, moment: RunMoment) -> TimelineStatus:
    run = state.shown_run
    replay = state.activity if isinstance(state.activity, Playback) else None
    number, marks = state.strips.of(run)
    return TimelineStatus(
        run=number,
        marks=marks,
        time_s=max(0.0, moment.stamp - run.start_s),
        length_s=max(0.0, (state.live.now_s if replay is None else run.end_s) - run.start_s),
        is_now=state.is_now,
        is_replay=replay is not None,
        is_playing=state.plays_past if replay is None else replay.playing,
        speed=state.play_speed,
    )


def _live(state: AppState) -> Snapshot:
    robot = state.live.robot
    shown = robot.state().stamp if state.shown_stamp is None else state.shown_stamp
    moment = moment_of(state.live.timeline, shown)
    pose = robot.drawn_pose
    if state.is_now:
        moment = replace(moment, robot=pose if np.isfinite(pose).all() else None)
    state.goals.refresh(moment.graph)
    state.goals.follow(_way(moment.progress))
    seen, age_s = state.feed.latest_image()
    feed = state.larger_feed
    larger = LargerImage() if feed is None else feed.latest_image(pose, is_shown=state.shows_camera())
    return Snapshot(
        scene=state.scene,
        moment=moment,
        camera=seen,
        larger=larger.jpeg or (b"" if seen is None else seen.original),
        rates=LoopRates(frame_age_ms=1000 * age_s, dropped=larger.dropped),
        selected=state.goals.selected,
        gallery=state.goals.gallery,
        way=state.goals.way,
        upload=state.goals.upload,
        world=None if state.world is None else state.world.view,
        link=None if state.link is None else state.link.report,
        story=() if state.story is None else tuple(state.story.captions),
        story_goes_on=state.story is not None and not state.story.is_over,
        no_story=no_story(state),
        story_query=None if state.story is None else state.story.query,
    )


def _way(progress: NavigationProgress) -> WayNodes | None:
    if progress.query is None or progress.goal is None:
        return None
    at = None if progress.localised is None else progress.localised.node
    return WayNodes(at, None if progress.attempt is None else progress.attempt.target, progress.goal)


def _replayed(replay: Playback) -> Snapshot:
    moment = replay.moment()
    camera = replay.camera(replay.found if moment.frame is None else moment.frame)
    return Snapshot(
        scene=replay.scene,
        moment=moment,
        camera=camera,
        larger=b"" if camera is None else camera.original,
        replay=replay.name,
        course=replay.course,
        lone_camera=replay.camera_model if replay.is_imported else None,
        selected=moment.progress.goal if replay.found is None else replay.found,
    )


def hint(snapshot: Snapshot) -> str:
    """Return a hint about what to do next."""
    if snapshot.floor_plan is not None and snapshot.floor_plan.is_aligning:
        return aligning_hint(snapshot.floor_plan)
    if not snapshot.timeline.is_now and not snapshot.timeline.is_replay:
        return (
            "The map shows the past, the camera shows the present. “Live” below the map returns to now, and so "
            "does driving."
        )
    if snapshot.story_goes_on and snapshot.mode in (Mode.TELEOP, Mode.NAVIGATING):
        return "Watch the story; the text below the map explains it. W A S D or Space ends it."
    match snapshot.mode:
        case Mode.BUILDING:
            return "The map is being built from all images so far. You can cancel; the old map stays until then."
        case Mode.NAVIGATING if (waiting := snapshot.waiting) is not None:
            return f"The robot waits at node {waiting.source}: {waiting.action.rstrip('.')}. Then press “Done”."
        case Mode.NAVIGATING:
            return "Watch: yellow is the plan. Take the robot over with W A S D, stop it with Space, or pause."
        case Mode.PAUSED:
            if snapshot.pause_notice:
                return f"{snapshot.pause_notice} Press “Go on”, or cancel."
            return "Paused. Resume, do single steps, or cancel."
        case Mode.REPLAY if snapshot.lone_camera is not None and not snapshot.moment.graph.ids.size:
            return "This is an imported drive. Play it, or press “Build a map” (B) under “Drive”."
        case Mode.REPLAY:
            return "This is a recording. Click into the timeline, or play; “Back to the robot” under “Replay” ends it."
        case Mode.TELEOP:
            return _driving(snapshot)


def _driving(snapshot: Snapshot) -> str:
    moment = snapshot.moment
    if snapshot.drive_is_over:
        return "The recorded drive is over. Press “Play the drive again” under “Drive”, or ask under “Why”."
    if snapshot.is_open_loop:
        return "A recorded drive replaces the robot. Watch the map grow, or ask under “Why” where the robot is."
    if snapshot.recording.name is not None:
        return "Recording. Drive through the rooms with W A S D; then keep the recording (N) or discard it."
    if snapshot.fine_tuning.phase is FineTuningPhase.LEARNED:
        return "The network has learned from your drive. Look at the figures under “Drive”, then use the new weights."
    if len(moment.graph.ids) < FEW_NODES and moment.frames < FEW_IMAGES:
        return "Hold W A S D or the arrow keys to drive. The map grows as the robot sees new places."
    if len(moment.graph.ids) < FEW_NODES:
        return "The map is growing. Drive on through the doors; places seen from both sides connect best."
    ended = moment.progress.ended
    if ended is None:
        return "Pick a goal: click a node of the map or an image under “Go”. Or hold W A S D and drive yourself."
    if ended.query == snapshot.story_query:
        return "The story is over. Pick a goal by an image under “Go”, or ask under “Why” what the map learned."
    if ended.outcome is Outcome.ARRIVED:
        return "Arrived. Pick the next goal, or press R to record what happens from now on and replay it later."
    if ended.outcome is Outcome.CANCELLED:
        return "You are driving. Hold W A S D to drive, or pick a goal again."
    return "The robot did not arrive. Drive the missing route so that the map learns it, then try the goal again."
