"""`ltvn guard`: lets only fresh commands through to a robot's wheels."""

from dataclasses import dataclass

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class GuardVerb(Verb):
    """Stand between whoever drives and a robot's wheels, on the robot's own computer, until interrupted.

    Forwards fresh commands from the profile's guard topic to its command topic, within its limits of speed and
    acceleration. On silence of 0.2 s it sends one zero, and then wants a stop before it lets anybody drive again.
    """

    job = "ltvn_core.verbs.jobs.guard:guard_robot"

    robot: Positional[str]
    """PROFILE@ADDRESS, as in turtlebot4@tcp/127.0.0.1:7447."""
    depth_stop: float | None = None
    """Refuse to drive forward where the depth image shows an obstacle within this many metres before the body, or
    nothing."""
