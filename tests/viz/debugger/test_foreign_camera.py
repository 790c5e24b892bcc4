"""The debugger compares the images of a recording with whatever camera they were taken."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

import ltvn_core as ltvn
from ltvn_core.graph.deltas import Cause
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.options import AppOptions
from ltvn_viz.wishes import commands as c
from tests.core.predictors.foreign_drive import CAMERA, foreign_images
from tests.core.predictors.textured_room import TexturedRoom
from tests.viz.app_session import AppSession
from tests.viz.debugger.answer_links import words


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


@pytest.mark.parametrize("opened_with", ["run.rrd", "simulated.rrd"])
@pytest.mark.parametrize("predictor", ["auto", "network"])
def test_a_place_is_looked_for_as_its_map_was_made_whatever_the_app_was_opened_for(
    folder: Path, opened_with: str, predictor: str
) -> None:
    with ExitStack() as stack:
        options = AppOptions(scene="a real house", recordings=folder, replay=opened_with, predictor=predictor)
        page = AppSession(stack, options)
        asked = c.OpenRecording("run.rrd", at_s=1e4), c.Ask(c.Action.QUESTION, QuestionName.WHERE)
        told = words(page.do(*asked, ticks=12))
        assert "near enough" in told
        assert ("recorded with other weights" in told) == (predictor == "network")
        own = CAMERA if (opened_with, predictor) == ("run.rrd", "auto") else LOCOBOT.camera
        assert page.state.live_map.predictor.camera == own
