"""Checks for the optional libraries of the extra `ltvn[docs]`, which draw figures and pages."""

from importlib.util import find_spec

from ltvn_core.errors import OptionError


def require_docs_extra() -> None:
    """Raise OptionError if a library that draws figures and pages is not installed."""
    if missing := [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]:
        raise OptionError(f"Drawing needs {' and '.join(missing)}, which is not installed: pip install 'ltvn[docs]'.")
