"""Metrics over trials and over lifelong tests: means with intervals, failures by cause, and differences of two methods.

Scenes are fixed, map seeds and episodes are samples: a 95 % interval shows the scatter between trials of one scene (see
`confidence_intervals`), or between episodes if there is a single seed. Every trial has the same weight, whatever its
number of episodes.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.confidence_intervals import Estimate, SampleGroup, estimates
from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.evaluation.results import Run, TestedMap
from ltvn_core.navigation.events import Outcome
from ltvn_core.network.metrics import SuccessRate
from ltvn_core.types import CONTROL_STEP_S


@dataclass(frozen=True, slots=True)
class EvaluationMetrics:
    """Metrics over several trials of one method."""

    trials: int
    episodes: int
    success_rate: Estimate
    """Success rate; its interval is never narrower than Wilson's, which is not empty at 0 % and 100 %."""
    spl: Estimate
    """Success weighted by path length."""
    collisions_per_episode: Estimate
    steps_per_episode: Estimate
    time_s: Estimate
    """Mean simulated time of an episode, in seconds."""
    path_m: Estimate
    """Mean driven length of an episode, in metres."""
    failures: dict[str, int]
    """Number of failed episodes by cause, for all causes."""
    nodes: float
    """Mean number of nodes over trials."""
    edges: float
    """Mean number of directed edges over trials."""
    spurious_edges: float
    """Mean number of directed edges that are spurious."""
    pieces: float
    """Mean number of strongly connected components."""
    goals_connected: float
    """Mean number of goals that can be reached from most of the map."""

    @property
    def spurious_share(self) -> float:
        """Share of the edges that are spurious; 0 without edges."""
        return self.spurious_edges / self.edges if self.edges else 0.0


def compute_metrics(trials: Sequence[TestedMap]) -> EvaluationMetrics:
    """Return the metrics of trials of one method; raise ValueError if there are no episodes."""
    episodes = _episodes(trials)
    success, *amounts = estimates(_samples(trials))
    spl, collisions, steps, path_m = (amount.within(0, np.inf) for amount in amounts)
    return EvaluationMetrics(
        trials=len(trials),
        episodes=len(episodes),
        success_rate=success.covering(overall_success(trials)).within(0, 1),
        spl=spl.within(0, 1),
        collisions_per_episode=collisions,
        steps_per_episode=steps,
        time_s=Estimate(*(CONTROL_STEP_S * each for each in (steps.mean, steps.low, steps.high))),
        path_m=path_m,
        failures=count_failures(trials),
        nodes=_mean([trial.map.nodes for trial in trials]),
        edges=_mean([trial.map.edges for trial in trials]),
        spurious_edges=_mean([trial.map.spurious_edges for trial in trials]),
        pieces=_mean([trial.map.pieces for trial in trials]),
        goals_connected=_mean([trial.map.goals_connected for trial in trials]),
    )


def overall_success(trials: Sequence[TestedMap]) -> SuccessRate:
    """Return the share of all episodes that succeeded, with Wilson's interval, which ignores map seeds."""
    episodes = _episodes(trials)
    return SuccessRate.of(sum(episode.reached for episode in episodes), len(episodes))


def count_failures(trials: Sequence[TestedMap]) -> dict[str, int]:
    """Count failed episodes by cause; causes that never occurred count 0."""
    counts = Counter(episode.failure for episode in _episodes(trials))
    return {cause.value: counts[cause] for cause in FailureCause}


@dataclass(frozen=True, slots=True)
class RecognitionShares:
    """Progress of episodes, and shares of wrong localisations and arrivals; nan for a share of nothing."""

    crossed: float
    """Share of crossed checkpoints, with equal weight per episode (see `episode_runner.Checkpoints`)."""
    mislocalised: float
    """Share of localisations at a node where the robot was not."""
    wrong_arrivals: float
    """Share of the robot's declared arrivals that were wrong."""


def recognition_of(trials: Sequence[TestedMap]) -> RecognitionShares | None:
    """Return the shares over all episodes; None for older results without these counts."""
    episodes = _episodes(trials)
    if any(each.crossed is None for each in episodes):
        return None
    ways = [(each.crossed or 0) / each.checkpoints for each in episodes if each.checkpoints]
    arrived = [each for each in episodes if each.outcome == Outcome.ARRIVED.value]
    return RecognitionShares(
        crossed=float(np.mean(ways)) if ways else np.nan,
        mislocalised=_share(
            sum(each.mislocalised or 0 for each in episodes), sum(each.localised or 0 for each in episodes)
        ),
        wrong_arrivals=_share(sum(not each.reached for each in arrived), len(arrived)),
    )


@dataclass(frozen=True, slots=True)
class MethodDifference:
    """Differences between two methods, first minus second."""

    success_rate: Estimate
    spl: Estimate
    collisions_per_episode: Estimate
    steps_per_episode: Estimate
    paired: bool
    """Whether episodes were compared in pairs, because both methods drove the same ones."""


