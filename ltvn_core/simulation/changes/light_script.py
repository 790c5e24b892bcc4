"""Light over the day, and pictures and rugs that are exchanged at night."""

import math

import numpy as np

from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, TimedChange
from ltvn_core.worlds.world_change import LightChanged, PicturesExchanged

_EVERY_S = HOUR_S / 4
_SUNRISE_H, _SUNSET_H, _BEDTIME_H = 6.5, 19.0, 23.0
_NIGHT = LightChanged(0.3, 0.8)
"""One lamp is left on."""
_EVENING = LightChanged(0.75, 0.7)
"""All lamps are on."""
_EXCHANGE_S = 3 * HOUR_S


def daylight(rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return the light every quarter of an hour: sun and clouds by day, lamps in the evening, one lamp at night."""
    changes: list[TimedChange] = []
    clouds = 1.0
    for quarter in range(int(duration_s // _EVERY_S) + 1):
        at_s = quarter * _EVERY_S
        clouds = float(np.clip(clouds + rng.normal(0, 0.08), 0.55, 1.0))
        light = _light_at((at_s % DAY_S) / HOUR_S, clouds)
        if not changes or changes[-1].change != light:
            changes.append(TimedChange(at_s, light))
    return changes


def exchanged_pictures(rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return other pictures and rugs every night."""
    nights = range(int((duration_s - _EXCHANGE_S) // DAY_S) + 1)
    return [
        TimedChange(night * DAY_S + _EXCHANGE_S, PicturesExchanged(int(rng.integers(1, 2**31)))) for night in nights
    ]


def _light_at(hour: float, clouds: float) -> LightChanged:
    if not _SUNRISE_H <= hour < _BEDTIME_H:
        return _NIGHT
    if hour >= _SUNSET_H:
        return _EVENING
    sun = math.sin(math.pi * (hour - _SUNRISE_H) / (_SUNSET_H - _SUNRISE_H))
    return LightChanged(round(0.45 + 0.6 * math.sqrt(max(sun, 0.0)) * clouds, 3), -0.2)
