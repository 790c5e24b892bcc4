"""Scripts that draw the figures and write the tables of `docs/`; no part of the installed packages."""
