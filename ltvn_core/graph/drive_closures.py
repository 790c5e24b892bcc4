"""Loop closures of a drive, and the correction of its odometry by them.

Odometry drifts: after a long way it cannot tell a room from the one beside it, and where rooms look alike the network
cannot either. But all places that a drive passes twice must agree on one trajectory. Closures that contradict the
others are perceptual aliases (`graph.pose_graph`); the rest fix the trajectory to within decimetres. Owns which images
are compared, and the correction of their odometry (ours).
"""

import logging
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress, groupby
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ltvn_core.config import BuildingConfig
from ltvn_core.geometry import compose, distance, lengths_along, relative
from ltvn_core.graph.closure_judgement import TOO_MANY, ClosureJudgement, JudgedCourse, PassOverlay
from ltvn_core.graph.corrections import LOOK_ALIKES, UNSURE, Correction, UnsurePlaces
from ltvn_core.graph.drive_links import drive_links, surest_links
from ltvn_core.graph.keyframes import KeyframeStore, odometry_of
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.odometry_gate import PAUSE_S, DriveLink, OdometryGate
from ltvn_core.graph.pose_graph import OptimisedPoses, RelativePoses, deviations, optimise
from ltvn_core.types import FrameId, Observation

log = logging.getLogger(__name__)


def separate_contradicted_drives(observations: Sequence[Observation], matcher: Matcher, config: BuildingConfig) -> None:
    """Restart odometry, in the matcher's keyframes, at each drive whose images contradict that it continues odometry:
    it allows fewer than half of their links.

    Costs a few thousand comparisons for each drive that continues odometry after a pause of more than `PAUSE_S`.
    """
    ordered = sorted(observations, key=lambda seen: seen.step)
    keyframes = matcher.keyframes
    frames = [seen.step for seen in ordered]
    for first in keyframes.resumed_starts:
        row = bisect_left(frames, first)
        if not 0 < row < len(frames) or ordered[row].stamp - ordered[row - 1].stamp <= PAUSE_S:
            continue
        own = [seen for seen in ordered if keyframes.drive_of(seen.step) == keyframes.drive_of(first)]
        before = [seen for seen in ordered if keyframes.drive_of(seen.step) == keyframes.drive_of(first) - 1]
        links = drive_links([*before, *own], [first], matcher, config)
        gate = OdometryGate([*before, *own], config)
        if 2 * sum(gate.allows(link) for link in links) < len(links):
            log.warning(
                "Images contradict that odometry continues at image %d; only recognised images join that drive.", first
            )
            keyframes.restart_odometry(first)


_KEY_GAP = 0.5
"""Least d between two images of a drive that are both compared."""
_AGAIN_M = 4.0
"""Least distance driven between two images whose match shows drift, in metres."""
_BATCH = 200
"""Number of compared images after which the closures found so far are applied."""
_CLOSURE_DEVIATIONS = (0.12, 0.12, 0.1)
"""Standard deviations of the network's waypoint over an edge, in m, m and rad."""
_SAME_STRETCH_M, _MOST_IN_STRETCH = 2.0, 3.0
"""Closures within this distance along a drive, in metres, together weigh at most as much as this number of closures."""
_UNSURE_M = 1.0
"""Standard deviation of a place, in metres, above which `ltvn info` counts it as unsure."""
_APART_M = 1.0
"""Least error of a rejected closure, in metres, with which its images surely show two places."""
_NEAR_M = 3.0
"""Distance along the drive, in metres, within which images show one place, and a closure confirms the course."""
_BROKEN_M = 1e6
_MOST_GROUPS = 20
_LEAST_DEVIATIONS = (0.01, 0.01, 0.005)
_DRIFT_M_PER_M, _DRIFT_RAD_PER_M, _DRIFT_PER_RAD = 0.03, 0.02, 0.01
"""Standard deviations of odometry: of distance and heading per metre driven, and of the angle turned."""


