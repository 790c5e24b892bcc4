"""GUI parts of the page, one class each."""
