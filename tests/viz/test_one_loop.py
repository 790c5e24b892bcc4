"""The page, a headless run, a robot of one's own and an evaluation drive a query alike, down to the last event."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.protocol import EpisodePlan, EvaluationProtocol
from ltvn_core.geometry import Pose
from ltvn_core.graph.operators import pose_row
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import Event, Judged
from ltvn_core.simulation.opening import Simulation, open_simulation
from ltvn_core.types import NodeId
from ltvn_core.verbs.build import BuildVerb
from ltvn_core.verbs.headless_runner import HeadlessRunner
from ltvn_core.verbs.robot_queries import RobotQueries
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.asked_actions import AskedActions
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.live_run import LiveRobot, LiveRun
from ltvn_viz.session.recorder import Recorder
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.worker import Worker
from tests.repository import ROOT
from tests.viz.session_harness import InlineExecutor

pytest.importorskip("embreex")

SEED = 3
SCENE = "demo"
IMAGES = 40
PROTOCOL = EvaluationProtocol(distance_noise=0.0, angle_noise=0.0)
"""Odometry without noise, which would be drawn from other generators."""


@dataclass(frozen=True)
class Errand:
    """A map and a query in it: the same for every loop."""

    map_file: Path
    start: NodeId
    goal: NodeId
    folder: Path

    def known(self) -> TopologicalMap:
        return TopologicalMap.open(load_map(self.map_file), predictor="oracle")

    def simulation(self, known: TopologicalMap) -> Simulation:
        return open_simulation(
            SCENE,
            seed=SEED,
            first_step=max(known.keyframes.frames) + 1,
            start=self.pose(known, self.start),
            odometry_noise=PROTOCOL.odometry_noise,
        )

    def pose(self, known: TopologicalMap, node: NodeId) -> Pose:
        pose = known.keyframes.observation(node).exact_pose
        assert pose is not None
        return pose

    def writer(self, known: TopologicalMap, name: str) -> RecordingWriter:
        return RecordingWriter(
            self.folder / f"{name}.rrd", scene=SCENE, config={}, fingerprint="", camera=known.predictor.camera
        )

    def recorded(self, name: str) -> list[Event]:
        return [stamped.event for stamped in Recording.open(self.folder / f"{name}.rrd").events]


@pytest.fixture(scope="module")
def errand(tmp_path_factory: pytest.TempPathFactory) -> Errand:
    """The first images of the demo map, mapped; from its first node to its last."""
    folder = tmp_path_factory.mktemp("errand")
    drive, built = folder / "drive.rrd", folder / "map.rrd"
    demo = Recording.open(ROOT / "recordings" / "demo-map.rrd")
    with RecordingWriter(drive, scene=SCENE, config={}, fingerprint="", camera=demo.meta.camera) as writer:
        for frame in demo.frames[:IMAGES]:
            writer.write_frame(demo.observation(frame))
    BuildVerb(recordings=(drive,), output=built, predictor="oracle").run()
    nodes = list(load_map(built).graph.nodes)
    return Errand(built, nodes[0], nodes[-1], folder)


def headless(errand: Errand) -> list[Event]:
    known = errand.known()
    with errand.writer(known, "headless") as writer:
        runner = HeadlessRunner(errand.simulation(known), writer, known)
        runner.run_queries([errand.goal], np.random.default_rng(SEED))
    return errand.recorded("headless")


def own_robot(errand: Errand) -> list[Event]:
    known = errand.known()
    with errand.writer(known, "robot") as writer:
        robot = errand.simulation(known).robot
        RobotQueries(robot, writer, known, np.random.default_rng(SEED)).drive_to(errand.goal, 0)
    return errand.recorded("robot")


def evaluation(errand: Errand) -> list[Event]:
    known = errand.known()
    simulation = errand.simulation(known)
    plan = EpisodePlan(
        errand.start, errand.goal, pose_row(errand.pose(known, errand.start)), pose_row(errand.pose(known, errand.goal))
    )
    events: list[Event] = []
    runner = EpisodeRunner(simulation.scene, known, PROTOCOL)
    runner.run(0, plan, np.random.default_rng(SEED), on_event=lambda event, robot: events.append(event))
    return events


def page(errand: Errand) -> list[Event]:
    known = errand.known()
    live_map = LiveMap(known, np.random.default_rng(SEED))
    robot = LiveRobot(errand.simulation(known).robot)
    recorder = Recorder(RecordingLibrary(errand.folder), lambda path: errand.writer(known, path.stem))
    live = LiveRun(robot, recorder, Timeline())
    query = live_map.query(robot, errand.goal, 0, AskedActions())
    worker = Worker(InlineExecutor())
    navigation = Navigation(live, worker, errand.goal, query, cancel=live_map.cancel)
    while not navigation.over:
        navigation.tick()
        worker.collect()
    return [stamped.event for stamped in live.timeline.events]


def test_a_query_gives_the_same_events_in_every_loop(errand: Errand) -> None:
    expected = without_verdicts(headless(errand))
    assert len(expected) > 10
    for loop in (own_robot, evaluation, page):
        assert without_verdicts(loop(errand)) == expected, loop.__name__


def without_verdicts(events: Sequence[Event]) -> list[str]:
    """The events as text, but for the verdict of whoever knows the truth, which a robot of one's own has not."""
    return [repr(event) for event in events if not isinstance(event, Judged)]
