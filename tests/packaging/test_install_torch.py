"""PyTorch is asked for where it comes without CUDA, and a machine without a network does not wait for that."""

import sys
import threading

import pytest

from tools import install_torch


@pytest.fixture
def pip_calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    calls: list[tuple[str, ...]] = []

    def note(*arguments: str) -> int:
        calls.append(arguments)
        return 0

    monkeypatch.setattr(install_torch, "_pip", note)
    return calls


@pytest.mark.parametrize(("reachable", "asked"), [(True, 2), (False, 1)])
def test_linux_asks_the_cpu_index_first_if_it_answers(
    reachable: bool, asked: int, pip_calls: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(install_torch, "is_index_reachable", lambda: reachable)

    assert install_torch.main() == 0
    assert len(pip_calls) == asked
    assert (install_torch.CPU_INDEX in pip_calls[0]) == reachable
    assert pip_calls[-1][-1] == install_torch.pinned_torch()


@pytest.mark.parametrize("system", ["darwin", "win32"])
def test_other_systems_take_the_plain_wheel(
    system: str, pip_calls: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", system)

    assert install_torch.main() == 0
    assert not any(install_torch.CPU_INDEX in call for call in pip_calls)
    assert len(pip_calls) == 1


def test_a_resolver_that_never_answers_is_left_after_the_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install_torch, "getproxies", dict)
    monkeypatch.setattr(install_torch, "TIMEOUT_S", 0.2)
    left = threading.Event()

    def never_answer(*_: object, **__: object) -> None:
        left.wait()
        raise OSError

    monkeypatch.setattr("socket.create_connection", never_answer)

    assert not install_torch.is_index_reachable()
    left.set()
