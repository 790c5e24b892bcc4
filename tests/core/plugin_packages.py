"""Packages that offer plug-ins, as pip would leave them in a folder, and the command line that finds them."""

import os
import subprocess
import sys
from pathlib import Path


def install(folder: Path, package: str, entry_points: str, *, source: str = "", version: str = "1.0") -> None:
    """Put a package of one module into a folder as pip would."""
    module = package.replace("-", "_")
    metadata = folder / f"{module}-{version}.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n", encoding="utf-8"
    )
    (metadata / "entry_points.txt").write_text(entry_points, encoding="utf-8")
    (folder / f"{module}.py").write_text(source, encoding="utf-8")


def ltvn(packages: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run the command line where the packages of a folder are installed too."""
    paths = os.pathsep.join([str(packages), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [sys.executable, "-m", "ltvn_core.cli", *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
        timeout=120,
    )
