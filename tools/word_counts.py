"""Count the words of the documents, tables and code left out: `python -m tools.word_counts [ROOT]`.

A reader meets sentences; tables of measurements and commands are looked up. Pages of the lab notebook are records and
are counted apart. Ends with status 1 where a page is longer than its budget.
"""

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

BUDGETS = {
    "README.md": 700,
    "docs/architecture.md": 2_500,
    "docs/network.md": 1_050,
    "docs/predictors.md": 1_000,
    "docs/presence.md": 1_000,
    "docs/results.md": 3_000,
    "docs/systems.md": 1_500,
}
"""The most words that a page may have."""
ALL_WORDS = 25_000
"""The most words that all pages together may have, the lab notebook left out."""
NOTEBOOK = Path("docs/lab-notebook")

_FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
_LOOKED_UP = ("|", "<!--", "![", "--8<--")


def words_of(text: str) -> int:
    """Return how many words of a Markdown page stand in sentences and headings."""
    lines = _FENCED.sub("", text).splitlines()
    read = (line for line in lines if not line.lstrip().startswith(_LOOKED_UP) and not line.startswith("    "))
    return sum(len(line.split()) for line in read)


def pages(root: Path) -> Iterator[Path]:
    """Yield all documents of a repository, relative to its root."""
    for folder, pattern in ((root, "*.md"), (root / "docs", "**/*.md"), (root / "recordings", "*.md")):
        yield from (page.relative_to(root) for page in sorted(folder.glob(pattern)))


def main(arguments: Iterable[str]) -> int:
    """Print a line for each page and a sum; return the exit status."""
    root = Path(next(iter(arguments), "."))
    counts = {page: words_of((root / page).read_text(encoding="utf-8")) for page in pages(root)}
    guides = {page: words for page, words in counts.items() if NOTEBOOK not in page.parents}
    too_long = {page for page, words in guides.items() if words > BUDGETS.get(page.as_posix(), ALL_WORDS)}
    for page, words in sorted(guides.items(), key=lambda item: -item[1]):
        sys.stdout.write(f"{words:6,}  {page}{f', at most {BUDGETS[page.as_posix()]:,}' if page in too_long else ''}\n")
    total = sum(guides.values())
    sys.stdout.write(
        f"{total:6,}  in all, at most {ALL_WORDS:,}; {sum(counts.values()) - total:,} more in the lab notebook\n"
    )
    return int(bool(too_long) or total > ALL_WORDS)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
