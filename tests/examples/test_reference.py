"""The reference page shows each public name in use; `tests/packaging/test_printed_code.py` runs its code."""

import re
from pathlib import Path

import pytest

import ltvn_core as ltvn

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
CODE = "\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
ROWS = re.findall(r"^\|.*\.py` \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("name", sorted(set(ltvn.__all__) - {"__version__"}))
def test_each_public_name_has_an_example(name: str) -> None:
    if f"ltvn.{name}" in CODE:
        return
    rows = [row for row in ROWS if f"`{name}`" in row]
    assert rows, "neither in the table nor in the code of docs/reference.md"
    for row in rows:
        examples = [ROOT / "examples" / path for path in re.findall(r"`(\d\d_\w+\.py)`", row)]
        assert any(f"ltvn.{name}" in path.read_text(encoding="utf-8") for path in examples)
