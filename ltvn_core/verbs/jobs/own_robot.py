"""`ltvn collect --robot` and `ltvn navigate --robot`: the same jobs with a robot outside the simulator."""

import logging
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ltvn_core.data.recording.recorded_run import RunDescription, record_images
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_run import random_goals
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot import open_loop_word
from ltvn_core.robots.robot_view import fit_camera, watch_drive
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.verbs.collect import CollectVerb
from ltvn_core.verbs.jobs.collect import CollectSummary, depth_findings
from ltvn_core.verbs.jobs.robot_queries import QueriesSummary, RobotQueries, continued_robot, opened_robot
from ltvn_core.verbs.jobs.stream import announce_stream
from ltvn_core.verbs.navigate import NavigateOptions, NavigateSummary

_LOG = logging.getLogger(__name__)


def collect_with(options: CollectVerb) -> CollectSummary:
    """Record the images of a robot while somebody else drives it, until Ctrl-C or for `options.seconds`.

    A recorded drive that is played as a robot also ends the recording.
    """
    name = str(options.robot)
    with opened_robot(name, drives=False) as own:
        choice = ImageSource(camera=own.spec.camera).choose()
        robot = fit_camera(own, open_predictor(choice.name, camera=own.spec.camera).camera)
        scene = own.spec.name if options.scene == "demo" else options.scene
        run = RunDescription(
            scene=scene,
            config={"verb": "collect", "robot": name, **own.spec.needed_space.to_config()},
            fingerprint="",
            camera=robot.spec.camera,
        )
        begun_s = time.monotonic()
        has_depth: list[bool] = []
        _LOG.info(open_loop_word(own) or "Recording; drive the robot with its own controls. Ctrl-C ends the recording.")
        with run.open_writer(options.output) as writer:
            most_s = options.seconds or np.inf
            images = watch_drive(robot, lambda: getattr(own, "is_over", False) or time.monotonic() - begun_s >= most_s)
            with suppress(KeyboardInterrupt):
                for image in record_images(images, writer):
                    has_depth.append(image.has_depth)
        return CollectSummary(
            findings=depth_findings(options.output, has_depth),
            recording=options.output,
            scene=scene,
            frames=len(has_depth),
            without_depth=has_depth.count(False),
            collisions=0,
            driven_s=time.monotonic() - begun_s,
        )


def navigate_with(options: NavigateOptions, name: str) -> NavigateSummary:
    """Drive a robot to goals of a map; "reached" is the robot's own belief, because the truth is unknown."""
    if options.world is not None:
        raise OptionError("--world changes a simulated scene; omit it with your own robot.")
    if options.maintenance in ("truth", "brm-rooms"):
        raise OptionError(
            f"--maintenance {options.maintenance} needs the simulator; choose another one with your own robot."
        )
    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    known = options.open_map()
    if options.maintenance is not None:
        known = replace(known, system=with_maintenance(known.system, options.maintenance))
    with opened_robot(name) as own:
        robot = continued_robot(own, known)
        run = RunDescription(
            scene=known.scene,
            config={**options.settings(known), "robot": name, **own.spec.needed_space.to_config()},
            fingerprint=known.predictor.fingerprint,
            camera=robot.spec.camera,
            scene_glb=known.scene_glb,
        )
        with run.open_writer(options.recording, live_port=announce_stream(options.stream)) as writer:
            writer.write_map(known.graph, known.observations)
            driver = RobotQueries(robot, writer, known, rng)
            nodes = list(known.graph.nodes)
            goals = [options.goal] if options.goal is not None else list(random_goals(nodes, options.queries, rng))
            outcome = QueriesSummary.of([driver.drive_to(goal, query) for query, goal in enumerate(goals)])
    return options.finish(known, run, outcome, time.monotonic() - started)
