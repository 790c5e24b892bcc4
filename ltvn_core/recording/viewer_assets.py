"""Gets Rerun's web viewer out of the installed wheel and keeps it on disk, so that no request leaves the machine.

The viewer is embedded in the `rerun` program, which serves it; it is asked once per version, on 127.0.0.1 only, and
under a fresh home directory, because a first session of that program sends no usage data. Owns the cache, not our page.
"""

import gzip
import logging
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import platformdirs
import rerun as rr

from ltvn_core.errors import ServerError
from ltvn_core.recording.this_machine import open_here

_LOG = logging.getLogger(__name__)
_SCRIPT, _MODULE = "re_viewer.js", "re_viewer_bg.wasm"
_START_S = 30.0


class ViewerAssets(NamedTuple):
    """The two files of the web viewer, gzipped, because the module is 43 MB without."""

    script: Path
    module: Path


def viewer_assets(cache: Path | None = None) -> ViewerAssets:
    """Return the files of the web viewer, from the cache where they are there already.

    Raises ServerError when the installed Rerun does not hold them.
    """
    folder = (cache or Path(platformdirs.user_cache_dir("ltvn"))) / f"rerun-viewer-{rr.__version__}"
    assets = ViewerAssets(folder / f"{_SCRIPT}.gz", folder / f"{_MODULE}.gz")
    if not all(path.exists() for path in assets):
        _LOG.info("Unpacking the Rerun viewer once; this takes some seconds.")
        folder.mkdir(parents=True, exist_ok=True)
        with _served_by_rerun() as address:
            for name, path in zip((_SCRIPT, _MODULE), assets, strict=True):
                _keep(path, _fetched(f"{address}/{name}"))
    return assets


def _keep(path: Path, content: bytes) -> None:
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    part.write_bytes(gzip.compress(content, compresslevel=6))
    part.replace(path)


@contextmanager
def _served_by_rerun() -> Iterator[str]:
    web, data = _free_port(), _free_port()
    command = [
        str(_program()),
        "--serve-web",
        "--bind",
        "127.0.0.1",
        "--port",
        str(data),
        "--web-viewer-port",
        str(web),
    ]
    with tempfile.TemporaryDirectory(prefix="ltvn-rerun-") as home:
        home_only = os.environ | {"HOME": home, "XDG_CONFIG_HOME": home, "XDG_CACHE_HOME": home}
        process = subprocess.Popen(
            command, env=home_only, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL
        )
        try:
            _wait_until_served(f"http://127.0.0.1:{web}", process)
            yield f"http://127.0.0.1:{web}"
        finally:
            process.terminate()
            process.wait()


def _wait_until_served(address: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            _fetched(address)
            return
        except ServerError:
            time.sleep(0.05)
    raise ServerError(
        f"The Rerun program did not start its web viewer within {_START_S:.0f} s; reinstall it with "
        f"`pip install --force-reinstall rerun-sdk=={rr.__version__}`."
    )


def _fetched(url: str) -> bytes:
    try:
        with open_here(url, _START_S) as answer:
            return answer.read()
    except OSError as error:
        raise ServerError(f"The Rerun program did not hand over its web viewer ({error}); try again.") from error


def _program() -> Path:
    found = find_spec("rerun_cli")
    folder = Path(found.origin).parent if found is not None and found.origin else Path()
    program = folder / ("rerun.exe" if os.name == "nt" else "rerun")
    if not program.is_file():
        raise ServerError("The installed rerun-sdk has no `rerun` program; reinstall it with `pip install rerun-sdk`.")
    return program


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
