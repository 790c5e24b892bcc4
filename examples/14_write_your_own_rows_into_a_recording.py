"""Write rows of your own beside what the toolkit records: a number, a text and an image.

`python examples/14_write_your_own_rows_into_a_recording.py mine.rrd` makes a recording, reads its own rows back and
verifies it. `ltvn view mine.rrd` plots the number over time beside the camera.
"""

import sys
from pathlib import Path

import numpy as np
import rerun as rr

import ltvn_core as ltvn

DEMO = Path(__file__).parents[1] / "recordings" / "demo-drive.rrd"
PLAIN_BELOW = 3.0
"""Mean difference of neighbouring pixels, of 255."""


def main(output: Path) -> None:
    """Record thirty images of the demo drive with the contrast of each, and read that back."""
    drive = ltvn.Recording.open(DEMO)
    with ltvn.RecordingWriter(output, scene="demo", camera=drive.meta.camera) as writer:
        for frame in drive.frames[:30]:
            seen = drive.observation(frame)
            edges = np.abs(np.diff(seen.rgb.mean(axis=2), axis=1))
            writer.write_frame(seen)
            writer.log("my/contrast", float(edges.mean()))  # A number is plotted.
            writer.log("my/edges", rr.Image(edges.clip(0, 255).astype(np.uint8)))  # Rerun's archetypes work too.
            if edges.mean() < PLAIN_BELOW:
                writer.log("my/remarks", rr.TextLog(f"image {frame} shows little but walls"))

    written = ltvn.Recording.open(output)
    rows: dict[str, int] = {}
    for batch in written.user_rows():
        entity = (batch.schema.metadata or {})[b"rerun:entity_path"].decode()
        rows[entity] = rows.get(entity, 0) + batch.num_rows
    for entity, count in sorted(rows.items()):
        print(f"{entity}: {count} rows")
    print(f"{output}: whole, {len(written.frames)} images")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "mine.rrd"))
