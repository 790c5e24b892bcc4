"""`ltvn collect --robot` and `ltvn navigate --robot`: the same jobs with a robot that is not simulated."""

import logging
import time
from contextlib import suppress

import numpy as np

from ltvn_core.composition import open_predictor
from ltvn_core.errors import OptionError
from ltvn_core.navigation.lifelong_run import random_goals
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.recording.recorded_robot import record_images
from ltvn_core.recording.run_description import RunDescription
from ltvn_core.robots.continued_robot import ContinuedRobot
from ltvn_core.robots.open_loop import open_loop_word
from ltvn_core.robots.rectified_robot import fit_camera
from ltvn_core.robots.watched_drive import watch_drive
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.verbs.collect import CollectVerb
from ltvn_core.verbs.jobs.collect import CollectSummary, doubts_of
from ltvn_core.verbs.jobs.robot_queries import RobotQueries, opened_robot, summed_up
from ltvn_core.verbs.jobs.stream import announce_stream
from ltvn_core.verbs.navigate_options import NavigateOptions, NavigateSummary

_LOG = logging.getLogger(__name__)


def collect_with(options: CollectVerb) -> CollectSummary:
    """Record what a robot sees while somebody else drives it, until Ctrl-C or for `options.seconds`.

    A recorded drive that plays the robot ends it, too.
    """
    name = str(options.robot)
    with opened_robot(name, drives=False) as own:
        choice = ImageSource(camera=own.spec.camera).choose()
        robot = fit_camera(own, open_predictor(choice.name, camera=own.spec.camera).camera)
        scene = own.spec.name if options.scene == "demo" else options.scene
        run = RunDescription(
            scene=scene, config={"verb": "collect", "robot": name}, fingerprint="", camera=robot.spec.camera
        )
        begun_s = time.monotonic()
        has_depth: list[bool] = []
        _LOG.info(open_loop_word(own) or "Recording; drive the robot by its own controls. Ctrl-C ends it.")
        with run.open_writer(options.output) as writer:
            most_s = options.seconds or np.inf
            images = watch_drive(robot, lambda: getattr(own, "is_over", False) or time.monotonic() - begun_s >= most_s)
            with suppress(KeyboardInterrupt):
                for image in record_images(images, writer):
                    has_depth.append(image.has_depth)
        return CollectSummary(
            doubts=doubts_of(options.output, has_depth),
            recording=options.output,
            scene=scene,
            frames=len(has_depth),
            without_depth=has_depth.count(False),
            collisions=0,
            driven_s=time.monotonic() - begun_s,
        )


def navigate_with(options: NavigateOptions, name: str) -> NavigateSummary:
    """Drive a robot to goals of a map; "reached" is what the robot itself believes, for nobody knows better."""
    if options.world is not None:
        raise OptionError("--world changes a simulated scene; leave it out with a robot of your own.")
    if options.maintenance in ("truth", "brm-rooms"):
        raise OptionError(f"--maintenance {options.maintenance} asks the simulator; choose another with a robot.")
    started, rng = time.monotonic(), np.random.default_rng(options.seed)
    opened = options.open_map()
    loaded, predictor, predictor_name, system, keyframes = opened
    if options.maintenance is not None:
        system = with_maintenance(system, options.maintenance)
    last = max(loaded.observations.values(), key=lambda each: each.step)
    with opened_robot(name) as own:
        robot = ContinuedRobot(fit_camera(own, predictor.camera), last_step=last.step, last_stamp_s=last.stamp)
        run = RunDescription(
            scene=loaded.meta.scene,
            config={**options.settings(system, predictor_name), "robot": name},
            fingerprint=predictor.fingerprint,
            camera=robot.spec.camera,
            scene_glb=loaded.scene_glb,
        )
        with run.open_writer(options.recording, live_port=announce_stream(options.stream)) as writer:
            writer.write_map(loaded.graph, loaded.observations.values())
            driver = RobotQueries(robot, writer, loaded.graph, keyframes, predictor, system, rng)
            nodes = list(loaded.graph.nodes)
            goals = [options.goal] if options.goal is not None else list(random_goals(nodes, options.queries, rng))
            outcome = summed_up([driver.drive_to(goal, query) for query, goal in enumerate(goals)])
    return options.finish(opened, run, outcome, time.monotonic() - started)
