"""Draw a recording anew as today's recorder does: `python -m tools.redraw OLD.rrd NEW.rrd`.

Frames and events stay as they are. What Rerun shows of them is made again: colours, curves, the layout, and the scene
where it is one that can be simulated.
"""

import argparse
import sys
from pathlib import Path

from ltvn_core.atomic_files import atomic_output
from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rewriting import rewrite
from ltvn_core.errors import SceneError
from ltvn_core.simulation.scene_registry import load_scene


def redraw(path: Path, output: Path) -> None:
    """Write a recording to a new file. Raises RecordingError when it is not whole or `output` exists."""
    verify(path)
    recording = Recording.open(path)
    with atomic_output(output) as part:
        rewrite(recording, part, recording.frames, recording.events, scene_glb=_scene(recording.meta.scene))
    verify(output)


def _scene(name: str) -> bytes | None:
    try:
        return load_scene(name).glb()
    except SceneError:
        return None  # A real place, of which nobody has a model.


def main() -> int:
    """Parse the command line and redraw the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path)
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    redraw(options.recording, options.output)
    sys.stdout.write(f"{options.output} holds {options.recording}, drawn anew\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