def with_closed_loops(
    observations: Sequence[Observation], matcher: Matcher, config: BuildingConfig, progress: Callable[[float], None]
) -> tuple[Sequence[Observation], OdometryGate]:
    """Return the images with odometry corrected by loop closures, and the odometry gate of the corrected images.

    The images in the matcher's keyframes are corrected, too. `progress` is called with the share that is done.
    """
    keyframes = matcher.keyframes
    if config.odometry_drift:
        separate_contradicted_drives(observations, matcher, config)
    starts = keyframes.odometry_starts
    gate_of = partial(OdometryGate, config=config, drive_starts=starts, resumed=keyframes.resumed_starts)
    if not config.odometry_drift:
        return observations, gate_of(observations)
    closures: tuple[DriveLink, ...] = ()
    false = list[DriveLink]()
    if config.close_loops:
        before = odometry_of(observations)
        closed = ClosureSearch(observations, matcher, gate_of(observations), config, progress).closed()
        observations, closures = closed.observations, closed.closures
        keyframes.correct(observations)
        if closures:
            moved = odometry_of(observations) - before
            errors = odometry_errors(closures, keyframes)
            keyframes.corrections.append(Correction.of("loop closures", moved, errors, count=len(closures)))
        if closed.rejected:
            apart = np.array([link.waypoint for link in closed.rejected])
            errors, count = odometry_errors(closed.rejected, keyframes), len(closed.rejected)
            keyframes.corrections.append(Correction.of(LOOK_ALIKES, apart, errors, count=count))
            apart_m = np.hypot(*errors[:, :2].T) * bool(closures)  # Without any, nothing tells which of them are false.
            false = [closed.rejected[row] for row in np.argsort(-apart_m, kind="stable") if apart_m[row] > _APART_M]
        unsure = closed.deviations[closed.deviations[:, 0] > _UNSURE_M]
        if len(unsure):
            keyframes.corrections.append(Correction.of(UNSURE, unsure, np.empty((0, 3)), count=len(unsure)))
    links = drive_links(observations, starts, matcher, config) if starts else None
    gate = gate_of(observations, links=links, closures=closures)
    if config.close_loops:
        frames = sorted(seen.step for seen in observations)
        keyframes.unsure = _unsure(frames, gate, [*closures, *(links or ())], false)
    return observations, gate


def odometry_errors(links: Sequence[DriveLink], keyframes: KeyframeStore) -> NDArray[np.float64]:
    """Return the errors (N, 3) of the odometry in `keyframes` by links within stretches of it."""
    first = odometry_of([keyframes.observation(link.frame) for link in links])
    second = odometry_of([keyframes.observation(link.other) for link in links])
    return relative(np.array([link.waypoint for link in links]).reshape(-1, 3), relative(first, second))


def _unsure(
    frames: Sequence[FrameId], gate: OdometryGate, closures: Sequence[DriveLink], false: Sequence[DriveLink]
) -> UnsurePlaces | None:
    """Return the way past all images that no closure confirms, and the first of each group of false closures.

    `frames` are in order. None if the robot never moved.
    """
    way_m = gate.along_m + _BROKEN_M * gate.stretch
    is_whole = np.diff(gate.stretch) == 0
    driven_m = float(np.diff(way_m)[is_whole].sum())
    if not driven_m:
        return None
    kept_m, false_m = (
        way_m[gate.rows([frame for link in links for frame in (link.other, link.frame)])] for links in (closures, false)
    )
    is_far = KDTree(kept_m[:, None]).query(way_m[:, None])[0] > _NEAR_M
    ends = np.flatnonzero(np.concatenate([[True], ~(is_far[1:] & is_far[:-1] & is_whole), [True]]))
    open_m = way_m[ends[1:] - 1] - way_m[ends[:-1]]
    longest = int(open_m.argmax())
    groups = _stretch_pairs(false_m.reshape(-1, 2), _NEAR_M)[:_MOST_GROUPS]
    return UnsurePlaces(
        unconfirmed=round(float(open_m.sum()) / driven_m, 3),
        longest=(frames[ends[longest]], frames[ends[longest + 1] - 1]),
        look_alikes=tuple((false[rows[0]].other, false[rows[0]].frame, len(rows)) for rows in groups),
    )


def _stretch_pairs(ends_m: NDArray[np.float64], reach_m: float) -> list[NDArray[np.intp]]:
    """Return the groups of closures (C,) between the same two stretches, the largest first.

    `ends_m` (C, 2) are the distances driven before their images; those of neighbours differ by at most `reach_m`.
    """
    first, second = KDTree(ends_m).query_pairs(reach_m, p=np.inf, output_type="ndarray").T
    near = coo_array((np.ones(len(first)), (first, second)), shape=(len(ends_m), len(ends_m)))
    _, group_of = connected_components(near, directed=False)
    return [np.flatnonzero(group_of == number) for number in np.argsort(-np.bincount(group_of), kind="stable")]


