"""When a drive has no poses, for how many images, and why.

Owns the grouping of such images into outages, and the sentences about them. Independent of formats.
"""

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

NULL = "null"
NOT_FINITE = "not finite"
LOST = "lost by its own covariance"
_MOST_OUTAGES = 3
"""Number of outages that are described one by one."""


@dataclass(slots=True)
class _Outage:
    begin: float
    end: float
    images: int = 1


class PoseOutages:
    """Collects which poses of a source can be used, and which images have none; stamps are in seconds."""

    def __init__(self, source: str) -> None:
        """Take the name of the source of the poses, for the sentences."""
        self._source = source
        self._begin: float | None = None
        self._good: list[float] = []
        self._bad: list[tuple[float, str]] = []
        self._outages: list[_Outage] = []
        self._is_out = False

    def add_pose(self, stamp: float, fault: str = "") -> None:
        """Take a pose, with the reason if it cannot be used."""
        if fault:
            self._bad.append((stamp, fault))
        else:
            self._good.append(stamp)

    def add_image(self, stamp: float, *, has_pose: bool) -> None:
        """Take an image; called for each one in order."""
        self._begin = stamp if self._begin is None else self._begin
        if not has_pose and self._is_out:
            self._outages[-1].end = stamp
            self._outages[-1].images += 1
        elif not has_pose:
            self._outages.append(_Outage(stamp, stamp))
        self._is_out = not has_pose

    def sentences(self) -> Iterator[str]:
        """Yield a sentence for each of the longest outages, in order, and one for all others.

        Without an outage there is one sentence about the poses that could not be used, if there are any.
        """
        if self._bad and not self._outages:
            said = " or ".join(dict.fromkeys(fault for _, fault in self._bad))
            yield f"{len(self._bad)} poses of {self._source} are {said}; they are left out."
        longest = sorted(self._outages, key=lambda outage: -outage.images)[:_MOST_OUTAGES]
        for outage in sorted(longest, key=lambda outage: outage.begin):
            assert self._begin is not None  # There was an image.
            begin, end = outage.begin - self._begin, outage.end - self._begin
            when = f"from {begin:.1f} s to {end:.1f} s" if outage.images > 1 else f"at {begin:.1f} s"
            yield f"{outage.images} images {when} of the drive have no pose: {self._source} {self._cause(outage)}."
        if others := len(self._outages) - len(longest):
            images = sum(each.images for each in self._outages) - sum(each.images for each in longest)
            yield f"{images} images without a pose lie in {others} shorter outages of {self._source}."

    def _cause(self, outage: _Outage) -> str:
        good, stamps = sorted(self._good), sorted(stamp for stamp, _ in self._bad)
        first, last = bisect_right(good, outage.begin), bisect_left(good, outage.end)
        since = good[first - 1] if first else float("-inf")
        until = good[last] if last < len(good) else float("inf")
        faults = Counter(fault for stamp, fault in self._bad if since <= stamp <= until)
        if faults:
            seen = [stamp for stamp in stamps if since <= stamp <= until]
            said = " and ".join(fault for fault, _ in faults.most_common())
            return f"was {said} for {max(seen[-1], outage.end) - min(seen[0], outage.begin):.1f} s"
        if not good:
            return "says nothing of that time"
        if since == float("-inf"):
            return f"begins {good[0] - outage.begin:.1f} s later"
        if until == float("inf"):
            return f"ends {outage.end - good[-1]:.1f} s earlier"
        return f"was silent for {until - since:.1f} s"
