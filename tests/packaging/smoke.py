"""Tries an installed `ltvn` in an empty folder: its help, what it says of the demo recording, and a replay of it.

`python smoke.py [PROGRAM]` runs everywhere the wheel does, with the standard library alone. Without a program it takes
the `ltvn` beside the running Python.
"""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import parse_qs, urlsplit
from urllib.request import ProxyHandler, Request, build_opener

DEMO = "demo-fault.rrd"
PATIENCE_S = 300.0


def main(program: Path) -> None:
    """Try it all; raises AssertionError for the first thing that is not as it should be."""
    # A file that is still open on Windows cannot be deleted, and that is no fault of the program.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        assert "replay" in run(program, "--help", folder=folder), "ltvn --help does not name its verbs"
        replay(program, DEMO, folder=folder)
        info = json.loads(run(program, "info", str(folder / "recordings" / DEMO), "--json", "-", folder=folder))
        assert info["frames"] > 0, info
    sys.stdout.write(f"{program} works.\n")


def run(program: Path, *arguments: str, folder: Path) -> str:
    """Run the program to its end and return what it prints."""
    done = subprocess.run(
        [str(program), *arguments],
        cwd=folder,
        env=environment(),
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def replay(program: Path, recording: str, *, folder: Path, meanwhile: Callable[[str], None] = lambda _: None) -> None:
    """Open a recording in the page and ask for the page, then for `meanwhile` with its link; end it afterwards."""
    serve(program, "replay", recording, folder=folder, meanwhile=meanwhile)


def serve(program: Path, *arguments: str, folder: Path, meanwhile: Callable[[str], None] = lambda _: None) -> str:
    """Open a page and ask for it, then for `meanwhile` with its link; end it, and return what was said before."""
    process = subprocess.Popen(
        [str(program), *arguments, "--port", "0"],
        cwd=folder,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )
    watch = threading.Timer(PATIENCE_S, process.kill)
    watch.start()
    try:
        said, link = _until_the_link(process)
        open_link(link)
        meanwhile(link)
        return said
    finally:
        watch.cancel()
        process.terminate()
        process.communicate(timeout=60)


def environment() -> dict[str, str]:
    """Return the variables of this process without Python's own, so that nothing of a checkout is found by chance."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return kept | {"PYTHONUTF8": "1"}


def _until_the_link(process: "subprocess.Popen[str]") -> tuple[str, str]:
    said: list[str] = []
    assert process.stderr is not None
    for line in process.stderr:
        said.append(line)
        if line.startswith("Ready."):
            return "".join(said), re.findall(r"http://127\.0\.0\.1:\d+/\S*", "".join(said))[0]
    raise AssertionError("The app ended before it was ready:\n" + "".join(said))


def open_link(link: str) -> str:
    """Open a link as a browser does, and ask for something with its token; return the token."""
    opener = build_opener(ProxyHandler({}))
    with opener.open(link, timeout=60) as page:
        text = page.read()
    assert page.status == 200, page.status
    assert b"<html" in text.lower(), text[:200]
    (token,) = parse_qs(urlsplit(link).fragment)["token"]
    ready = Request(link.split("#")[0] + "ready/0.json", headers={"Authorization": f"Bearer {token}"})
    with opener.open(ready, timeout=60) as answer:
        assert answer.status == 200, answer.status
    return token


def installed_program() -> Path:
    """Return the `ltvn` that belongs to the running Python."""
    return Path(sysconfig.get_path("scripts")) / ("ltvn.exe" if sys.platform == "win32" else "ltvn")


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute() if len(sys.argv) > 1 else installed_program())
