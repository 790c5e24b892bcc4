"""Drive a robot of your own in the page: `ltvn app --robot examples/05_drive_your_own_robot.py:make_robot`.

This one only pretends, in a room of six coloured planes. Put your motors and camera behind the same four methods.
"""

import threading

import numpy as np

import ltvn_core as ltvn

ROOM_M = np.array([[0.0, 0.0, 0.0], [6.0, 4.0, 2.5]])
WALLPAPER = np.random.default_rng(5).integers(0, 255, (3, 2, 13, 13, 3), np.uint8)
CAMERA = ltvn.CameraModel.from_fov(160, 120, np.deg2rad(80), height_m=0.6)


class RoomRobot:
    """Implements `ltvn_core.Robot`."""

    spec = ltvn.RobotSpec(name="room robot", radius_m=0.2, height_m=0.7, ground_clearance_m=0.02, camera=CAMERA)

    def __init__(self) -> None:
        self.clock = ltvn.WallClock()
        self._lease = ltvn.DriveLease(self.clock.now, limits=self.spec.speeds)
        self._pose, self._bumped = np.array([2.0, 2.0, 0.0]), False
        threading.Thread(target=self._turn_wheels, daemon=True).start()

    def drive(self, twist: ltvn.Twist) -> None:
        self._lease.grant(twist)

    def stop(self) -> None:
        self._lease.cancel()

    def state(self) -> ltvn.RobotState:
        return ltvn.RobotState(self._pose, self.clock.now(), int(10 * self.clock.now()), self._bumped)

    def observe(self) -> ltvn.Observation:
        state = self.state()
        eye, cos, sin = np.array([*state.odometry[:2], 0.6]), np.cos(state.odometry[2]), np.sin(state.odometry[2])
        rays = (CAMERA.unproject_image(np.ones((120, 160))) - [0, 0, 0.6]) @ [[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]
        depth = (np.where(rays > 0, ROOM_M[1], ROOM_M[0]) - eye) / np.where(rays == 0, 1e-9, rays)
        axis = depth.argmin(axis=1)  # The plane that each ray meets first.
        tile = (2 * (eye + rays * depth.min(axis=1, keepdims=True)) + 0.5).astype(int)
        column, row = np.where(axis == 0, tile[:, 1], tile[:, 0]), np.where(axis == 2, tile[:, 1], tile[:, 2])
        rgb = WALLPAPER[axis, (rays[np.arange(len(rays)), axis] > 0).astype(int), column, row]
        metres = depth.min(axis=1).reshape(120, 160)
        return ltvn.Observation(rgb.reshape(120, 160, 3), metres, state.odometry, state.stamp, state.step)

    def _turn_wheels(self) -> None:
        while True:
            self.clock.advance(0.02)
            speed, turn = self._lease.command()
            wanted = ltvn.compose(self._pose, np.array([0.02 * speed, 0.0, 0.02 * turn]))
            free = np.clip(wanted[:2], ROOM_M[0, :2] + 0.2, ROOM_M[1, :2] - 0.2)
            self._pose, self._bumped = np.array([*free, wanted[2]]), bool(np.any(free != wanted[:2]))


make_robot = RoomRobot
