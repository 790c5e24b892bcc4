"""Pictures of a page as files for the documentation. Owns how they are made small."""

import io
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page

from tests.waiting import PATIENCE_MS


def shown(page: Page) -> Image.Image:
    """Return what the window shows."""
    return Image.open(io.BytesIO(page.screenshot(timeout=PATIENCE_MS))).convert("RGB")


def save(page: Page, path: Path, most_bytes: int) -> None:
    """Save what the window shows as WebP, with as many colours as fit into so many bytes and no other loss."""
    path.parent.mkdir(parents=True, exist_ok=True)
    seen = shown(page)
    for colours in (256, 128, 64, 32):
        few = seen.quantize(colours, dither=Image.Dither.NONE).convert("RGB")
        few.save(path, "WEBP", lossless=True)
        if path.stat().st_size <= most_bytes:
            break
    sys.stdout.write(f"{path.name}: {path.stat().st_size // 1000} kB, {colours} colours\n")
    sys.stdout.flush()
