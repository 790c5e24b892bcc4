"""A simulated ROS 2 robot for `ltvn demo --robot`, with each of its parts in its own process."""

import multiprocessing
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.process import BaseProcess

from ltvn_core.cli import run_verb
from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.profile import open_profile
from ltvn_core.robots.ros2.zenoh_link import ZenohLink, check_address
from ltvn_core.verbs.guard import GuardVerb
from ltvn_core.verbs.serve import ServeVerb
from ltvn_core.verbs.verb import Verb

PROFILE = "sim_guarded"
_PATIENCE_S = 120.0
_END_S = 10.0
_LOOK_S = 0.1


@dataclass(frozen=True)
class RobotProcesses:
    """The processes of a robot; each may be stopped, suspended or killed separately."""

    address: str
    """Address at which the router listens."""
    router: BaseProcess
    robot: BaseProcess
    guard: BaseProcess

    @property
    def place(self) -> str:
        """The value for `--robot`."""
        return f"{PROFILE}@{self.address}"


@contextmanager
def robot_processes(scene: str, *options: str) -> Iterator[RobotProcesses]:
    """Start all processes at a free port of this machine, with `options` for `ltvn serve`, and end them on exit.

    Raises RobotError if a process ends at once or does not come up.
    """
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    started: list[BaseProcess] = []
    try:
        router = start_router(address)
        started.append(router)
        robot = _start(ServeVerb, ("--scene", scene, "--connect", address, *options))
        started.append(robot)
        guard = start_guard(f"{PROFILE}@{address}")
        started.append(guard)
        _wait_for_all(address, started)
        yield RobotProcesses(address, router, robot, guard)
    finally:
        _end(started)


def start_router(address: str) -> BaseProcess:
    """Start a router at an address, and wait until it answers. Raises RobotError."""
    router = _process(_route, (address,))
    _, host, port = check_address(address)
    _until(lambda: _answers(host, port), [router], f"No router started at {address}.")
    return router


def start_guard(place: str) -> BaseProcess:
    """Start the guard of PROFILE@ADDRESS."""
    return _start(GuardVerb, (place,))


def _start(verb: type[Verb], options: Sequence[str]) -> BaseProcess:
    return _process(_run, (verb, options))


def _process(target: Callable[..., None], arguments: tuple[object, ...]) -> BaseProcess:
    # Spawned, because threads of Zenoh and torch do not survive a fork.
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments)
    with _ctrl_c_kept():
        process.start()
    return process


@contextmanager
def _ctrl_c_kept() -> Iterator[None]:
    """Protect processes started in this context from Ctrl-C, so that their parent ends them in the right order."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python allows only the main thread to set signal handlers.
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _wait_for_all(address: str, processes: Sequence[BaseProcess]) -> None:
    topics = open_profile(PROFILE).topics
    with ZenohLink.connect(address, node="ltvn_demo") as link:
        for topic in (topics.depth, topics.command):
            _until(lambda topic=topic: link.publishers(topic), processes, f"Nobody publishes {topic}.")


def _until(ask: Callable[[], object], processes: Sequence[BaseProcess], failure: str) -> None:
    ends_s = time.monotonic() + _PATIENCE_S
    while not ask():
        if time.monotonic() > ends_s or any(each.exitcode is not None for each in processes):
            raise RobotError(f"The robot did not start: {failure} The lines above say why.")
        time.sleep(_LOOK_S)


def _answers(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError:
        return False
    return True


def _end(processes: Sequence[BaseProcess]) -> None:
    """End the processes in reverse order, so that the guard's zero velocity still reaches the robot."""
    for each in reversed(processes):
        each.terminate()
        each.join(_END_S)
        if each.exitcode is None:
            each.kill()
            each.join()


def _run(verb: type[Verb], options: Sequence[str]) -> None:
    _end_with_parent()
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  (hides the summary of the verb)
    sys.exit(run_verb("ltvn", verb, options))


def _route(address: str) -> None:
    _end_with_parent()
    with ZenohLink.listen(address, node="ltvn_router"):
        threading.Event().wait()  # Until a signal ends the process; Windows has no `signal.pause`.


def _end_with_parent() -> None:
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
