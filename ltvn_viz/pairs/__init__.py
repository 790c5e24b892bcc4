"""The viewer of labelled pairs: a separate page behind the same guard.

`pair_browser` knows which pair is looked at, `pair_panel` shows it, `pairs_app` has the scene and puts them together.
"""
