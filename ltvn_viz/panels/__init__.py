"""The GUI parts of the page, one class each.

A panel builds its controls once, sends commands through a callback, and updates only what changed. It does not access
the session. Buttons that move the robot or write files are plain HTML, because their clicks go through the check of the
driver's seat: a page that only watches cannot press them.
"""
