"""The viewer of labelled pairs: a separate page behind the same access check.

`pair_browser` selects the pair on show, `pair_panel` shows it, and `pairs_app` draws the scene and connects all parts.
"""
