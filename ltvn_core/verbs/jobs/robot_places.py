"""`ltvn robot check --map`: where in a map a robot stands, or the images of a recorded drive were taken."""

from collections.abc import Iterable
from pathlib import Path

from ltvn_core.errors import MapError
from ltvn_core.importing.named_drive import NamedDrive
from ltvn_core.importing.played_drive import play_drive
from ltvn_core.navigation.passive_localisation import PassiveLocaliser
from ltvn_core.robots.rectified_robot import fit_camera
from ltvn_core.robots.robot import Robot, WallClock
from ltvn_core.robots.robot_report import PlaceSeen, PlacesReport
from ltvn_core.robots.watched_drive import watch_drive
from ltvn_core.topological_map import TopologicalMap
from ltvn_core.types import Observation


def place_of_robot(robot: Robot, path: Path) -> PlacesReport:
    """Say where in the map of a file a robot stands. Raises RobotError, MapError and RecordingError."""
    known = _opened(path)
    return _places(known, [fit_camera(robot, known.predictor.camera).observe()])


def places_of_drive(drive: NamedDrive, path: Path) -> PlacesReport:
    """Say where in the map of a file a recorded drive led, every 12 cm or 10 degrees, as fast as that goes.

    Raises DriveError, MapError and RecordingError.
    """
    known, time = _opened(path), _HurriedTime()
    played = play_drive(drive, WallClock(time.now, time.pass_by))
    played.observe()  # Its time begins at the second look.
    images = watch_drive(fit_camera(played, known.predictor.camera), lambda: played.is_over)
    return _places(known, images)


class _HurriedTime:
    """Time in which nobody waits."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now(self) -> float:
        return self._now_s

    def pass_by(self, duration_s: float) -> None:
        self._now_s += duration_s


def _opened(path: Path) -> TopologicalMap:
    known = TopologicalMap.load(path, with_reserve=False)
    if not known.graph.nodes:
        raise MapError(f"The map of {path} is empty, so nobody can be anywhere in it.")
    return known


def _places(known: TopologicalMap, images: Iterable[Observation]) -> PlacesReport:
    localiser = PassiveLocaliser(known.graph, known.keyframes, known.predictor, known.system)
    places = []
    for seen in images:
        found = localiser.localise(seen)
        if found is None:
            places.append(PlaceSeen(seen.stamp, None, 0.0))
        else:
            places.append(PlaceSeen(seen.stamp, found.node, found.reachability))
    return PlacesReport(tuple(places))
