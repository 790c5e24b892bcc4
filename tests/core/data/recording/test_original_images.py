"""Recordings keep the picture of the robot's own camera beside the one that the method uses."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.original_images import compress_original, decompress_original
from ltvn_core.data.recording.map_file import load_map, save_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.graph.deltas import Cause, Node, NodeAdded, PoseRow
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Observation
from tests.core.data.recording import example_recording

CAMERA = CameraModel.from_fov(160, 120, 1.2, height_m=0.3)


def with_original(step: int) -> Observation:
    picture = np.random.default_rng(step).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    return replace(example_recording.observation(step), original=compress_original(picture, CAMERA))


def write(path: Path, steps: range) -> None:
    with RecordingWriter(path, scene="demo", config={}, fingerprint="abc") as writer:
        for step in steps:
            writer.write_frame(with_original(step) if step % 2 else example_recording.observation(step))


def test_originals_come_back_with_their_camera_and_only_where_they_were_kept(tmp_path: Path) -> None:
    write(tmp_path / "a.rrd", range(6))
    recording = Recording.open(tmp_path / "a.rrd")
    assert all(recording.stored_frame(step).intact for step in recording.frames)
    for step in recording.frames:
        read, written = recording.observation(step).original, with_original(step).original
        assert (read is not None) == bool(step % 2)
        if read is not None and written is not None:
            assert (read.jpeg, read.camera) == (written.jpeg, CAMERA)
            assert decompress_original(read).shape == (120, 160, 3)


def test_originals_travel_into_rewritten_recordings_and_maps(tmp_path: Path) -> None:
    write(tmp_path / "a.rrd", range(4))
    recording = Recording.open(tmp_path / "a.rrd")
    with RecordingWriter(tmp_path / "b.rrd", scene="demo", config={}, fingerprint="abc") as writer:
        for step in recording.frames:
            writer.write_encoded_frame(recording.stored_frame(step).frame)
    copied = Recording.open(tmp_path / "b.rrd").observation(3).original
    assert copied is not None
    assert copied.camera == CAMERA
    graph = TopologicalGraph([NodeAdded(Node(3, PoseRow(0.0, 0.0, 0.0)), Cause.BUILD)])
    seen = [recording.observation(3)]
    save_map(tmp_path / "map.rrd", graph, seen, scene="demo", fingerprint="abc", config={})
    assert load_map(tmp_path / "map.rrd").observations[3].original is not None


def test_a_recording_without_depth_opens_and_stays_without(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.rrd", scene="demo", config={}, fingerprint="abc") as writer:
        for step in range(3):
            seen = example_recording.observation(step)
            writer.write_frame(replace(seen, depth=None) if step else seen)
    recording = Recording.open(tmp_path / "a.rrd")
    assert recording.frames == (0, 1, 2)
    assert recording.observation(0).depth is not None
    assert recording.observation(1).depth is None
    assert recording.stored_frame(2).intact
