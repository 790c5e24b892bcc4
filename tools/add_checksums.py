"""Give finished recordings of before a closing record: `python -m tools.add_checksums RECORDING.rrd...`.

Each message stays byte for byte as it is. Behind the last one, Rerun's table of all chunks makes way for the checksums
of the messages and the counts of the rows. A file that has them is left alone.
"""

import argparse
import sys
from pathlib import Path

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.recording import rrd_framing, schema
from ltvn_core.recording.closing_record import RecordingEnding
from ltvn_core.recording.integrity import verify
from ltvn_core.recording.reader import Recording


def add_checksums(path: Path) -> bool:
    """Rewrite one recording, and tell whether that was needed. Raises RecordingError when it is not whole."""
    if verify(path).checksummed:
        return False
    recording, ending = Recording.open(path), RecordingEnding()
    for entity in schema.READ_BACK:
        if count := recording.row_count(entity):
            ending.rows[entity] = count
    if recording.scene_glb() is not None:
        ending.static_rows[schema.SCENE] = 1
    with path.open("rb") as old, atomic_replacement(path) as part, part.open("xb") as new:
        sizes = [message.size for message in rrd_framing.walk_messages(old, path.stat().st_size)]
        old.seek(0)
        for size in (rrd_framing.HEADER_BYTES, *sizes):
            block = old.read(size)
            ending.count(block)
            new.write(block)
        new.write(ending.encoded(complete=True))
    return True


def main() -> int:
    """Parse the command line and convert the files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", type=Path, nargs="+")
    for path in parser.parse_args().recordings:
        done = "has its checksums now" if add_checksums(path) else "has them already"
        sys.stdout.write(f"{path} {done}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
