"""Images that a person uploads as goals: read upright and small, and refused before they cost memory."""

import asyncio
import io
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import viser
from PIL import Image

from ltvn_core.errors import ImageError
from ltvn_viz.panels.navigation_panel import NavigationPanel, decode_upload
from ltvn_viz.wishes import commands as c

_MEASURE = """
import io, re, sys
from pathlib import Path
from PIL import Image
from ltvn_core.network.allocator import retain_freed_memory
from ltvn_viz.panels.navigation_panel import decode_upload

def memory_mb(name):
    return int(re.search(name + r":\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024

retain_freed_memory()
small = io.BytesIO()
Image.new("RGB", (640, 480)).save(small, "PNG")
decode_upload("small", small.getvalue())
before = memory_mb("VmRSS")
for bomb in sys.argv[1:]:
    content = Path(bomb).read_bytes()
    Path("/proc/self/clear_refs").write_text("5")  # The peak is measured anew.
    decode_upload("bomb", content)
    del content
    print(memory_mb("VmHWM") - before, memory_mb("VmRSS") - before)
"""


def jpeg(width: int = 320, height: int = 240) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)).save(buffer, "JPEG")
    return buffer.getvalue()


def test_an_image_of_any_size_is_read_upright_and_made_small() -> None:
    assert decode_upload("goal.jpg", jpeg(640, 480)).shape == (480, 640, 3)
    assert max(decode_upload("goal.jpg", jpeg(4000, 3000)).shape) <= 1280


def test_a_grey_image_of_16_bits_keeps_its_levels() -> None:
    levels = np.linspace(0, 65_535, 320 * 240).reshape(240, 320).astype(np.uint16)
    buffer = io.BytesIO()
    Image.fromarray(levels).save(buffer, "PNG")
    found = decode_upload("grey.png", buffer.getvalue())[..., 0].astype(float)
    np.testing.assert_allclose(found, levels / 257, atol=1.0)


@pytest.mark.parametrize("content", [b"", b"not a picture", jpeg()[:200], b"GIF89a" + bytes(100)])
def test_anything_else_that_is_uploaded_is_a_clear_error(content: bytes) -> None:
    with pytest.raises(ImageError, match=r"evil\.jpg.*JPEG, PNG"):
        decode_upload("evil.jpg", content)


def test_an_image_with_absurdly_many_pixels_is_refused_unread() -> None:
    buffer = io.BytesIO()
    Image.new("1", (12_000, 12_000)).save(buffer, "PNG")
    with pytest.raises(ImageError, match="too many"):
        decode_upload("bomb.png", buffer.getvalue())


def test_the_largest_images_take_little_memory_and_give_it_back(tmp_path: Path) -> None:
    for kind, size in (("PNG", (4000, 3000)), ("WEBP", (4000, 3000)), ("BMP", (4000, 3000)), ("JPEG", (5000, 5000))):
        options = {"JPEG": {"progressive": True}, "WEBP": {"lossless": True}}.get(kind, {})
        Image.new("RGB" if kind == "JPEG" else "RGBA", size).save(tmp_path / kind, kind, **options)
    bombs = [str(path) for path in sorted(tmp_path.iterdir())]
    measured = subprocess.check_output([sys.executable, "-c", _MEASURE, *bombs], text=True).splitlines()
    assert len(measured) == 4
    for bomb, line in zip(bombs, measured, strict=True):
        peak_mb, after_mb = map(float, line.split())
        assert peak_mb < 300, bomb
        assert after_mb < 100, bomb


def test_of_two_uploads_at_once_one_is_read_and_neither_file_is_kept(gui: viser.GuiApi) -> None:
    panel = NavigationPanel(gui, lambda _: None, str)

    async def upload_twice() -> list[c.NavigateToImage | c.ReportError]:
        asked = []
        for name in ("first.jpg", "second.jpg"):
            panel._upload._impl.value = viser.UploadedFile(name, jpeg())
            asked.append(asyncio.create_task(panel._read_upload()))
            await asyncio.sleep(0)
        return await asyncio.gather(*asked)

    with ThreadPoolExecutor(1) as thread:  # In this one a browser of other tests may have its loop.
        first, second = thread.submit(asyncio.run, upload_twice()).result()
    assert isinstance(first, c.NavigateToImage)
    assert isinstance(second, c.ReportError)
    assert "second.jpg: another image is still being read" in second.text
    assert panel._upload.value.content == b""


def test_a_side_beyond_all_measure_is_refused_unread() -> None:
    buffer = io.BytesIO()
    Image.new("1", (60_000, 10)).save(buffer, "PNG")
    with pytest.raises(ImageError, match="too many"):
        decode_upload("line.png", buffer.getvalue())
