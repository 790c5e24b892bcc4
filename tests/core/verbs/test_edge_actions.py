"""Actions of edges in `ltvn navigate`: a simulated robot is put at the target, a person answers at the terminal."""

from queue import Queue

import pytest

from ltvn_core.errors import SceneError
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.types import NodeId
from ltvn_core.verbs.headless_runner import SimulatedActions
from ltvn_core.verbs.robot_queries import TerminalActions
from tests.waiting import until

LIFT = "Take the lift to floor 2"


def test_a_simulated_robot_is_put_at_the_target_and_the_action_is_done() -> None:
    put: list[NodeId] = []
    actions = SimulatedActions(put.append)
    actions.begin(3, 7, LIFT)
    assert put == [7]
    assert actions.state() is ActionState.DONE


def test_an_action_fails_where_a_simulated_robot_cannot_stand(caplog: pytest.LogCaptureFixture) -> None:
    def put_at(_node: NodeId) -> None:
        raise SceneError("it lies inside an obstacle")

    actions = SimulatedActions(put_at)
    actions.begin(3, 7, LIFT)
    assert actions.state() is ActionState.FAILED
    assert "obstacle" in caplog.text


@pytest.mark.parametrize(("answer", "state"), [("", ActionState.DONE), (" N\n", ActionState.FAILED)])
def test_the_robot_waits_until_the_person_has_answered(answer: str, state: ActionState) -> None:
    asked: Queue[str] = Queue()
    answers: Queue[str] = Queue()

    def ask(question: str) -> str:
        asked.put(question)
        return answers.get()

    actions = TerminalActions(ask)
    actions.begin(3, 7, LIFT)
    assert LIFT in asked.get()
    assert actions.state() is ActionState.PENDING
    answers.put(answer)
    until(lambda: actions.state() is state)


def test_an_action_fails_where_nobody_can_answer() -> None:
    def ask(_question: str) -> str:
        raise EOFError

    actions = TerminalActions(ask)
    actions.begin(3, 7, LIFT)
    until(lambda: actions.state() is ActionState.FAILED)
