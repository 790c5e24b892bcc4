"""Damages the bytes of a recording as disks, memory and transfers do, and judges what becomes of it."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrf2.file_check import walk_messages
from ltvn_core.data.recording.rrf2.layout import CHUNK_KIND, HEADER_BYTES, MESSAGE_HEADER, read_chunk
from ltvn_core.errors import LtvnError
from tests.repository import ROOT

_SECONDS = 120
"""A judgement that takes longer is a hang."""


@dataclass(frozen=True)
class Mutation:
    """A damaged copy of a file's bytes."""

    kind: str
    """What was done, and where."""
    data: bytes
    is_one_bit: bool = False


class Fate(StrEnum):
    """What became of a damaged file."""

    REFUSED = "refused"
    """Neither `Recording.open` nor `verify` took it, and both said why; `verify` alone without message checksums."""
    HARMLESS = "harmless"
    """Taken, and all frames and events are as they were; only where the file has no checksums of its messages."""
    ACCEPTED = "accepted"
    """One of them took it: a change that was not noticed."""
    TRACEBACK = "traceback"
    """An error that is not told to people came out of opening, verifying or repairing."""
    ABORTED = "aborted"
    """It ended the process."""
    HUNG = "hung"
    """Nothing happened for two minutes."""


@dataclass(frozen=True)
class Judgement:
    """What opening, verifying and repairing made of a damaged file."""

    number: int
    kind: str
    fate: Fate
    undamaged: int = 0
    """Frames all of whose messages are in the damaged file, byte for byte."""
    recovered: int = 0
    """Those of them that the repaired file holds, exactly."""
    frames: int = 0
    """Of the whole file."""
    saved: int = 0
    """Those of them that the repaired file holds, exactly; also out of damaged messages."""
    is_one_bit: bool = False
    """Whether a single bit was flipped: no frame of another message may be lost."""


def mutate(data: bytes, rng: np.random.Generator) -> Mutation:
    """Damage some of a file's bytes, in one of seven ways; the result always differs."""
    ways = (_flip_bit, _flip_bits, _overwrite, _blank, _delete, _insert, _truncate)
    while True:
        mutation = ways[int(rng.integers(len(ways)))](data, rng)
        if mutation.data != data:
            return mutation


def _flip_bit(data: bytes, rng: np.random.Generator) -> Mutation:
    place, bit = int(rng.integers(len(data))), int(rng.integers(8))
    flipped = _patched(data, place, bytes([data[place] ^ 1 << bit]))
    return Mutation(f"bit {bit} of byte {place} flipped", flipped, is_one_bit=True)


def _flip_bits(data: bytes, rng: np.random.Generator) -> Mutation:
    changed = bytearray(data)
    places = rng.integers(len(data), size=int(rng.integers(2, 9)))
    for place in places:
        changed[place] ^= 1 << int(rng.integers(8))
    return Mutation(f"bits flipped in bytes {sorted(places.tolist())}", bytes(changed))


def _overwrite(data: bytes, rng: np.random.Generator) -> Mutation:
    place, size = _stretch(data, rng)
    return Mutation(f"{size} bytes at {place} random", _patched(data, place, rng.bytes(size)))


def _blank(data: bytes, rng: np.random.Generator) -> Mutation:
    place, size = _stretch(data, rng)
    return Mutation(f"{size} bytes at {place} zero", _patched(data, place, bytes(size)))


def _delete(data: bytes, rng: np.random.Generator) -> Mutation:
    place, size = _stretch(data, rng)
    return Mutation(f"{size} bytes at {place} deleted", data[:place] + data[place + size :])


def _insert(data: bytes, rng: np.random.Generator) -> Mutation:
    place, size = _stretch(data, rng)
    return Mutation(f"{size} bytes put in at {place}", data[:place] + rng.bytes(size) + data[place:])


def _truncate(data: bytes, rng: np.random.Generator) -> Mutation:
    size = int(rng.integers(len(data)))
    return Mutation(f"cut after {size} bytes", data[:size])


def _stretch(data: bytes, rng: np.random.Generator) -> tuple[int, int]:
    size = int(2 ** rng.uniform(0, 12))
    return int(rng.integers(max(1, len(data) - size))), size


def _patched(data: bytes, place: int, patch: bytes) -> bytes:
    return data[:place] + patch + data[place + len(patch) :]


class Recoverable:
    """What can be told of the frames of a whole recording: which messages hold each, and what it looks like."""

    def __init__(self, path: Path) -> None:
        """Read a recording that is whole."""
        self.data = path.read_bytes()
        self._messages = list(_messages(path, self.data))
        self._held = [_frames_of(message) for message in self._messages]
        self.sums = _checksums(path)
        self.events = Recording.open(path).events
        self.has_message_sums = verify(path).checksummed

    def undamaged(self, data: bytes) -> set[int]:
        """Return the frames all of whose messages stand unchanged in other bytes."""
        steps = {step for held in self._held for step in held}
        places = [data.find(message) for message in self._messages]
        return steps - {step for held, place in zip(self._held, places, strict=True) if place < 0 for step in held}


