"""One step of fine-tuning: as in training, but from trained weights and without letting go of them.

Owns what differs from `ltvn_core.model.learner`: the start, and statistics of batch normalisation that stay.
"""

from torch import nn

from ltvn_core.model.contract import AnyNetwork
from ltvn_core.model.learner import Learner
from ltvn_core.model.learning_plan import LearningPlan


class FineTuner(Learner):
    """A learner that begins at trained weights."""

    def __init__(self, plan: LearningPlan, start: AnyNetwork) -> None:
        super().__init__(plan, start.size)
        self.network.load_state_dict(start.state_dict())
        self.average.load_state_dict(start.state_dict())

    def _prepare(self) -> None:
        super()._prepare()
        freeze_statistics(self.network)


def freeze_statistics(network: nn.Module) -> None:
    """Let batch normalisation use the statistics that training found, until the next `train()`.

    One drive shows too little of the world to measure them anew.
    """
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()
