"""The viewer of labelled pairs: a page of its own behind the same guarded door.

`pair_browser` knows which pair is looked at, `pair_panel` shows it, `pairs_app` has the scene and puts them together.
"""
