"""Files that were just written for somebody, so that the page can hand them out as long as the app runs.

Owns under which addresses: numbers that nobody can guess, drawn anew for each file. No other file can be asked for.
"""

import secrets
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

SAVED_PREFIX = "/saved/"
SAVED_ENDING = "bin"
_NUMBERS = 10**12
"""An address has no more digits."""
_OFFERED = 32
"""So many files are handed out, the latest; the others lie in the folder all the same."""


@dataclass(frozen=True, slots=True)
class SavedFile:
    """A file that the page hands out."""

    path: Path
    address: str
    size: int
    """In bytes."""

    @property
    def title(self) -> str:
        """Its name and size."""
        return f"{self.path.name} ({self.size / 1000:,.0f} kB)"


class SavedFiles:
    """What is handed out; safe from any thread."""

    def __init__(self) -> None:
        """Offer nothing yet."""
        self._paths: OrderedDict[int, Path] = OrderedDict()
        self._lock = Lock()

    def offer(self, path: Path) -> SavedFile:
        """Hand out a file that was just written."""
        number = secrets.randbelow(_NUMBERS)
        with self._lock:
            self._paths[number] = path
            if len(self._paths) > _OFFERED:
                self._paths.popitem(last=False)
        return SavedFile(path=path, address=f"{SAVED_PREFIX}{number}.{SAVED_ENDING}", size=path.stat().st_size)

    def read(self, number: int) -> bytes | None:
        """Return what is in a file by the number of its address; None where there is none, or none any more."""
        with self._lock:
            path = self._paths.get(number)
        try:
            return None if path is None else path.read_bytes()
        except OSError:
            return None
