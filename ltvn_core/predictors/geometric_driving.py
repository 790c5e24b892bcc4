"""How the geometric predictor drives in simulation: what `ltvn measure --predictor geometric --write` wrote down.

Owns the file. What is in it is as in the card of the network's weights, `ltvn_core.network.cards.driving_calibration`.
"""

import json
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.config import Likelihoods
from ltvn_core.errors import WeightsError
from ltvn_core.network.cards.driving_calibration import DRIVING_SECTION, DrivingMeasurements, likelihoods, read_driving
from ltvn_core.structured_text import parse_json

DRIVING_FILE = Path(__file__).with_name("geometric_driving.json")
"""The measurements that come with the package."""


@lru_cache(maxsize=1)
def shipped_likelihoods() -> Likelihoods | None:
    """Return the constants of Eq. 3 and Eq. 4; None where nothing was measured. Raises WeightsError for a bad file."""
    if not DRIVING_FILE.is_file():
        return None
    try:
        measured = read_driving(parse_json(DRIVING_FILE.read_text(encoding="utf-8")))
    except ValueError as error:
        raise WeightsError(f"{DRIVING_FILE} is damaged ({error}); install the package again.") from error
    return None if measured is None else likelihoods(measured)


def write_driving(measured: DrivingMeasurements) -> Path:
    """Write measurements in place of the old ones and return the file. Raises WeightsError where that fails."""
    try:
        with atomic_replacement(DRIVING_FILE) as part:
            part.write_text(json.dumps({DRIVING_SECTION: asdict(measured)}, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise WeightsError(f"{DRIVING_FILE}: the measurements could not be written ({error}).") from error
    shipped_likelihoods.cache_clear()
    return DRIVING_FILE
