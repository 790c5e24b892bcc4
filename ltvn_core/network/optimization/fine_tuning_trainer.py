"""The trainer for fine-tuning: starts from trained weights and keeps the statistics of batch normalisation."""

from torch import nn

from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.optimization.hyperparameters import Hyperparameters
from ltvn_core.network.optimization.trainer import Trainer


class FineTuningTrainer(Trainer):
    """A trainer that starts from trained weights."""

    def __init__(self, plan: Hyperparameters, start: AnyNetwork) -> None:
        super().__init__(plan, start.size)
        self.network.load_state_dict(start.state_dict())
        self.average.load_state_dict(start.state_dict())

    def _prepare(self) -> None:
        super()._prepare()
        freeze_batch_norm(self.network)


def freeze_batch_norm(network: nn.Module) -> None:
    """Make batch normalisation use the statistics of training, until the next `train()`.

    The images of one drive are too uniform to estimate them again.
    """
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()
