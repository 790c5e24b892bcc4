"""`ltvn guard`: forwards only fresh commands to a robot's wheels."""

from dataclasses import dataclass

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class GuardVerb(Verb):
    """Run a watchdog on the robot's own computer, between the driver and the wheels, until interrupted.

    Forwards fresh commands from the profile's guard topic to its command topic, within its limits of speed and
    acceleration. After 0.2 s without commands, or an invalid one, it sends one zero; then the driver must send a stop
    before it may drive again.
    """

    job = "ltvn_core.verbs.jobs.guard:guard_robot"

    robot: Positional[str]
    """PROFILE@ADDRESS, as in turtlebot4@tcp/127.0.0.1:7447."""
    depth_stop: float | None = None
    """Drive forward only while the depth image shows that the way is free up to this distance before the body, in
    metres."""
