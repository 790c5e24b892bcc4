"""`ltvn collect`: a scripted tour of a scene becomes a recording."""

from dataclasses import asdict, dataclass

from ltvn_core.errors import OptionError
from ltvn_core.findings import findings_of
from ltvn_core.verbs.collect_options import CollectOptions, CollectSummary, depth_findings
from ltvn_core.verbs.verb import Summary


@dataclass(frozen=True, kw_only=True)
class CollectVerb(CollectOptions):
    """Drive a scripted tour through a scene, as a person mapping it would, and record it."""

    def run(self) -> Summary:
        """Tour the scene; raises OptionError, SceneError and RecordingError."""
        if self.robot is not None:
            from ltvn_core.verbs.own_robot import collect_with

            return collect_with(self, self.robot)
        if self.loops < 1:
            raise OptionError(f"--loops must be 1 or more, got {self.loops}.")
        if not (0 <= self.distance_noise < 1 and 0 <= self.angle_noise < 1):
            raise OptionError(
                "--distance-noise and --angle-noise are shares from 0 to below 1; 0.05 is a bad odometer."
            )
        import numpy as np
        from tqdm import tqdm

        from ltvn_core.recording.recorded_robot import record_images
        from ltvn_core.recording.writer import RecordingWriter
        from ltvn_core.simulation.body_selection import choose_body
        from ltvn_core.simulation.opening import open_simulation
        from ltvn_core.simulation.scripted_tour import drive_tour
        from ltvn_core.simulation.wheel_odometry import OdometryNoise

        noise = OdometryNoise(self.distance_noise, self.angle_noise)
        simulation = open_simulation(self.scene, seed=self.seed, odometry_noise=noise, body=self.body)
        robot = simulation.robot
        settings = {
            "verb": "collect",
            "loops": self.loops,
            "seed": self.seed,
            "odometry_noise": asdict(noise),
            "body": choose_body(self.body),
        }
        with RecordingWriter(
            self.output,
            scene=simulation.scene.address,
            config=settings,
            fingerprint="",
            scene_glb=simulation.scene.glb(),
        ) as writer:
            rng = np.random.default_rng(self.seed)
            images = record_images(drive_tour(robot, simulation.scene, rng, loops=self.loops), writer)
            has_depth = [image.has_depth for image in tqdm(images, desc="collect", unit="frame")]
        return CollectSummary(
            findings=(*findings_of(simulation.scene.doubts), *depth_findings(self.output, has_depth)),
            recording=self.output,
            scene=simulation.scene.name,
            frames=len(has_depth),
            without_depth=has_depth.count(False),
            collisions=robot.collisions,
            driven_s=robot.stamp,
        )
