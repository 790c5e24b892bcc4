"""`ltvn demo --robot`: a robot of ROS 2, each of its parts a process, and the page that drives it."""

import logging

from ltvn_core.errors import OptionError
from ltvn_core.recording.demo_files import DEMO_MAP, demo_file
from ltvn_core.verbs.verb import Summary
from ltvn_viz.session.options import DEMO_SCENE
from ltvn_viz.verbs.app import AppVerb
from ltvn_viz.verbs.demo import DemoVerb
from ltvn_viz.verbs.jobs.robot_processes import robot_processes

_LOG = logging.getLogger(__name__)


def drive_robot(options: DemoVerb) -> Summary:
    """Start a robot of ROS 2 and the page that drives it; in the demo apartment with its ready-made map."""
    if options.headless or options.story:
        raise OptionError("--robot is for the page; leave --headless and --story out.")
    _LOG.info("Starting a router, the simulated robot and its guard…")
    with robot_processes(options.scene, "--seed", str(options.seed), "--body", options.body) as robot:
        _LOG.info("For other programs of ROS 2 the robot is at %s.", robot.address)
        page = AppVerb(
            port=options.port,
            robot=robot.place,
            map=demo_file(DEMO_MAP) if options.scene == DEMO_SCENE else None,
            seed=options.seed,
            predictor=options.predictor,
            weights=options.weights,
            stream=options.stream,
        )
        return page.run()
