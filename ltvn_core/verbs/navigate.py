"""`ltvn navigate`: drive by a saved map."""

from dataclasses import dataclass

from ltvn_core.verbs.navigate_options import NavigateOptions


@dataclass(frozen=True, kw_only=True)
class NavigateVerb(NavigateOptions):
    """Drive to one goal or to several by a saved map, with the navigation system that built it and as it maintains."""

    job = "ltvn_core.verbs.jobs.navigate:navigate"