def compare_methods(first: Sequence[TestedMap], second: Sequence[TestedMap]) -> MethodDifference:
    """Compare two methods; raise ValueError if one has no episodes.

    Where scenes, seeds, starts and goals are equal, the differences of single episodes are averaged, which removes
    their common variance; otherwise the two are treated as independent.
    """
    samples = _samples(first)
    others = _samples(second)
    paired = [_episode_keys(trial) for trial in _sorted(first)] == [_episode_keys(trial) for trial in _sorted(second)]
    if paired:
        both = zip(samples, others, strict=True)
        found = estimates([SampleGroup(one.stratum, one.values - other.values) for one, other in both])
    else:
        found = estimates(samples, others)
    success, spl, collisions, steps, _ = found
    return MethodDifference(
        success_rate=success, spl=spl, collisions_per_episode=collisions, steps_per_episode=steps, paired=paired
    )


def _samples(trials: Sequence[TestedMap]) -> list[SampleGroup]:
    """Return the values per episode, sorted, so that the order of trials does not matter."""
    return [SampleGroup(trial.columns.scene, _values(trial)) for trial in _sorted(trials)]


def _values(trial: TestedMap) -> NDArray[np.float64]:
    rows = [[each.reached, each.spl, each.collisions, each.steps, each.path_m] for each in _in_order(trial)]
    return np.array(rows, np.float64).reshape(-1, 5)


def _sorted(trials: Sequence[TestedMap]) -> list[TestedMap]:
    return sorted(trials, key=_order)


def _order(trial: TestedMap) -> tuple[object, ...]:
    columns = trial.columns
    return columns.scene, columns.seed, trial.after, columns.method, columns.without


def _in_order(trial: TestedMap) -> list[QueryResult]:
    return sorted(trial.episodes, key=lambda episode: episode.query)


def _episode_keys(trial: TestedMap) -> tuple[object, ...]:
    return trial.columns.scene, trial.columns.seed, [(each.query, each.start, each.goal) for each in _in_order(trial)]


def _episodes(trials: Sequence[TestedMap]) -> list[QueryResult]:
    return [episode for trial in trials for episode in trial.episodes]


def _share(part: int, whole: int) -> float:
    return part / whole if whole else np.nan


def _mean(numbers: Sequence[float]) -> float:
    return float(np.mean(numbers))


@dataclass(frozen=True, slots=True)
class StaticTestMetrics:
    """Metrics of the static test after a number of queries."""

    queries: int
    """Number of queries before the test."""
    success_rate: float
    success_low: float
    """Lower end of the 95 % interval of the success rate."""
    success_high: float
    collisions_per_episode: float
    nodes: float
    """Mean number of nodes over the maps."""
    edges: float
    """Mean number of directed edges over the maps."""
    spurious_share: float
    """Share of the edges that are spurious."""


@dataclass(frozen=True, slots=True)
class LifelongMetrics:
    """Changes of one or several maps by queries with maintenance."""

    before: StaticTestMetrics
    """The static test with the maps as they were built."""
    after: StaticTestMetrics
    """The static test with the maps after all queries."""
    queries: int
    """Number of queries with maintenance, in all maps together."""
    reached_share: float
    """Share of these queries that reached the goal."""
    collisions_per_query: float
    pruned: int
    """Number of pruned edges."""
    pruned_bad_share: float | None
    """Share of pruned edges that are spurious or that the robot could not drive; None if none was pruned."""
    pruned_spurious: int
    """Number of pruned edges that are spurious by the ground truth."""
    added_nodes: int
    added_edges: int
    added_spurious: int
    """Number of added edges that are spurious."""


def lifelong_metrics(results: Sequence[Run]) -> LifelongMetrics:
    """Return the metrics of lifelong evaluations of equal length; raise ValueError if there are none."""
    queries = [query for result in results for query in result.queries]
    pruned = sum(query.pruned for query in queries)
    return LifelongMetrics(
        before=_static_test_metrics([result.maps[0] for result in results]),
        after=_static_test_metrics([result.maps[-1] for result in results]),
        queries=len(queries),
        reached_share=sum(query.reached for query in queries) / len(queries),
        collisions_per_query=sum(query.collisions for query in queries) / len(queries),
        pruned=pruned,
        pruned_bad_share=sum(query.pruned_bad for query in queries) / pruned if pruned else None,
        pruned_spurious=sum(query.pruned_spurious for query in queries),
        added_nodes=sum(query.added_nodes for query in queries),
        added_edges=sum(query.added_edges for query in queries),
        added_spurious=sum(query.added_spurious for query in queries),
    )


def _static_test_metrics(trials: Sequence[TestedMap]) -> StaticTestMetrics:
    found = compute_metrics(trials)
    return StaticTestMetrics(
        queries=trials[0].after,
        success_rate=found.success_rate.mean,
        success_low=found.success_rate.low,
        success_high=found.success_rate.high,
        collisions_per_episode=found.collisions_per_episode.mean,
        nodes=found.nodes,
        edges=found.edges,
        spurious_share=found.spurious_share,
    )
