"""What to say to somebody who typed a name that does not exist."""

from collections.abc import Iterable
from difflib import get_close_matches


def which_name(typed: str, names: Iterable[str]) -> str:
    """Return `Did you mean demo? Choose one of: …`, or only the latter where nothing is close to what was typed."""
    known = [*names]
    close = get_close_matches(typed.lower(), known, n=1)
    guess = f"Did you mean {close[0]}? " if close else ""
    return f"{guess}Choose one of: {', '.join(known)}"
