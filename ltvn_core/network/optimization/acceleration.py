"""Distributed data-parallel training, and mixed precision.

The processes have the same weights, different batches and averaged gradients. Each GPU has a process of its own. On a
CPU, processes of one thread each are faster under load than one process with several threads, which waits at every
layer for its slowest thread. `PairNetwork` always runs matching and geometry in float32.
"""

import signal
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import torch
from torch import Tensor, distributed, multiprocessing, nn
from torch.nn.parallel import DistributedDataParallel

from ltvn_core.errors import LtvnError
from ltvn_core.network.base_network import BaseNetwork
from ltvn_core.network.device import CPU, choose_device, device_of, gpu_count
from ltvn_core.network.image_features import FeaturesT, to_float32
from ltvn_core.network.pair_head import PairOutput

Result = TypeVar("Result")

_TIMEOUT = timedelta(minutes=30)
"""Time for which processes wait for each other, long enough for a validation."""


@dataclass(frozen=True, slots=True)
class DistributedContext:
    """The rank, size and device of one process in distributed training."""

    rank: int = 0
    """Number of this process; process 0 leads: it validates, saves and reports."""
    size: int = 1
    """Number of processes."""
    device: torch.device = CPU
    """Device of this process."""

    @property
    def is_leader(self) -> bool:
        """Whether this process is the leader."""
        return self.rank == 0

    def synchronize_gradients(self, step: nn.Module) -> nn.Module:
        """Return a step whose backward pass averages the gradients of all processes.

        Each process keeps the batch normalisation statistics of its own batches; the leader's are saved.
        """
        return DistributedDataParallel(step, broadcast_buffers=False)

    def broadcast_from_leader(self, number: float) -> float:
        """Return the leader's number, in every process."""
        if self.size == 1:
            return number
        shared = torch.tensor(number, dtype=torch.float64, device=self.device)
        distributed.broadcast(shared, 0)
        return float(shared)


SINGLE_PROCESS = DistributedContext()


def run_distributed(work: Callable[[DistributedContext], Result], processes: int) -> Result:
    """Run `work` in several new processes and return the leader's result; an error in one stops all.

    `work` must be picklable; each process loads its own data. With one process it runs in the calling process.
    """
    if processes == 1:
        return work(DistributedContext(device=choose_device()))
    context = multiprocessing.get_context("spawn")
    results: SimpleQueue = context.SimpleQueue()
    with TemporaryDirectory(prefix="ltvn-team-") as folder:
        arguments = (work, processes, Path(folder) / "meeting", results)
        try:
            multiprocessing.spawn(_worker_main, arguments, nprocs=processes)  # type: ignore[attr-defined]
        except multiprocessing.ProcessRaisedException:  # type: ignore[attr-defined]
            reason = None if results.empty() else results.get()
            if isinstance(reason, LtvnError):
                raise reason from None  # A clear error needs no trace of all processes.
            raise
    return results.get()


def _worker_main(
    rank: int,
    work: Callable[[DistributedContext], Result],
    processes: int,
    meeting: Path,
    results: "SimpleQueue[Result | LtvnError]",
) -> None:
    # Torch sends SIGINT to workers whose leader has died, but a shell's background jobs ignore that signal.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    torch.set_num_threads(1)
    device = choose_device(rank)
    backend = "nccl" if gpu_count() else "gloo"
    distributed.init_process_group(
        backend, init_method=meeting.as_uri(), rank=rank, world_size=processes, timeout=_TIMEOUT
    )
    try:
        result = work(DistributedContext(rank, processes, device))
        if rank == 0:
            results.put(result)
    except LtvnError as error:
        results.put(error)
        raise
    finally:
        distributed.destroy_process_group()


@dataclass(frozen=True, slots=True)
class MixedPrecision:
    """Runs a network in a given precision."""

    bfloat16: bool = False

    def encode(self, network: BaseNetwork[FeaturesT], rgb: Tensor, depth: Tensor) -> FeaturesT:
        """Encode images and return float32 features."""
        with torch.autocast(rgb.device.type, torch.bfloat16, enabled=self.bfloat16):
            features = network.encode(rgb, depth)
        return to_float32(features)

    def compare(self, network: BaseNetwork[FeaturesT], source: FeaturesT, target: FeaturesT) -> PairOutput:
        """Compare P sources with P targets and return float32 outputs."""
        with torch.autocast(device_of(network).type, torch.bfloat16, enabled=self.bfloat16):
            output = network.compare(source, target)
        return output._replace(logit=output.logit.float(), pose=output.pose.float())


FLOAT32 = MixedPrecision()
