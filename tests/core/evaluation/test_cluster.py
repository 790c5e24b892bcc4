"""The numbers of an evaluation are the same however its work is shared: parts, Dask, and a worker that dies."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from psutil import Process

from ltvn_core.errors import EngineError, OptionError
from ltvn_core.evaluation.plans import RunPlan
from ltvn_core.evaluation.protocol import EvaluationProtocol
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.results import Run, read_runs, rows_in
from ltvn_core.evaluation.runner import Progress, run_plans
from ltvn_core.evaluation.workers import WHOLE, Part, workers
from tests.core.simulation.two_room_mesh import box_house, save
from tests.platforms import needs_posix
from tests.waiting import until

pytestmark = needs_posix

EPISODES, SEEDS = 1, (0, 1)


def run(
    house: Path,
    folder: Path,
    *,
    cluster: str | None = None,
    part: Part = WHOLE,
    tell: Callable[[Progress], None] = lambda _: None,
) -> list[Run]:
    protocol = EvaluationProtocol(loops=1, goals=4, episodes=EPISODES, step_limit=100)
    plans = [RunPlan(scene=str(house), seed=seed, predictor="oracle", protocol=protocol) for seed in SEEDS]
    with workers(1, cluster, folder) as parallel:
        return run_plans(plans, folder, command="test", parallel=parallel, tell=tell, part=part)


def episodes(runs: list[Run]) -> list[tuple[QueryResult, ...]]:
    return [known.episodes for run in runs for known in run.maps]


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    save(box_house(), path := tmp_path_factory.mktemp("house") / "house.glb")
    return path


@pytest.fixture(scope="module")
def alone(house: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    return run(house, tmp_path_factory.mktemp("alone"))


@contextmanager
def program(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a program until the end of the block, with all that it started."""
    started = subprocess.Popen(arguments, env=os.environ | {"OMP_NUM_THREADS": "1"}, start_new_session=True)
    try:
        yield started
    finally:
        os.killpg(started.pid, signal.SIGKILL)
        started.wait()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_parts_are_everything_and_have_nothing_in_common() -> None:
    work = list(range(10))
    for count in (1, 3, 10, 16):
        shares = [Part(number, count).of(work) for number in range(1, count + 1)]
        assert [each for share in shares for each in share] == work
        assert max(map(len, shares)) - min(map(len, shares)) <= 1
    assert Part.parse("2/3") == Part(2, 3)
    assert Part.parse("") == WHOLE
    for wrong in ("0/3", "4/3", "1", "a/b", "1/2/3"):
        with pytest.raises(OptionError, match="--part must be I/N"):
            Part.parse(wrong)


def test_two_parts_in_one_folder_come_to_the_same_numbers(house: Path, alone: list[Run], tmp_path: Path) -> None:
    first = run(house, tmp_path, part=Part(1, 2))
    assert len(first) == len(SEEDS) / 2
    assert episodes(run(house, tmp_path, part=Part(2, 2))) == episodes(alone)


def test_a_dask_cluster_comes_to_the_same_numbers_though_a_worker_dies(
    house: Path, alone: list[Run], tmp_path: Path
) -> None:
    pytest.importorskip("distributed")
    port = free_port()
    dask = (sys.executable, "-m", "dask")
    with (
        program(*dask, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard") as _,
        program(*dask, "worker", f"tcp://127.0.0.1:{port}", "--nworkers", "2", "--nthreads", "1") as nanny,
    ):
        until(lambda: answers(port))
        killed: list[int] = []

        def kill_one(found: Progress) -> None:
            if found.maps and not killed:
                workers_of_it = [each for each in Process(nanny.pid).children() if "spawn_main" in str(each.cmdline())]
                killed.append(workers_of_it[0].pid)
                workers_of_it[0].kill()

        assert episodes(run(house, tmp_path, cluster=f"tcp://127.0.0.1:{port}", tell=kill_one)) == episodes(alone)
        assert killed


@pytest.mark.slow
def test_two_processes_killed_in_the_middle_go_on_to_the_same_rows(house: Path, tmp_path: Path) -> None:
    def evaluation(folder: Path, processes: int) -> tuple[str, ...]:
        size = "--loops 1 --goals 4 --episodes 30 --step-limit 60 --predictor oracle --body planar"
        told = f"evaluate --scene {house} {size} --folder {folder} --processes {processes}".split()
        return (sys.executable, "-c", "import sys; from ltvn_core.cli import main; sys.exit(main())", *told)

    def rows() -> int:
        return sum(path.read_bytes().count(b"\n") for path in tmp_path.rglob("killed/*/*/episodes-*.jsonl"))

    with program(*evaluation(tmp_path / "killed", 2)):
        until(lambda: rows() > 4)
    assert 4 < rows() < 30
    for folder, processes in (("killed", 2), ("whole", 1)):
        assert subprocess.run(evaluation(tmp_path / folder, processes), check=False).returncode == 0
    (killed,), (whole,) = (read_runs(rows_in(tmp_path / name)) for name in ("killed", "whole"))
    assert [episode.query for episode in whole.maps[0].episodes] == list(range(30))
    assert killed.maps[0].episodes == whole.maps[0].episodes
    assert killed.maps[0].map == whole.maps[0].map


def test_a_local_cluster_is_started_and_stopped(house: Path, alone: list[Run], tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    assert episodes(run(house, tmp_path, cluster="local:2")) == episodes(alone)


def test_a_worker_that_is_not_like_this_machine_is_refused(
    house: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("ltvn_core.evaluation.workers.version", lambda _: "0.0.7")
    with pytest.raises(EngineError, match=r"A worker has version .* this machine 0\.0\.7"):
        run(house, tmp_path, cluster="local:1")


def test_addresses_that_no_cluster_has_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="tcp://HOST:PORT"), workers(None, "slurm://x", tmp_path):
        pass
