"""How the network of a navigation system learns: its labels, what it rehearses, and what its plan leaves out.

Owns the two ways there are, by odometry and by time. The loops are `ltvn_core.network.optimization`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from ltvn_core.training.fine_tuning_data import LabelledWalks, RehearsalData, SimulatedPairs

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan
    from ltvn_core.systems.entry import SystemEntry, TemporalLearning
    from ltvn_core.training_data.trajectory_pairs import LabelRule


class SystemTraining(Protocol):
    """What a system's network learns from its own drives."""

    def label_rule(self) -> "LabelRule":
        """Return the rule that labels the pairs of a drive."""
        ...

    def rehearsal(self, folder: Path | None = None) -> RehearsalData:
        """Return what is shown beside the drive; `folder` names data at hand, else they are made once and kept."""
        ...

    def adapt_plan(self, plan: "FineTuningPlan") -> "FineTuningPlan":
        """Return a plan of fine-tuning without what this system cannot know."""
        ...


@dataclass(frozen=True, slots=True)
class OdometryTraining:
    """Learning where one can drive: odometry and depth label the drive, exact poses the simulated pairs beside it."""

    def label_rule(self) -> "LabelRule":
        """Return the rule of odometry."""
        from ltvn_core.training_data.trajectory_pairs import OdometryLabelRule

        return OdometryLabelRule()

    def rehearsal(self, folder: Path | None = None) -> RehearsalData:
        """Return simulated pairs."""
        return SimulatedPairs(folder)

    def adapt_plan(self, plan: "FineTuningPlan") -> "FineTuningPlan":
        """Return the plan as it is."""
        return plan


@dataclass(frozen=True, slots=True)
class TemporalTraining:
    """Learning by the steps between two images alone, of the drive and of random walks; no poses are known."""

    learning: "TemporalLearning"

    def label_rule(self) -> "LabelRule":
        """Return the rule of time."""
        return self.learning.rule

    def rehearsal(self, folder: Path | None = None) -> RehearsalData:
        """Return random walks with the same labels."""
        return LabelledWalks(self.learning.rule, folder)

    def adapt_plan(self, plan: "FineTuningPlan") -> "FineTuningPlan":
        """Return the plan without hard negatives, which only poses can tell."""
        from ltvn_core.network.baseline_training import baseline_fine_tuning_plan

        return baseline_fine_tuning_plan(plan, even_distances=self.learning.even_distances)


def system_training(entry: "SystemEntry") -> SystemTraining:
    """Return how the network of a navigation system learns."""
    return OdometryTraining() if entry.learning is None else TemporalTraining(entry.learning)
