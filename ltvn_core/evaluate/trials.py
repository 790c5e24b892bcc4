"""Trials: many episodes with one map, in pieces that run side by side on any number of processes or machines.

Owns the pieces and how they are put together. A piece that is done is a file; so an interrupted evaluation goes on
where it stopped, on whatever machines share the folder.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from ltvn_core.composition import SystemName, open_predictor
from ltvn_core.evaluate.course import Course
from ltvn_core.evaluate.plans import TrialFiles, TrialPlan, claim_files, open_system
from ltvn_core.evaluate.preparation import prepare, tuned_weights
from ltvn_core.evaluate.protocol import EpisodePlan
from ltvn_core.evaluate.results import EpisodeResult, TrialResult, load_results, save_results
from ltvn_core.evaluate.truth import floorplan, map_facts
from ltvn_core.evaluate.workers import Workers
from ltvn_core.lessons.own_weights import prepare_lessons
from ltvn_core.sim.scenes import load_scene

EPISODES_AT_ONCE = 25
"""Episodes in a piece: small enough to share work out evenly and to lose little, large enough to load a map for."""


@dataclass(frozen=True, slots=True)
class Told:
    """Whom to tell how far it is."""

    maps: Callable[[int], object]
    """Hears how many maps there are."""
    added: Callable[[int], object]
    """Hears how many more episodes, or queries, are done."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Some episodes, done."""

    episodes: tuple[EpisodeResult, ...]
    wall_s: float


def open_course(plan: TrialPlan, files: TrialFiles, queries: int = 0, *, maintain: bool = False) -> Course:
    """Load the map after so many queries, with its scene and network."""
    scene, weights = load_scene(plan.scene), tuned_weights(plan, files)
    predictor = open_predictor(plan.predictor, plan.scene, weights)
    system = open_system(plan, weights, scene, maintain=maintain)
    return Course(scene, files.map(queries), predictor, system, plan.protocol)


def run_piece(plan: TrialPlan, files: TrialFiles, queries: int, first: int, episodes: Sequence[EpisodePlan]) -> int:
    """Run episodes, numbered from `first`, with the map after so many queries; return how many there were."""
    path = files.episodes(queries, first, first + len(episodes))
    if not path.exists():
        started, course = time.monotonic(), kept_course(plan, files, queries)
        done = tuple(
            course.run(number, episode, episode_dice(plan.seed, number))
            for number, episode in enumerate(episodes, first)
        )
        save_results(path, Piece(done, time.monotonic() - started))
    return len(episodes)


def episode_dice(seed: int, episode: int) -> np.random.Generator:
    """Return the dice of one episode."""
    return np.random.default_rng([seed, 3, episode])


@lru_cache(maxsize=1)
def kept_course(plan: TrialPlan, files: TrialFiles, queries: int) -> Course:
    """Return the course of a frozen map, kept between pieces; its map must not be changed."""
    return open_course(plan, files, queries)


def run_trials(
    plans: Sequence[TrialPlan], folder: Path, *, episodes: int, command: str, parallel: Workers, told: Told
) -> list[TrialResult]:
    """Run the static test of several plans, with one scene and seed each; what is done already is only read.

    Raises OptionError where the folder holds results of other settings, and the errors of the parts.
    """
    tasks = prepare_all(plans, folder, parallel, told)
    for done in parallel(piece for plan, files in tasks for piece in static_pieces(plan, files, 0, episodes)):
        told.added(done)
    list(parallel(delayed(_finish)(plan, files, episodes, command) for plan, files in tasks))
    # Read back, because pieces of work come back in any order.
    return [load_results(files.trial(episodes), TrialResult) for _, files in tasks]


def prepare_all(
    plans: Sequence[TrialPlan], folder: Path, parallel: Workers, told: Told
) -> list[tuple[TrialPlan, TrialFiles]]:
    """Make drives, weights and maps side by side; raises as `run_trials`."""
    tasks = [(plan, TrialFiles.of(plan, folder)) for plan in plans]
    for plan, files in tasks:
        claim_files(plan, files)
    untaught: set[SystemName] = {plan.system for plan, files in tasks if plan.finetuned and not files.weights.exists()}
    for system in untaught:
        prepare_lessons(system)  # Once for all processes.
    for ready, _ in enumerate(parallel(delayed(prepare)(plan, files) for plan, files in tasks), 1):
        told.maps(ready)
    return tasks


def static_pieces(plan: TrialPlan, files: TrialFiles, queries: int, episodes: int) -> Iterator[Any]:
    """Yield the pieces of the static test with the map after so many queries, for `joblib.Parallel`."""
    drawn = prepare(plan, files).episodes(episodes, plan.seed)
    for first, until in _spans(episodes):
        yield delayed(run_piece)(plan, files, queries, first, drawn[first:until])


def _spans(episodes: int) -> list[tuple[int, int]]:
    """Return the first episode of each piece, and the one after its last."""
    return [(first, min(first + EPISODES_AT_ONCE, episodes)) for first in range(0, episodes, EPISODES_AT_ONCE)]


def _finish(plan: TrialPlan, files: TrialFiles, episodes: int, command: str) -> None:
    """Keep the result of the static test as a file."""
    if not files.trial(episodes).exists():
        save_results(files.trial(episodes), finish_trial(plan, files, 0, episodes, command))


def finish_trial(plan: TrialPlan, files: TrialFiles, queries: int, episodes: int, command: str) -> TrialResult:
    """Put the pieces together and look at the map."""
    paths = [files.episodes(queries, first, until) for first, until in _spans(episodes)]
    pieces: list[Piece] = [load_results(path, Piece) for path in paths]
    course, sights = kept_course(plan, files, queries), prepare(plan, files)
    return TrialResult(
        scene=course.scene.name,
        method=plan.system,
        preset=plan.preset,
        without=plan.parts_off,
        finetuned=plan.finetuned,
        seed=plan.seed,
        queries=queries,
        images=len(sights.frames),
        fingerprint=course.fingerprint,
        map=map_facts(course.graph, course.truth, sights.goals),
        floorplan=floorplan(course.graph, course.truth),
        episodes=tuple(episode for piece in pieces for episode in piece.episodes),
        wall_s=sum(piece.wall_s for piece in pieces),
        version=version("ltvn"),
        command=command,
    )
