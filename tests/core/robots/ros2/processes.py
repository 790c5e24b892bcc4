"""Starts programs of the toolkit as processes of their own, on a free port of this machine."""

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from tests.repository import ROOT
from tests.waiting import PATIENCE_S


def free_address() -> str:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


class Program:
    """A running verb, and what it said."""

    def __init__(self, module: str, verb: str, *options: str) -> None:
        code = (
            f"from {module} import {verb}; from ltvn_core.cli import run_verb; raise SystemExit(run_verb('', {verb}))"
        )
        self.process = subprocess.Popen(
            [sys.executable, "-c", code, *options],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        self.said = ""
        self._grew = threading.Condition()
        self.listener = threading.Thread(target=self._listen)
        self.listener.start()

    def wait_until_it_says(self, words: str) -> None:
        with self._grew:
            heard = self._grew.wait_for(lambda: words in self.said or self.process.poll() is not None, PATIENCE_S)
        assert heard, self.said
        assert words in self.said, self.said

    def _listen(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            for line in lines:
                with self._grew:
                    self.said += line
                    self._grew.notify_all()
        self.process.wait()
        with self._grew:
            self._grew.notify_all()


@contextmanager
def running(module: str, verb: str, *options: str, ready: str) -> Iterator[Program]:
    program = Program(module, verb, *options)
    try:
        program.wait_until_it_says(ready)
        yield program
    finally:
        program.process.kill()
        program.listener.join()


def serving(address: str, *options: str) -> AbstractContextManager[Program]:
    return running(
        "ltvn_core.verbs.serve", "ServeVerb", "--scene", "apartment-57", "--listen", address, *options, ready="Serving"
    )
