"""Everything stands in pyproject.toml; this adds the demo recordings, which live in `recordings/`, to the wheel."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

DEMO_FILES = ("demo-map.rrd", "demo-fault.rrd")


class BuildWithDemoFiles(build_py):
    """Copies the demo files to where `ltvn_core.data.recording.demo_files` finds them in an installed package."""

    def run(self) -> None:
        """Build as usual, then copy."""
        super().run()
        if self.editable_mode:
            return  # A checkout reads them where they are.
        folder = Path(self.build_lib) / "ltvn_core" / "data" / "recording" / "demo"
        folder.mkdir(parents=True, exist_ok=True)
        for name in DEMO_FILES:
            shutil.copyfile(Path(__file__).parent / "recordings" / name, folder / name)


setup(cmdclass={"build_py": BuildWithDemoFiles})