def _messages(path: Path, data: bytes) -> Iterator[bytes]:
    with path.open("rb") as file:
        position = HEADER_BYTES
        for _, _, length in walk_messages(file, len(data)):
            begin, position = position, position + MESSAGE_HEADER.size + length
            yield data[begin:position]


def _frames_of(message: bytes) -> set[int]:
    """Return which frames a message holds a part of."""
    if MESSAGE_HEADER.unpack_from(message)[0] != CHUNK_KIND:
        return set()
    _, entity, batch = read_chunk(message[MESSAGE_HEADER.size :])
    is_image = entity in (f"/{schema.RGB}", f"/{schema.DEPTH}") and schema.STEP in batch.schema.names
    return set(batch.column(schema.STEP).to_pylist()) if is_image else set()


def _checksums(path: Path) -> dict[int, tuple[int, int]]:
    """Return a checksum of what each frame of a recording holds now."""
    recording = Recording.open(path)
    stored = {step: recording.stored_frame(step).frame for step in recording.frames}
    return {step: (frame.rgb_checksum, frame.depth_checksum) for step, frame in stored.items()}


def judge(whole: Recoverable, mutation: Mutation, number: int) -> Judgement:
    """Open, verify and repair a damaged file in this process, which it may end."""
    with TemporaryDirectory() as folder:
        damaged, repaired = Path(folder) / "damaged.rrd", Path(folder) / "repaired.rrd"
        damaged.write_bytes(mutation.data)
        undamaged = whole.undamaged(mutation.data)
        try:
            fate = Fate.REFUSED if _refuses(damaged, by_all=whole.has_message_sums) else _accepted(whole, damaged)
            saved = _saved(damaged, repaired)
        except Exception as error:  # Whatever it is, it would have been a traceback.
            return Judgement(number, f"{mutation.kind}: {error!r}", Fate.TRACEBACK, len(undamaged))
    right = {step for step, sums in whole.sums.items() if saved.get(step) == sums}
    return Judgement(
        number,
        mutation.kind,
        fate,
        undamaged=len(undamaged),
        recovered=len(undamaged & right),
        frames=len(whole.sums),
        saved=len(right),
        is_one_bit=mutation.is_one_bit,
    )


def _accepted(whole: Recoverable, damaged: Path) -> Fate:
    same = _checksums(damaged) == whole.sums and Recording.open(damaged).events == whole.events
    return Fate.HARMLESS if same and not whole.has_message_sums else Fate.ACCEPTED


def _refuses(path: Path, *, by_all: bool) -> bool:
    """Tell whether a file is refused: by `verify`, and with `by_all` on being opened as well."""
    for look in (Recording.open, verify) if by_all else (verify,):
        try:
            look(path)
        except LtvnError:
            continue
        return False
    return True


def _saved(damaged: Path, repaired: Path) -> dict[int, tuple[int, int]]:
    try:
        repair(damaged, repaired)
    except LtvnError:
        return {}
    verify(repaired)
    return _checksums(repaired)


def judge_mutations(path: Path, *, seed: int, count: int, first: int = 0) -> Iterator[Judgement]:
    """Judge the mutations of a whole recording from `first` up to `count`, in processes that may come to an end.

    What `seed` and a mutation's number are, decides what is done to the bytes.
    """
    while first < count:
        command = [sys.executable, "-m", __name__, str(path), str(seed), str(first), str(count)]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT
        ) as judging:
            assert judging.stdout is not None
            try:
                for line in judging.stdout:
                    judged = json.loads(line)
                    first = judged["number"] + 1
                    yield Judgement(**judged | {"fate": Fate(judged["fate"])})
            except GeneratorExit:  # Who asked wants no more.
                judging.kill()
                raise
        if first < count:
            fate = Fate.HUNG if judging.returncode == -signal.SIGALRM else Fate.ABORTED
            kind = mutate(path.read_bytes(), np.random.default_rng([seed, first])).kind
            yield Judgement(first, kind, fate)
            first += 1


def _judge_and_tell(path: Path, seed: int, first: int, count: int) -> None:
    whole = Recoverable(path)
    for number in range(first, count):
        signal.alarm(_SECONDS)
        mutation = mutate(whole.data, np.random.default_rng([seed, number]))
        sys.stdout.write(json.dumps(asdict(judge(whole, mutation, number))) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    _judge_and_tell(Path(sys.argv[1]), *map(int, sys.argv[2:5]))