class ClosedDrives(NamedTuple):
    """Images with corrected odometry, and the closures that corrected it."""

    observations: Sequence[Observation]
    closures: tuple[DriveLink, ...] = ()
    rejected: tuple[DriveLink, ...] = ()
    """Pairs of images that look like one place, and are none by the course."""
    deviations: NDArray[np.float64] = np.empty((0, 3))
    """(N, 3) standard deviations of the images, seen from the first of their stretch: of the place in m, 0, and of the
    heading in rad."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosureSearch:
    """Searches for loop closures within the drives of one map."""

    observations: Sequence[Observation]
    matcher: Matcher
    gate: OdometryGate
    config: BuildingConfig
    progress: Callable[[float], None]
    """Called with the share of the images that were compared."""

    def closed(self) -> ClosedDrives:
        """Return the images with corrected odometry; where odometry breaks off, each stretch is corrected by itself."""
        corrected = dict[FrameId, Observation]()
        closures, rejected, unsure = list[DriveLink](), list[DriveLink](), list[NDArray[np.float64]]()
        ordered = sorted(self.observations, key=lambda seen: seen.step)
        for _, images in groupby(zip(self.gate.stretch, ordered, strict=True), key=lambda each: each[0]):
            drive = _KeyImages.of([seen for _, seen in images])
            closed = self._closed_stretch(drive, len(corrected))
            corrected |= {each.step: each for each in closed.observations}
            closures += closed.closures
            rejected += closed.rejected
            unsure.append(drive.deviations(closed))
        moved = [corrected[seen.step] for seen in self.observations]
        return ClosedDrives(moved, tuple(closures), tuple(rejected), np.concatenate(unsure))

    def _closed_stretch(self, drive: "_KeyImages", done: int) -> ClosedDrives:
        """Correct a stretch while searching it, so that later images are compared only with near ones; `done` images
        are in the stretches before."""
        closed = ClosedDrives(drive.stretch)
        gate = OdometryGate(drive.stretch, self.config)
        found, course = list[DriveLink](), None
        for first in range(0, len(drive.rows), _BATCH):
            batch = range(first, min(first + _BATCH, len(drive.rows)))
            fresh = self._found(drive, batch, gate)
            self.progress((done + int(drive.rows[batch[-1]]) + 1) / len(self.observations))
            if fresh:
                found += fresh
                course = drive.course(found)
                closed = drive.corrected(found, course)
                gate = OdometryGate(closed.observations, self.config, closures=closed.closures)
        return closed if course is None else self._judged(drive, found, course)

    def _judged(self, drive: "_KeyImages", found: Sequence[DriveLink], course: OptimisedPoses) -> ClosedDrives:
        """Return the course that the depth images contradict least; odometry as it came if even that one is wrong. If
        it does not fit most closures, or is bent, the search followed a false course, and is made once more."""
        camera = self.matcher.predictor.camera
        height_m = self.matcher.keyframes.needed_space(camera).height_m
        overlay = PassOverlay([drive.stretch[row] for row in drive.rows], drive.driven_m, camera, height_m)
        surest = drive.judgement(found, overlay).surest(course)
        if surest.course is not course:
            found, surest = self._again(drive, found, overlay, surest.course)
        while (straight := drive.judgement(found, overlay).straightened(surest)) is not None:
            log.warning("Loop closures bend odometry in one place; they are searched again without those across it.")
            more, other = self._again(drive, found, overlay, straight)
            if not other.is_surer_than(surest):
                break
            found, surest = more, other
        if surest.contradicted <= TOO_MANY:
            return drive.corrected(found, surest.course)
        log.warning(
            "Places look alike: with the %d loop closures found, %.0f%% of the obstacles seen again lie on floor that "
            "was seen free. None is used; the map rests on odometry. Drive there once more, in another order.",
            len(found),
            100 * surest.contradicted,
        )
        return ClosedDrives(drive.stretch, rejected=tuple(found))

    def _again(
        self, drive: "_KeyImages", found: Sequence[DriveLink], overlay: PassOverlay, course: OptimisedPoses
    ) -> tuple[Sequence[DriveLink], JudgedCourse]:
        """Return the closures with those found along another course, and the surest course with them."""
        closed = drive.corrected(found, course)
        gate = OdometryGate(closed.observations, self.config, closures=closed.closures)
        again = self._found(drive, range(len(drive.rows)), gate)
        found = [*{(link.frame, link.other): link for link in (*found, *again)}.values()]
        return found, drive.judgement(found, overlay).surest(drive.course(found), along=course.poses)

    def _found(self, drive: "_KeyImages", batch: range, gate: OdometryGate) -> list[DriveLink]:
        """Return the loop closures from some key images to those that were taken well before them."""
        earlier = np.searchsorted(drive.driven_m, drive.driven_m - _AGAIN_M)
        found = list[DriveLink]()
        for number in batch:
            near = gate.near_rows(int(drive.rows[number]))
            near = near[np.isin(near, drive.rows[: earlier[number]])]
            frame = drive.stretch[drive.rows[number]].step
            nearby = gate.may_be_near(frame, [drive.stretch[row].step for row in near])
            others = self.matcher.promising(frame, nearby)
            found += surest_links(frame, others, self.matcher, self.config, gate=gate)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _KeyImages:
    """The images of a stretch of driving, and K key images between which closures are searched."""

    stretch: Sequence[Observation]
    odometry: NDArray[np.float64]
    """(N, 3) poses of all images."""
    rows: NDArray[np.intp]
    """(K,) rows of the key images."""
    driven_m: NDArray[np.float64]
    """(K,) distances driven before the key images."""

    @classmethod
    def of(cls, stretch: Sequence[Observation]) -> Self:
        odometry = np.array([seen.odometry for seen in stretch])
        rows = _key_rows(odometry)
        return cls(stretch, odometry, rows, lengths_along(odometry[:, :2])[rows])

    def judgement(self, found: Sequence[DriveLink], overlay: PassOverlay) -> ClosureJudgement:
        """Return the judgement of the closures found between key images."""
        poses = self.odometry[self.rows]
        return ClosureJudgement(poses, _odometry_between(poses), self._closures(found), self.driven_m, overlay)

    def course(self, found: Sequence[DriveLink]) -> OptimisedPoses:
        """Return the course that fits most of the closures found between key images."""
        poses = self.odometry[self.rows]
        return optimise(poses, _odometry_between(poses), self._closures(found))

    def corrected(self, found: Sequence[DriveLink], course: OptimisedPoses) -> ClosedDrives:
        """Return all images along a course of the key images, and the closures that it keeps."""
        moved = _carried(self.odometry, self.rows, course.poses)
        observations = [replace(seen, odometry=pose) for seen, pose in zip(self.stretch, moved, strict=True)]
        kept, rejected = (tuple(compress(found, which)) for which in (course.kept, ~course.kept))
        return ClosedDrives(observations, kept, rejected)

    def deviations(self, closed: ClosedDrives) -> NDArray[np.float64]:
        """Return the deviations (N, 3) of all images along a course, each those of the next key image."""
        if len(self.rows) < 2:
            return np.zeros((len(self.stretch), 3))
        poses = odometry_of([closed.observations[row] for row in self.rows])
        odometry = _odometry_between(self.odometry[self.rows])
        place_m, heading = deviations(poses, odometry, self._closures(closed.closures)).T
        off = np.stack([place_m, np.zeros_like(place_m), np.minimum(heading, np.pi)], axis=-1)
        return off[np.searchsorted(self.rows, np.arange(len(self.stretch)))]

    def _closures(self, found: Sequence[DriveLink]) -> RelativePoses:
        place = {self.stretch[row].step: k for k, row in enumerate(self.rows)}
        first = np.array([place[link.frame] for link in found], np.intp)
        return RelativePoses(
            first=first,
            second=np.array([place[link.other] for link in found], np.intp),
            poses=np.array([link.waypoint for link in found]).reshape(-1, 3),
            deviations=np.tile(_CLOSURE_DEVIATIONS, (len(found), 1)),
            shares=_shares(self.driven_m[first]),
        )


def _shares(driven_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weight of each of K closures, given their position along the drive (K,).

    If an image is mistaken for another place, so are its neighbours. So many nearby closures together have only the
    weight of a few.
    """
    ordered = np.sort(driven_m)
    first = np.searchsorted(ordered, driven_m - _SAME_STRETCH_M, side="right")
    after = np.searchsorted(ordered, driven_m + _SAME_STRETCH_M)
    return np.minimum(1.0, _MOST_IN_STRETCH / (after - first))


