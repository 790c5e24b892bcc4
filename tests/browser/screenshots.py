"""Pictures of a page as files for the documentation. Owns how they are made small."""

import io
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page

from tests.waiting import PATIENCE_MS

QUALITY = 70
"""Of 100."""


def shown(page: Page) -> Image.Image:
    """Return what the window shows."""
    return Image.open(io.BytesIO(page.screenshot(timeout=PATIENCE_MS))).convert("RGB")


def save(page: Page, path: Path) -> None:
    """Save what the window shows."""
    save_image(shown(page), path)


def save_image(image: Image.Image, path: Path) -> None:
    """Save a picture as WebP, at a quality at which small print is still sharp."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image.save(path, "WEBP", quality=QUALITY, method=6)
    sys.stdout.write(f"{path.name}: {path.stat().st_size // 1000} kB\n")
    sys.stdout.flush()
