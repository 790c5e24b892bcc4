"""`ltvn serve`: the simulated robot as a robot of ROS 2, in real time."""

from dataclasses import dataclass

from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class ServeVerb(Verb):
    """Show the simulated robot as one of ROS 2, until interrupted: images and odometry out, velocities in."""

    job = "ltvn_core.verbs.jobs.serve:serve_robot"

    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    profile: str = "sim"
    """Profile with the robot's topics, size and limits: locobot, nav2, sim, stretch, turtlebot4, or a TOML file."""
    listen: str = ""
    """Be the router at this address; tcp/127.0.0.1:7447 by default, and port 0 takes any free one."""
    connect: str = ""
    """Join through the router at this address instead."""
    width: int = 96
    """Columns of its images; three quarters as many rows."""
    world: str | None = None
    """Change the scene over time: static, doors, daily, moving, light, people, ..., or a JSON file."""
    start: tuple[float, float, float] | None = None
    """Where it stands first: x and y in metres of the scene, and degrees from the x axis; else drawn by --seed."""
    seed: int = 0
    """Draws the start, the odometry noise and what changes in the world."""
    body: BodyOption = "auto"
