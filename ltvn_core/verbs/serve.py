"""`ltvn serve`: offers the simulated robot as a robot of ROS 2, in real time."""

from dataclasses import dataclass

from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class ServeVerb(Verb):
    """Offer the simulated robot as a robot of ROS 2, until interrupted: it publishes images and odometry, and obeys
    velocity commands."""

    job = "ltvn_core.verbs.jobs.serve:serve_robot"

    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    profile: str = "sim"
    """Profile with the robot's topics, size and limits: locobot, nav2, sim, stretch, turtlebot4, or a TOML file."""
    listen: str = ""
    """Act as the router at this address; tcp/127.0.0.1:7447 by default. Port 0 chooses any free port."""
    connect: str = ""
    """Connect to the router at this address instead."""
    width: int = 96
    """Width of the images in pixels; the height is three quarters of it."""
    world: str | None = None
    """Change the scene over time: static, doors, daily, moving, light, people, ..., or a JSON file."""
    start: tuple[float, float, float] | None = None
    """First pose: x and y in metres of the scene, and the angle from the x axis in degrees; by default drawn by
    --seed."""
    seed: int = 0
    """Seed of the start, the odometry noise and the changes of the world."""
    body: BodyOption = "auto"
