"""Files written for download from the page, available as long as the app runs.

Owns their addresses: an unguessable random number for each file. No other file can be requested.
"""

import secrets
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

SAVED_PREFIX = "/saved/"
SAVED_ENDING = "bin"
_NUMBERS = 10**12
"""Upper limit of the random numbers in addresses."""
_OFFERED = 32
"""Number of latest files that can be downloaded; older ones stay in the folder."""


@dataclass(frozen=True, slots=True)
class SavedFile:
    """A file for download."""

    path: Path
    address: str
    size: int
    """Size of the file in bytes."""

    @property
    def title(self) -> str:
        """Its name and size."""
        return f"{self.path.name} ({self.size / 1000:,.0f} kB)"


class SavedFiles:
    """The files for download; safe from any thread."""

    def __init__(self) -> None:
        """Offer nothing yet."""
        self._paths: OrderedDict[int, Path] = OrderedDict()
        self._lock = Lock()

    def offer(self, path: Path) -> SavedFile:
        """Offer a new file for download."""
        number = secrets.randbelow(_NUMBERS)
        with self._lock:
            self._paths[number] = path
            if len(self._paths) > _OFFERED:
                self._paths.popitem(last=False)
        return SavedFile(path=path, address=f"{SAVED_PREFIX}{number}.{SAVED_ENDING}", size=path.stat().st_size)

    def read(self, number: int) -> bytes | None:
        """Return the content of the file with this number; None if there is none, or it is no longer offered."""
        with self._lock:
            path = self._paths.get(number)
        try:
            return None if path is None else path.read_bytes()
        except OSError:
            return None
