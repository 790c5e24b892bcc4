"""A map remembers its navigation system: the right weights build it, and the same system drives by it."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import MapError
from ltvn_core.maps.map_coverage import GoalReport, Standing
from ltvn_core.network.weights_file import weights_fingerprint
from ltvn_core.systems.registry import system_entry
from ltvn_core.verbs.build import BuildSummary, BuildVerb
from ltvn_core.verbs.navigate import NavigateVerb
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.options import AppOptions

pytest.importorskip("embreex")
DEMO_MAP = Path(__file__).parents[3] / "recordings" / "demo-map.rrd"


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short drive through the demo apartment: the first images of its map."""
    path = tmp_path_factory.mktemp("drive") / "drive.rrd"
    demo = Recording.open(DEMO_MAP)
    with RecordingWriter(path, scene=demo.meta.scene, config={}, fingerprint="") as writer:
        for frame in demo.frames[:12]:
            writer.write_frame(demo.observation(frame))
    return path


@pytest.mark.parametrize("system", ["ltvn", "sptm", "ving"])
def test_a_map_is_built_with_the_weights_of_its_system(drive: Path, tmp_path: Path, system: str) -> None:
    output = tmp_path / "map.rrd"
    BuildVerb(recordings=(drive,), output=output, system=system).run()
    assert list(tmp_path.iterdir()) == [output]
    meta = load_map(output).meta
    assert meta.fingerprint == weights_fingerprint(system_entry(system).weights)
    assert meta.config["system"] == system


def test_a_saved_map_is_driven_by_the_system_that_built_it(drive: Path, tmp_path: Path) -> None:
    built, trip, after = (tmp_path / name for name in ("map.rrd", "trip.rrd", "after.rrd"))
    BuildVerb(recordings=(drive,), output=built, system="sptm", predictor="oracle").run()
    NavigateVerb(map=built, recording=trip, output=after, predictor="oracle", queries=2).run()
    assert Recording.open(trip).meta.config["system"] == "sptm"
    assert load_map(after).meta.config["system"] == "sptm"
    # SPTM does not maintain its map, so no drive leaves a trace in it.
    assert load_map(after).graph == load_map(built).graph


def test_a_goal_is_told_of_when_the_map_is_built_and_before_it_is_driven_to(drive: Path, tmp_path: Path) -> None:
    built, trip = tmp_path / "map.rrd", tmp_path / "trip.rrd"
    goal = Recording.open(drive).frames[5]
    summary = BuildVerb(recordings=(drive,), output=built, predictor="oracle", goals=(goal,)).run()
    assert isinstance(summary, BuildSummary)
    assert summary.goals == (GoalReport(goal, Standing.HELD),)
    reserve = min(load_map(built).graph.reserve)
    with pytest.raises(MapError, match=rf"does not contain goal {reserve}.*Nearest to it is node \d+, r = "):
        NavigateVerb(map=built, recording=trip, predictor="oracle", goal=reserve).run()
    assert not trip.exists()


def test_the_app_drives_a_map_with_its_own_system_and_weights_and_records_that(drive: Path, tmp_path: Path) -> None:
    built = tmp_path / "map.rrd"
    BuildVerb(recordings=(drive,), output=built, system="ving").run()
    with ExitStack() as stack:
        state = open_app_state(AppOptions(map=built, recordings=tmp_path), stack)
        state.live.begin_recording()
        recorded = state.live.recorder.close()
        nodes = len(state.live_map.graph.nodes)
        seen = state.live_map.observations()[0]
        assert state.live_map.offer(replace(seen, step=10**6)) == ()
        state.live_map.rebuild(lambda _done, _total: None)
    assert recorded is not None
    assert Recording.open(recorded).meta.config["system"] == state.live_map.system.name == "ving"
    assert state.live_map.fingerprint == weights_fingerprint(system_entry("ving").weights)
    assert state.fine_tuning.weights == system_entry("ving").weights
    assert len(state.live_map.graph.nodes) == nodes + 1
