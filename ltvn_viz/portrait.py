"""Makes the snapshot of a stage: what the page shows of it now."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ltvn_viz.building import Building
from ltvn_viz.hints import hint
from ltvn_viz.lessons import drive_name
from ltvn_viz.rates import RateMeter
from ltvn_viz.replay import Replay
from ltvn_viz.snapshot import LearningStatus, Phase, Rates, Snapshot
from ltvn_viz.stage import Stage

LIST_EVERY_S = 2.0
"""How often the folder of recordings is looked through."""


class Portrait:
    """Takes snapshots, and remembers what need not be looked up each time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Measure rates by `clock`."""
        self._clock = clock
        self._meter = RateMeter(clock)
        self._listed_at = float("-inf")
        self._names: tuple[str, ...] = ()

    def take(self, stage: Stage) -> Snapshot:
        """Return what the page should show now."""
        self._meter.count()
        activity = stage.activity
        snapshot = _replayed(activity) if isinstance(activity, Replay) else _live(stage)
        if stage.inspector.is_on:
            stage.inspector.refresh(stage.cases.of(stage, snapshot.moment))
        snapshot = replace(
            snapshot,
            mode=activity.mode,
            rates=replace(snapshot.rates, loop_hz=self._meter.hz),
            recording=stage.live.recorder.status,
            recordings=self._recordings(stage),
            message=stage.message,
            learning=_learning(stage),
            inspection=stage.inspector.shown,
            weights=stage.mapping.fingerprint,
            work=activity.work if isinstance(activity, Building) else stage.work,
        )
        return replace(snapshot, hint=hint(snapshot))

    def _recordings(self, stage: Stage) -> tuple[str, ...]:
        if self._clock() - self._listed_at >= LIST_EVERY_S:
            self._listed_at, self._names = self._clock(), stage.library.names()
        under_way = stage.live.recorder.status.name
        return tuple(name for name in self._names if name != under_way)


def _learning(stage: Stage) -> LearningStatus:
    status = stage.learning.status
    return status if status.phase is Phase.LEARNING else replace(status, drive=drive_name(stage))


def _live(stage: Stage) -> Snapshot:
    robot = stage.live.robot
    shown = robot.stamp if stage.look_back is None else stage.look_back
    moment, pose = stage.live.timeline.at(shown), robot.exact_pose
    moment = replace(moment, robot=pose if np.isfinite(pose).all() else None)
    stage.goals.refresh(moment.graph)
    picture = stage.feed.look(pose)
    return Snapshot(
        scene=stage.scene,
        moment=moment,
        camera=picture.view,
        rates=Rates(frame_age_ms=1000 * picture.age_s, dropped=picture.dropped),
        selected=stage.goals.selected,
        gallery=stage.goals.gallery,
        lookalikes=stage.goals.lookalikes,
    )


def _replayed(replay: Replay) -> Snapshot:
    moment = replay.moment()
    return Snapshot(
        scene=replay.scene,
        moment=moment,
        camera=replay.camera(moment.frame),
        replay=replay.status,
        selected=moment.progress.goal,
    )
