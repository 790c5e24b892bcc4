"""Odometry that jumps is put right by the depth images around the jump, and left alone where nothing slipped."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.reader import Recording
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.corrections import from_config
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.wheel_slips import Slip, SlipCheck, SlipTracker, find_slips, without_slips
from ltvn_core.maps.built_map import build_map
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation, Pose
from tests.repository import RECORDINGS

CAMERA = LOCOBOT.camera


@pytest.fixture(scope="module")
def drive() -> list[Observation]:
    """The first images of the demo drive, whose wheels do not slip."""
    recording = Recording.open(RECORDINGS / "demo-drive.rrd")
    return [recording.observation(frame) for frame in recording.frames[:320]]


def slipped(drive: Sequence[Observation], at: int, slip: Pose) -> list[Observation]:
    """Return the images as they come where odometry jumps by (3,), in the robot's frame, before one of them."""
    before = drive[at - 1].odometry
    jumped = [
        replace(seen, odometry=compose(compose(before, slip), relative(before, seen.odometry))) for seen in drive[at:]
    ]
    return [*drive[:at], *jumped]


def course(drive: Sequence[Observation]) -> Pose:
    """Return the odometry (N, 3) of some images, seen from the first."""
    odometry = np.array([seen.odometry for seen in drive])
    return relative(odometry[0], odometry)


def test_a_drive_that_does_not_slip_stays_as_it_is(drive: list[Observation]) -> None:
    mended = without_slips(drive, CAMERA)
    assert all(after is before for before, after in zip(drive, mended, strict=True))


@pytest.mark.parametrize("at", [75, 140, 265])
@pytest.mark.parametrize("slip", [(0.2, 0.0, 0.15), (-0.15, 0.0, -0.2), (0.0, 0.0, 0.3)])
def test_after_a_slip_the_course_is_what_it_would_have_been(
    drive: list[Observation], at: int, slip: tuple[float, float, float]
) -> None:
    wrong = slipped(drive, at, np.array(slip))
    gap = np.abs(relative(course(drive), course(without_slips(wrong, CAMERA))))
    # An error in the heading grows with the way, so it is the heading that tells.
    assert gap[:, 2].max() < 0.08
    near = slice(at, at + 5)
    assert np.hypot(gap[near, 0], gap[near, 1]).max() < 0.12


def test_without_depth_nothing_is_mended(drive: list[Observation]) -> None:
    blind = [replace(seen, depth=None) for seen in slipped(drive, 75, np.array([0.2, 0.0, 0.2]))]
    assert np.array_equal(course(without_slips(blind, CAMERA)), course(blind))


def test_another_drive_begins_with_its_own_odometry(drive: list[Observation]) -> None:
    second = drive[80:120]
    starts = [second[0].step]
    wrong = slipped(drive[:80], 40, np.array([0.2, 0.0, 0.2]))
    mended = without_slips([*wrong, *second], CAMERA, starts)
    assert all(after is before for before, after in zip(second, mended[80:], strict=True))


def test_a_robot_that_turned_far_since_its_last_image_should_look_again(drive: list[Observation]) -> None:
    tracker = SlipTracker(CAMERA)
    here = drive[0].odometry
    assert not tracker.needs_image(here)
    tracker.see(drive[0])
    assert not tracker.needs_image(here)
    assert tracker.needs_image(compose(here, np.array([0.0, 0.0, 0.5])))
    assert tracker.needs_image(compose(here, np.array([0.4, 0.0, 0.0])))


@pytest.fixture(scope="module")
def check(drive: list[Observation]) -> SlipCheck:
    """A check of slips between images 60 and 90 of the drive."""
    predictor = open_predictor("network")
    keyframes = KeyframeStore(predictor)
    keyframes.add(drive[60:90])
    return SlipCheck(Matcher(predictor, keyframes, ROBUST.matching))


@pytest.mark.parametrize(
    "slip", [(0.2, 0.0, 0.15), (-0.15, 0.0, -0.2), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1), (0.1, -0.15, 0.1)]
)
def test_a_slip_of_known_size_is_found_and_confirmed_by_pictures(
    drive: list[Observation], check: SlipCheck, slip: tuple[float, float, float]
) -> None:
    short = drive[60:90]
    wrong = slipped(short, 15, np.array(slip))
    (found,) = find_slips(wrong, CAMERA)
    assert found.row == 15
    assert found.size == pytest.approx([np.hypot(*slip[:2]), abs(slip[2])], abs=0.06)
    off = relative(course(short), course(without_slips(wrong, CAMERA, (), check.confirms)))
    was_off = relative(course(short), course(wrong))
    assert np.linalg.norm(off) < 0.3 * np.linalg.norm(was_off)


@pytest.mark.parametrize("claimed", [(0.2, 0.0, 0.15), (-0.1, 0.0, 0.1), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)])
def test_pictures_refuse_a_slip_that_never_was(
    drive: list[Observation], check: SlipCheck, claimed: tuple[float, float, float]
) -> None:
    short = drive[60:90]
    moved = relative(short[14].odometry, short[15].odometry)
    assert not check.confirms(short, Slip(15, moved, compose(moved, np.array(claimed))), (0, 29))


def test_jumps_no_larger_than_the_usual_error_of_the_search_are_no_slips(drive: list[Observation]) -> None:
    shaken = drive[60:100]
    for at in range(1, len(shaken), 2):  # Images that are shaken to and fro, as by a hand.
        shaken[at] = replace(shaken[at], odometry=compose(shaken[at].odometry, np.array([0.1, 0.0, 0.1])))
    assert not find_slips(shaken, CAMERA)


def test_without_odometry_no_motion_is_invented(drive: list[Observation]) -> None:
    still = [replace(seen, odometry=np.zeros(3)) for seen in drive[60:100:2]]
    assert all(after is before for before, after in zip(still, without_slips(still, CAMERA), strict=True))
    tracker = SlipTracker(CAMERA)
    assert all(tracker.see(seen) is seen for seen in still)


def test_a_map_of_a_drive_without_odometry_has_no_edge_by_odometry(drive: list[Observation]) -> None:
    still = [replace(seen, odometry=np.zeros(3)) for seen in drive[60:100:2]]
    predictor = open_predictor("network")
    graph = build_map(still, predictor=predictor).graph
    assert graph.nodes
    assert not any(any(node.odometry) for node in graph.nodes.values())
    assert not any(edge.by_odometry for edge in graph.edges.values())


def test_a_map_tells_what_its_build_corrected_and_how_sure_that_is(drive: list[Observation], tmp_path: Path) -> None:
    wrong = slipped(drive[60:90], 15, np.array([0.2, 0.0, 0.15]))
    built = build_map(wrong, predictor=open_predictor("network"))
    built.save(tmp_path / "map.rrd")
    told = read_info(tmp_path / "map.rrd").corrections
    assert told == built.corrections
    (slips,) = [each for each in told if each.what == "wheel slips"]
    assert slips.count == 1
    assert slips.most_m == pytest.approx(0.2, abs=0.15)
    assert slips.most_deg == pytest.approx(np.degrees(0.15), abs=3)
    assert slips.error_m is not None
    assert 0 < slips.error_m < 0.15
    assert not from_config({"corrections": [{"what": "slips"}, 3, None]})
