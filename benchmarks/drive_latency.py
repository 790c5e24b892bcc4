"""How long a key press takes from the page's socket to the robot's drive command, or to the wheels of a robot of ROS 2
behind router and guard; part of `python -m benchmarks`.

Owns the measuring page: a plain websocket that says what a browser would. Everything behind it is the app's own.
"""

import json
import queue
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from benchmarks.measurement import Measurement, measured
from ltvn_core.robots.ros2.profile import open_profile
from ltvn_core.robots.ros2.ros_messages import read_twist
from ltvn_core.robots.ros2.topic_keys import Topic, command_type
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import Twist
from ltvn_viz.app import AppOptions, RunningApp, open_app
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.session.live_run import LiveRobot
from ltvn_viz.session.options import DEMO_SCENE
from ltvn_viz.verbs.robot_processes import PROFILE, robot_processes

PRESSES = 60
NODES, EDGES = 10_000, 50_000
RECOLOUR_S = 0.2
_GUARD_RESTS_S = 0.7
"""Time in seconds between presses; a guard that has sent its zero wants a stop first."""


def key_to_command() -> list[Measurement]:
    """Press and let go many times on the demo apartment, idle and while a large map changes its colours."""
    with tempfile.TemporaryDirectory() as folder, _running(_demo(Path(folder))) as app:
        with _keyboard(app) as keyboard:
            idle = keyboard.latencies_ms()
        with _recolouring(app.server), _keyboard(app) as keyboard:
            loaded = keyboard.latencies_ms()
    return [
        measured("key to robot command, 95th percentile, idle", float(np.percentile(idle, 95)), "ms", at_most=10),
        measured(
            f"key to robot command, 95th percentile, {NODES:,} nodes and {EDGES:,} edges recoloured at 5 Hz",
            float(np.percentile(loaded, 95)),
            "ms",
            at_most=40,
        ),
    ]


def key_to_wheel() -> list[Measurement]:
    """Press and let go many times, with page, router, guard and robot in processes of their own."""
    heard: queue.Queue[float] = queue.Queue()

    def take(received: Received) -> None:
        if read_twist(received.message, "benchmark").linear_m_s:
            heard.put(time.monotonic())

    profile = open_profile(PROFILE)
    command = Topic(profile.topics.command, command_type(stamped=profile.driving.stamped), profile.domain)
    with (
        tempfile.TemporaryDirectory() as folder,
        robot_processes(DEMO_SCENE) as processes,
        ZenohLink.connect(processes.address, node="benchmark") as link,
        _running(AppOptions(port=0, robot=processes.place, recordings=Path(folder))) as app,
        page_socket(app.server, "/drive") as socket,
    ):
        link.subscribe(command, take, lambda _: None)
        keyboard = _Keyboard(socket, heard, rests_s=_GUARD_RESTS_S)
        keyboard.latencies_ms(3)  # The first command opens the connections between the processes.
        took_ms = keyboard.latencies_ms()
    name = "key to the wheels of a robot of ROS 2, through page, router and guard, 95th percentile"
    return [measured(name, float(np.percentile(took_ms, 95)), "ms", at_most=60)]


class _Keyboard:
    """A page that holds one key and watches when the robot hears of it."""

    def __init__(self, socket: Connection, commands: "queue.Queue[float]", *, rests_s: float = 0.05) -> None:
        self._socket, self._commands = socket, commands
        self._rests_s = rests_s
        self._epoch = int(json.loads(socket.recv(timeout=10))["epoch"])
        # Pings of the server are answered only while messages are read.
        threading.Thread(target=lambda: [None for _ in socket], name="page", daemon=True).start()

    def latencies_ms(self, presses: int = PRESSES) -> list[float]:
        return [self._press() for _ in range(presses)]

    def _press(self) -> float:
        self._say()
        time.sleep(self._rests_s)  # A person, too, lets go for a moment.
        while not self._commands.empty():
            self._commands.get_nowait()
        pressed = time.monotonic()
        self._say("forward")
        heard = self._commands.get(timeout=10)
        self._say()
        return 1e3 * (heard - pressed)

    def _say(self, *held: str) -> None:
        message = {"type": "drive", "held": held, "stick": [0, 0], "slow": False, "epoch": self._epoch, "age": 0}
        self._socket.send(json.dumps(message))


class _DriveSpy:
    """Wraps a robot and notes when it is told to drive."""

    def __init__(self, robot: LiveRobot, commands: "queue.Queue[float]") -> None:
        self._robot, self._commands = robot, commands

    def __getattr__(self, name: str) -> object:
        return getattr(self._robot, name)

    def drive(self, twist: Twist) -> None:
        self._commands.put(time.monotonic())
        self._robot.drive(twist)


def _demo(folder: Path) -> AppOptions:
    return AppOptions(port=0, predictor="oracle", recordings=folder)


@contextmanager
def _running(options: AppOptions) -> Iterator[RunningApp]:
    with open_app(options) as app:
        thread = threading.Thread(target=app.session.run, name="session")
        thread.start()
        try:
            yield app
        finally:
            app.session.stop()
            thread.join()


@contextmanager
def _keyboard(app: RunningApp) -> Iterator[_Keyboard]:
    commands: queue.Queue[float] = queue.Queue()
    live = app.session.state.live
    robot = live.robot
    live.robot = _DriveSpy(robot, commands)  # type: ignore[assignment]
    try:
        with page_socket(app.server, "/drive") as socket:
            yield _Keyboard(socket, commands)
    finally:
        live.robot = robot


@contextmanager
def _recolouring(server: GuardedServer) -> Iterator[None]:
    """Change the colours of a large map five times a second, with a page that receives them."""
    rng = np.random.default_rng(0)
    nodes = server.scene.add_point_cloud(
        "/bench/nodes", rng.uniform(-9, 9, (NODES, 3)).astype(np.float32), colors=np.zeros((NODES, 3), np.uint8)
    )
    edges = server.scene.add_line_segments(
        "/bench/edges", np.zeros((EDGES, 2, 3), np.float32), colors=np.zeros((EDGES, 2, 3), np.uint8)
    )
    done = threading.Event()

    def recolour() -> None:
        shade = 0
        while not done.wait(RECOLOUR_S):
            shade = (shade + 7) % 256
            nodes.colors = np.full((NODES, 3), shade, np.uint8)
            edges.colors = np.full((EDGES, 2, 3), shade, np.uint8)

    with page_socket(server, "/", "viser-v1.1.1") as page:
        threads = [
            threading.Thread(target=recolour, name="recolour"),
            threading.Thread(target=lambda: [None for _ in page], name="page"),
        ]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            done.set()
            page.close()
            for thread in threads:
                thread.join()


def page_socket(server: GuardedServer, path: str, protocol: str | None = None) -> Connection:
    """Open a socket as the page would, and show the token on it."""
    socket = connect(
        f"ws://{server.host}:{server.port}{path}",
        origin=f"http://{server.host}:{server.port}",  # type: ignore[arg-type]
        subprotocols=None if protocol is None else [protocol],  # type: ignore[list-item]
        max_size=None,
    )
    shown = {"type": "proof", "token": server.token}
    socket.send(json.dumps(shown) if protocol is None else msgspec.msgpack.encode(shown))
    return socket
