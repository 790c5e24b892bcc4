"""What the robot sees now: one picture per control step, encoded at most once, compared with nodes on demand.

Owns the current picture. Draws no conclusion.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from ltvn_core.geometry import distance, relative
from ltvn_core.graph.closures import Stretch
from ltvn_core.graph.matching import Matcher
from ltvn_core.nav.body import Body
from ltvn_core.nav.trail import Trail
from ltvn_core.types import Features, NodeId, Observation, Pose, Predictor, Waypoint


class Sight(NamedTuple):
    """A node as seen from here."""

    reachability: float
    distance: float
    """d(w), Eq. 2."""
    waypoint: Waypoint
    """(3,): the node in the robot's frame."""

    def aimed(self, waypoint: Waypoint) -> "Sight":
        """Return the same sight with a better waypoint."""
        return self._replace(waypoint=waypoint, distance=float(distance(waypoint)))


class Eyes:
    """Looks through the robot's camera."""

    def __init__(
        self, body: Body, predictor: Predictor, matcher: Matcher, on_look: Callable[[Observation], None]
    ) -> None:
        """Look from `body`; every new picture goes to `on_look`."""
        self._body = body
        self._predictor = predictor
        self._matcher = matcher
        self._on_look = on_look
        self.trail = Trail()
        """What was looked at on the way, as far as it was encoded."""
        self._at_step = -1
        self._observation: Observation | None = None
        self._features: Features | None = None
        self._sights: dict[NodeId, Sight] = {}

    @property
    def observation(self) -> Observation:
        """The current picture, a new one if the robot has moved since the last."""
        if self._observation is None or self._at_step != self._body.steps:
            self._observation, self._at_step = self._body.look(), self._body.steps
            self._features, self._sights = None, {}
            self._on_look(self._observation)
        return self._observation

    @property
    def features(self) -> Features:
        """(1, F) of the current picture."""
        seen = self.observation
        if self._features is None:
            self._features = self._predictor.encode([seen])
            self.trail.saw(seen.odometry, self._features)
        return self._features

    @property
    def way_here(self) -> Stretch | None:
        """What was seen on the way, as it lies from where the robot is now."""
        return self.trail.seen_from(self._body.odometry)

    def sight(self, node: NodeId) -> Sight:
        """Compare the current picture with a node."""
        image = self.features  # First, because a new picture forgets what the last one showed.
        if node not in self._sights:
            found = self._matcher.match(image, (node,))
            self._sights[node] = Sight(float(found.reachability[0]), float(found.distances[0]), found.waypoints[0])
        return self._sights[node]

    def images_around(self, node: NodeId, reach: int) -> Iterator[tuple[Observation, Pose]]:
        """Yield the image of a node and those of the drive before and after it, with the poses (3,) seen from it."""
        views = self._matcher.views
        odometry = views.observation(node).odometry
        for frame in (node, *views.around(node, reach)):
            image = views.observation(frame)
            yield image, relative(odometry, image.odometry)

    def witnessed(self, node: NodeId) -> Sight:
        """Compare the current picture with a node, trusting r only as far as the node's neighbours in time agree."""
        found = self._matcher.match(self.features, (node,))
        return self.sight(node)._replace(
            reachability=float(self._matcher.witnessed(found, self.features).reachability[0])
        )
