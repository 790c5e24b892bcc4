"""One step of fine-tuning: as in training, but from trained weights and without letting go of them.

Owns what differs from `ltvn_core.network.optimization.trainer`: the start, and statistics of batch normalisation that
stay.
"""

from torch import nn

from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.optimization.hyperparameters import Hyperparameters
from ltvn_core.network.optimization.trainer import Trainer


class FineTuningTrainer(Trainer):
    """A learner that begins at trained weights."""

    def __init__(self, plan: Hyperparameters, start: AnyNetwork) -> None:
        super().__init__(plan, start.size)
        self.network.load_state_dict(start.state_dict())
        self.average.load_state_dict(start.state_dict())

    def _prepare(self) -> None:
        super()._prepare()
        freeze_batch_norm(self.network)


def freeze_batch_norm(network: nn.Module) -> None:
    """Let batch normalisation use the statistics that training found, until the next `train()`.

    One drive shows too little of the world to measure them anew.
    """
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()
