"""A success rate with its confidence interval."""

from dataclasses import dataclass

from scipy.stats import binomtest


@dataclass(frozen=True, slots=True)
class SuccessRate:
    """Successes in independent trials, with Wilson's 95 % interval."""

    successes: int
    trials: int
    share: float
    """Successes divided by trials; 0.5 without trials."""
    low: float
    """Lower end of the interval; 0 without trials."""
    high: float
    """Upper end of the interval; 1 without trials."""

    @classmethod
    def of(cls, successes: int, trials: int) -> "SuccessRate":
        """Count `successes` in `trials`; raise ValueError unless 0 <= successes <= trials."""
        if not 0 <= successes <= trials:
            raise ValueError(f"Successes lie between 0 and the {trials} trials, got {successes}.")
        if trials == 0:
            return cls(0, 0, 0.5, 0.0, 1.0)
        interval = binomtest(successes, trials).proportion_ci(method="wilson")
        return cls(successes, trials, successes / trials, float(interval.low), float(interval.high))

    @property
    def shrunk(self) -> float:
        """Return Laplace's estimate (k + 1) / (n + 2): never 0 nor 1, so that no belief ever becomes a certainty."""
        return (self.successes + 1) / (self.trials + 2)
