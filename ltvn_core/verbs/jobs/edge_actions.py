"""Performs the actions of edges where no page asks for them: for a simulated robot, and by a person at the terminal.

Both implement `ltvn_core.navigation.action_performer.ActionPerformer`.
"""

import logging
import threading
from collections.abc import Callable

from ltvn_core.errors import MapError, SceneError
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.types import NodeId

_LOG = logging.getLogger(__name__)


class SimulatedActions:
    """Puts a simulated robot at the target at once, because no simulated lift carries it there."""

    def __init__(self, put_at: Callable[[NodeId], None]) -> None:
        """`put_at` puts the robot at a node; raises MapError or SceneError where that is impossible."""
        self._put_at = put_at
        self._state = ActionState.FAILED

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        """Put the robot at `target`; if it cannot stand there, the action fails."""
        try:
            self._put_at(target)
        except (MapError, SceneError) as error:
            _LOG.warning("%s: the simulated robot cannot stand at node %d: %s", action, target, error)
            self._state = ActionState.FAILED
        else:
            self._state = ActionState.DONE

    def state(self) -> ActionState:
        """Return the state of the action that was begun last."""
        return self._state


class TerminalActions:
    """Asks the person at the terminal to perform the action, and waits for the answer in a thread."""

    def __init__(self, ask: Callable[[str], str] = input) -> None:
        """`ask` prints a question and returns the answer; raises EOFError if nobody can answer."""
        self._ask = ask
        self._state = ActionState.FAILED
        self._thread: threading.Thread | None = None

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        """Ask for an action; a question without an answer from an earlier action stands for this one."""
        self._state = ActionState.PENDING
        if self._thread is not None and self._thread.is_alive():
            _LOG.info("Now: %s (node %d to node %d).", action, source, target)
            return
        question = (
            f"{action} (node {source} to node {target}). Press Enter when it is done, or n and Enter if it failed. "
        )
        self._thread = threading.Thread(target=self._wait, args=(question,), name="action answer", daemon=True)
        self._thread.start()

    def state(self) -> ActionState:
        """Return the state of the action that was begun last."""
        return self._state

    def _wait(self, question: str) -> None:
        try:
            has_failed = self._ask(question).strip().lower().startswith("n")
        except EOFError:
            has_failed = True
        self._state = ActionState.FAILED if has_failed else ActionState.DONE
