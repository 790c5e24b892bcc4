"""What `ltvn collect` is asked and what it answers, for simulated and for other robots."""

import logging
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.errors import SceneError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.verb import Verb

log = logging.getLogger(__name__)

MANY_WITHOUT_DEPTH = 0.3
"""Share of images without depth that is doubtful; in a house that is open to one side it is about a tenth."""


@dataclass(frozen=True)
class CollectSummary(WithDoubts):
    """What a tour brought home."""

    recording: Path
    scene: str
    frames: int
    without_depth: int
    """Frames in which the camera found no depth at all; they are kept, and a map is built without them."""
    collisions: int
    driven_s: float
    """Robot time."""
    findings: tuple[Finding, ...] = ()
    """What is doubtful of the drive; nothing where all is well."""


@dataclass(frozen=True, kw_only=True)
class CollectOptions(Verb):
    """Drive a scripted tour through a scene, as a person mapping it would, and record it."""

    output: Path
    """The recording to write; must not exist yet."""
    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    loops: int = 2
    """How often the tour goes round."""
    seed: int = 0
    """Draws the start, the order of rooms and the odometry noise."""
    distance_noise: float = 0.02
    """Standard deviation of odometry's error in distance, as a share of it,"""
    angle_noise: float = 0.01
    """and in angle."""
    body: BodyOption = "auto"
    robot: str | None = None
    """Record what a robot of your own sees while you drive it by its own controls: an installed robot's name,
    path/to/file.py:factory, or PROFILE@ADDRESS (ROS 2)."""
    seconds: float = 0.0
    """With --robot: end after so long; 0 is until Ctrl-C."""


def depth_findings(recording: Path, has_depth: list[bool]) -> tuple[Finding, ...]:
    """Return, and log, that many images show nothing. Raises SceneError where none does."""
    share = has_depth.count(False) / len(has_depth)
    if share == 1.0:
        raise SceneError(
            f"None of the {len(has_depth)} images in {recording} shows anything within reach of the depth camera; is "
            "the scene a mesh of rooms, the right way up?"
        )
    if share < MANY_WITHOUT_DEPTH:
        return ()
    text = f"{share:.0%} of the images have no depth; is the scene open on all sides, or the wrong way up?"
    log.warning(text)
    return (Finding(text),)
