"""The folder of generated files that can be made again: scenes, walks, the Rerun viewer."""

import logging
import os
import tempfile
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

_LOG = logging.getLogger(__name__)


@cache
def cache_folder() -> Path:
    """Return the user's cache folder of the toolkit; for a user without a home, one among the temporary files."""
    try:
        return user_cache_path("ltvn")
    except RuntimeError:  # Neither HOME nor an entry in the table of users, as in many containers.
        folder = _temporary_folder()
        _LOG.warning("This user has no home folder; using %s. XDG_CACHE_HOME names another cache.", folder)
        return folder


def _temporary_folder() -> Path:
    """Return the same folder at each call, unless somebody else has made it."""
    folder = Path(tempfile.gettempdir()) / f"ltvn-cache-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    about = folder.lstat()
    return folder if about.st_uid == os.getuid() and not about.st_mode & 0o22 else Path(tempfile.mkdtemp())
