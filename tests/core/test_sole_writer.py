"""Two processes never write one output: the second is refused at once, until the first has ended in whatever way."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ltvn_core.errors import RecordingError
from ltvn_core.evaluation.plans import RunFiles
from ltvn_core.sole_writer import sole_user, sole_writer
from ltvn_core.verbs.build import BuildVerb
from ltvn_core.verbs.evaluate import EvaluateVerb, run_plans_of
from ltvn_core.verbs.finetune import FinetuneVerb
from ltvn_core.verbs.import_drive import ImportVerb
from ltvn_core.verbs.train import TrainVerb

HOLD = """
import sys
from pathlib import Path
from ltvn_core.sole_writer import sole_user
with sole_user(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def held_elsewhere(path: Path) -> Iterator[subprocess.Popen[str]]:
    """Let another process write a file for the time of the block."""
    command = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_process_is_refused_until_the_first_is_killed(tmp_path: Path) -> None:
    output = tmp_path / "map.rrd"
    with held_elsewhere(output) as process:
        with pytest.raises(RecordingError, match="Another process"), sole_writer(output):
            pass
        process.kill()
        process.wait()
        with sole_writer(output):
            pass
    assert list(tmp_path.iterdir()) == []


def test_a_second_writer_in_the_same_process_is_refused(tmp_path: Path) -> None:
    with (
        sole_user(tmp_path / "a"),
        sole_user(tmp_path / "b"),
        pytest.raises(RecordingError, match="Another process"),
        sole_user(tmp_path / "a"),
    ):
        pass
    with sole_user(tmp_path / "a"):
        pass


def test_a_second_evaluation_of_the_same_part_is_refused(tmp_path: Path) -> None:
    options = EvaluateVerb(folder=tmp_path, part="2/3", episodes=1)
    (plan,) = run_plans_of(options, options.system, options.episodes)
    files = RunFiles.of(plan, tmp_path)
    with (
        held_elsewhere(files.run / "part-2-of-3"),
        pytest.raises(RecordingError, match="Another process"),
    ):
        options.run()


def test_an_output_that_exists_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.rrd").touch()
    with pytest.raises(RecordingError, match="exists"), sole_writer(tmp_path / "map.rrd"):
        pass


def test_long_work_into_an_output_that_another_process_writes_is_refused_before_it_begins(tmp_path: Path) -> None:
    output = tmp_path / "output.rrd"
    weights = tmp_path / "output.safetensors"
    missing = tmp_path / "missing.rrd"  # Looking for it would already be work.
    with held_elsewhere(output), held_elsewhere(weights), held_elsewhere(tmp_path / "work"):
        with pytest.raises(RecordingError, match="Another process"):
            BuildVerb(recordings=(missing,), output=output).run()
        with pytest.raises(RecordingError, match="Another process"):
            ImportVerb(source=missing, output=output).run()
        with pytest.raises(RecordingError, match="Another process"):
            FinetuneVerb(recording=missing, output=weights).run()
        with pytest.raises(RecordingError, match="Another process"):
            TrainVerb(output=weights, work=tmp_path / "other").run()
        with pytest.raises(RecordingError, match="Another process"):
            TrainVerb(output=tmp_path / "other.safetensors", work=tmp_path / "work").run()
