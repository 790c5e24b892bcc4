"""The GUI parts of the page, one class each.

A panel builds its controls once, passes commands on through the function it was given, and writes only what changed.
It never meets the session. Buttons that move the robot or write files are plain HTML, because clicks on those travel
with the driver's seat: whoever only watches cannot press them.
"""
