"""The libraries of the extra `ltvn[docs]`, with which figures and pages are made; the toolkit works without them."""

from importlib.util import find_spec

from ltvn_core.errors import OptionError


def require_docs_extra() -> None:
    """Raise OptionError where a library is not installed with which figures and pages are made."""
    if missing := [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]:
        raise OptionError(f"Drawing needs {' and '.join(missing)}, which is not installed: pip install 'ltvn[docs]'.")
