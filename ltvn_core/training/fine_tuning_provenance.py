"""Writes fine-tuned weights with the card that says where they come from, whoever asked for them.

Owns what a card takes from the run and what from the result. Its fields are `ltvn_core.network.cards.fine_tuning_card`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData, FineTuningPlan, FineTuningResult


@dataclass(frozen=True)
class FineTuningProvenance:
    """What is known of a fine-tuning before it begins."""

    parent_card: Mapping[str, Any]
    """The card of the weights that it starts from."""
    recording: str
    """Name of the drive."""
    run: Mapping[str, Any]
    """What tells this run from others."""
    command: str
    """What makes these weights again."""

    def save(self, result: "FineTuningResult", output: Path, plan: "FineTuningPlan", data: "FineTuningData") -> str:
        """Write weights and card and return the fingerprint. Raises WeightsError."""
        from ltvn_core.network.cards.fine_tuning_card import FineTuningCard
        from ltvn_core.network.weights_file import save_weights
        from ltvn_core.training_data.trajectory_pairs import TrajectoryPairs

        drive = data.drive
        assert isinstance(drive, TrajectoryPairs)
        card = FineTuningCard(
            parent=result.parent,
            parent_card=self.parent_card,
            recording=self.recording,
            run=self.run,
            command=self.command,
            seed=plan.learning.seed,
            images=len(drive.poses),
            pieces=drive.trajectory.pieces,
            simulated_scenes=tuple(scene.name for scene in data.scenes),
            validation_scenes=tuple(scene.name for scene in data.validation),
            plan=plan,
            steps=result.steps,
            pairs_compared=result.pairs,
            minutes=result.seconds / 60,
            before=result.before,
            after=result.after,
        )
        return save_weights(result.network, output, asdict(card))
