"""The demo map and the demo recording that come with the toolkit: in a wheel inside the package, else in the checkout.

Owns where they lie. Opens nothing.
"""

from pathlib import Path

DEMO_MAP = "demo-map.rrd"
"""Map of the demo apartment."""

DEMO_RECORDING = "demo-fault.rrd"
"""Four queries on that map after three faults were planted in it, to try the debugger on."""

_PLACES = (Path(__file__).parent / "demo", Path(__file__).parents[3] / "recordings")


def demo_file(name: str) -> Path | None:
    """Return where a demo file of that name lies; None where there is none."""
    return next((place / name for place in _PLACES if (place / name).is_file()), None)
