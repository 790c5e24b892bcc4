"""The debugger compares the images of a recording with whatever camera they were taken."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

import ltvn_core as ltvn
from ltvn_core.graph.deltas import Cause
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.goals import ThumbnailStore
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from tests.core.predictors.foreign_drive import CAMERA, foreign_images
from tests.core.predictors.textured_room import TexturedRoom
from tests.viz.debugger.answer_links import words
from tests.viz.session_harness import FakeDriver


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a drive from which a map was built on the way."""
    folder, images = tmp_path_factory.mktemp("foreign"), foreign_images(8)
    predictor = open_predictor("geometric", camera=CAMERA)
    built = ltvn.build_map(images, predictor=predictor, camera=CAMERA)
    with ltvn.RecordingWriter(
        folder / "run.rrd",
        scene="a real house",
        config={"verb": "app", "predictor": "geometric"},
        fingerprint=predictor.fingerprint,
        camera=CAMERA,
    ) as writer:
        for seen in images:
            writer.write_frame(seen)
        for delta in built.graph.deltas(Cause.BUILD):
            writer.write_event(StampedEvent(images[-1].step, images[-1].stamp, GraphChanged(delta)))
    with ltvn.RecordingWriter(folder / "simulated.rrd", scene="a real house", config={}, fingerprint="") as writer:
        writer.write_frame(TexturedRoom(3).observe(np.array([1.0, 1.0, 0.0]), 0, LOCOBOT.camera))
    return folder


def watch(
    folder: Path, predictor: str, stack: ExitStack, *, opened_with: str = "run.rrd"
) -> tuple[Session, list[Snapshot]]:
    options = AppOptions(scene="a real house", recordings=folder, replay=opened_with, predictor=predictor)
    state = open_app_state(options, stack, ThumbnailStore())
    shown: list[Snapshot] = []
    session = Session(state, FakeDriver(), shown.append)
    stack.callback(session.close)
    session.send(c.OpenRecording("run.rrd", at_s=1e4))
    return session, shown


def ticks(session: Session, count: int) -> Iterator[None]:
    for _ in range(count):
        session.tick()
        session.state.worker.settle()
        yield


@pytest.mark.parametrize("predictor", ["auto", "network"])
def test_a_place_is_looked_for_in_a_map_of_another_camera(folder: Path, predictor: str) -> None:
    with ExitStack() as stack:
        session, shown = watch(folder, predictor, stack)
        session.send(c.ChooseQuestion(QuestionName.WHERE))
        for _ in ticks(session, 12):
            pass
        told = words(shown[-1])
        assert "near enough" in told
        assert ("recorded with other weights" in told) == (predictor == "network")
        own_camera = session.state.live_map.predictor.camera == CAMERA
        assert own_camera == (predictor == "auto")


@pytest.mark.parametrize("predictor", ["auto", "network"])
def test_an_app_for_simulated_images_compares_a_recording_as_its_map_was_made(folder: Path, predictor: str) -> None:
    with ExitStack() as stack:
        session, shown = watch(folder, predictor, stack, opened_with="simulated.rrd")
        session.send(c.ChooseQuestion(QuestionName.WHERE))
        for _ in ticks(session, 12):
            pass
        told = words(shown[-1])
        assert "near enough" in told
        assert ("recorded with other weights" in told) == (predictor == "network")
        assert session.state.live_map.predictor.camera == LOCOBOT.camera
