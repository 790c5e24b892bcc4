"""Compares rows of features, without Python between the operations of a network that allows it.

A few pairs take as long as the network's operations are many, and Python takes half of that. So what a network does is
recorded once (a TorchScript trace) and repeated: the same operations in the same order, hence the same bits.
"""

import warnings

import torch
from torch import Tensor, nn

from ltvn_core.network.base_network import AnyNetwork

_CALLS_BEFORE_RECORDING = 20
"""Recording takes as long as a hundred small comparisons, which few of those who compare little would win back."""


class Comparison:
    """Asks a network about pairs; call it in inference mode."""

    def __init__(self, network: AnyNetwork) -> None:
        """Compare with `network`, whose weights may still change, but not its layers."""
        self._steps = _ComparisonSteps(network).eval()
        self._recorded: torch.jit.ScriptModule | None = None
        self._may_record = network.is_traceable
        self._calls = 0

    def __call__(self, sources: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Return reachability (P,) and poses (P, 4) for rows (P, F) or (1, F) and (P, F)."""
        self._calls += 1
        if self._recorded is None and self._may_record and self._calls > _CALLS_BEFORE_RECORDING:
            self._recorded = _record(self._steps, sources, targets)
        return (self._recorded or self._steps)(sources, targets)


class _ComparisonSteps(nn.Module):
    """From rows to answers."""

    def __init__(self, network: AnyNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, sources: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Return reachability (P,) and poses (P, 4) for rows (P, F) or (1, F) and (P, F)."""
        here, there = self.network.unpack(sources), self.network.unpack(targets)
        here = here._make([part.expand(targets.shape[0], *part.shape[1:]) for part in here])
        output = self.network.compare(here, there)
        return self.network.reachability(output.logit), output.pose


def _record(steps: nn.Module, sources: Tensor, targets: Tensor) -> torch.jit.ScriptModule:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # It advises other ways, which need a compiler, and take minutes.
        recorded = torch.jit.trace(steps, (sources, targets), check_trace=False)
    assert isinstance(recorded, torch.jit.ScriptModule)
    return recorded