def _key_rows(odometry: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows of poses (N, 3) that lie apart from each other, including the first and the last."""
    rows = [0]
    for row in range(1, len(odometry)):
        if distance(relative(odometry[rows[-1]], odometry[row])) >= _KEY_GAP:
            rows.append(row)
    return np.unique([*rows, len(odometry) - 1])


def _odometry_between(poses: NDArray[np.float64]) -> RelativePoses:
    """Return the measurements of odometry between consecutive poses (N, 3)."""
    steps = relative(poses[:-1], poses[1:])
    driven = np.hypot(steps[:, 0], steps[:, 1])
    turned = np.abs(steps[:, 2])
    drift = np.stack(
        [_DRIFT_M_PER_M * driven, _DRIFT_M_PER_M * driven, _DRIFT_RAD_PER_M * driven + _DRIFT_PER_RAD * turned], axis=1
    )
    rows = np.arange(len(steps))
    return RelativePoses(first=rows, second=rows + 1, poses=steps, deviations=drift + _LEAST_DEVIATIONS)


def _carried(odometry: NDArray[np.float64], rows: NDArray[np.intp], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the poses of all images (N, 3), interpolated between the key images at `poses` (K, 3)."""
    before = np.clip(np.searchsorted(rows, np.arange(len(odometry)), side="right") - 1, 0, max(len(rows) - 2, 0))
    after = np.minimum(before + 1, len(rows) - 1)
    ahead = compose(poses[before], relative(odometry[rows[before]], odometry))
    back = compose(poses[after], relative(odometry[rows[after]], odometry))
    span = np.maximum(rows[after] - rows[before], 1)
    share = ((np.arange(len(odometry)) - rows[before]) / span)[:, None]
    gap = relative(ahead, back)
    return compose(ahead, gap * share)
