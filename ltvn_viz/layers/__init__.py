"""3D parts of the page, one class each."""
