"""Recorded presence of things: noisy looks at them, and the truth. Owns the file format and what is refused of it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import OptionError

FloatArray = NDArray[np.float64]

_KEYS = ("obs", "obs_t", "gt_obs", "gt_t")


@dataclass(frozen=True, slots=True, eq=False)
class PresenceSequence:
    """When one thing was looked for and found, and when it was really there."""

    name: str
    found: NDArray[np.bool_]
    """(L,) what each look said."""
    looked_at_s: FloatArray
    """(L,) times of the looks, increasing."""
    present: NDArray[np.bool_]
    """(G,) truth."""
    known_at_s: FloatArray
    """(G,) its times, increasing."""

    def truth_at(self, at_s: FloatArray) -> NDArray[np.bool_]:
        """Return (T,) whether the thing was there at times (T,): the truth known last."""
        return self.present[np.maximum(np.searchsorted(self.known_at_s, at_s, side="right") - 1, 0)]


def read_sequences(path: Path) -> tuple[PresenceSequence, ...]:
    """Read the things of an npz file, which has four arrays for each thing, such as `3.obs`, `3.obs_t`, `3.gt_obs`
    and `3.gt_t`: looks (0 or 1), their times in s, truth and its times in s.

    Raises OptionError where the file is missing or is of another kind.
    """
    try:
        with np.load(path) as arrays:
            names = sorted({key.partition(".")[0] for key in arrays.files})
            things = tuple(_sequence(path, name, [arrays[f"{name}.{key}"] for key in _KEYS]) for name in names)
    except (OSError, ValueError, KeyError) as error:
        raise OptionError(
            f"{path} is no file of presence ({error}); it must be an npz with arrays N.obs, N.obs_t, N.gt_obs and "
            "N.gt_t for each thing N."
        ) from None
    if not things:
        raise OptionError(f"{path} holds no things; each needs four arrays such as 0.obs, 0.obs_t, 0.gt_obs, 0.gt_t.")
    return things


def _sequence(path: Path, name: str, arrays: list[NDArray[np.generic]]) -> PresenceSequence:
    found, looked_at_s, present, known_at_s = (np.asarray(each, np.float64) for each in arrays)
    for values, times in ((found, looked_at_s), (present, known_at_s)):
        in_order = np.isfinite(times).all() and bool((np.diff(times) > 0).all())
        if values.ndim != 1 or values.shape != times.shape or not len(values) or not in_order:
            raise OptionError(f"{path}: thing {name} needs one value for each time, and times that increase.")
        if not np.isin(values, (0, 1)).all():
            raise OptionError(f"{path}: thing {name} has values other than 0 and 1; 1 means that it was there.")
    return PresenceSequence(
        name=name,
        found=found > 0,
        looked_at_s=looked_at_s,
        present=present > 0,
        known_at_s=known_at_s,
    )
