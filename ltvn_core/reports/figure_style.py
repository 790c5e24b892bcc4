"""The style of figures in the documentation, and saving them as small files.

Owns fonts, inks and the file size. The colours come from the page's palette, through `FigurePalette`.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from ltvn_core import palette
from ltvn_core.errors import OptionError

MAX_BYTES = 150_000
"""Largest size of a figure's file."""

DOTS_PER_INCH = 150

_COLOURS_OF_DRAWING = 10_000
"""More are those of photographs."""

Colour: TypeAlias = tuple[float, float, float]
"""Red, green, blue in [0, 1]."""


@dataclass(frozen=True, slots=True)
class FigurePalette:
    """Colours on white that are distinguishable with every common kind of colour blindness."""

    first: Colour
    """Source images and the first series."""
    second: Colour
    """Target images and the second series."""
    third: Colour
    """Predictions of the network."""
    grey: Colour = (0.45, 0.47, 0.5)
    """Series for comparison."""
    text: Colour = (0.13, 0.15, 0.18)


FIGURE_PALETTE = FigurePalette(palette.SOURCE.on_white, palette.TARGET.on_white, palette.GOAL.on_white)
"""The colours of the page, as ink on white."""


@contextmanager
def documentation_style(palette: FigurePalette) -> Iterator[None]:
    """Draw in the style of the documentation: white, few lines, text as large as a page's."""
    settings: dict[str, Any] = {
        "font.family": "DejaVu Sans",
        "font.size": 10.5,
        "axes.titlesize": 11,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": "#e6e8eb",
        "grid.linewidth": 0.8,
        "lines.linewidth": 2.0,
        "legend.frameon": False,
        "figure.facecolor": "white",
        "savefig.facecolor": "white",
        "svg.hashsalt": "ltvn",
    }
    settings |= {name: palette.text for name in ("text.color", "axes.labelcolor", "xtick.color", "ytick.color")}
    with mpl.rc_context(settings):  # type: ignore[arg-type]
        yield


def save_png(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG with few colours, of at most `MAX_BYTES`. Raises OptionError."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=DOTS_PER_INCH, format="png", metadata={"Software": None})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(small_png(buffer.getvalue()))
    except OSError as error:
        raise OptionError(f"{path}: the picture could not be written ({error}); choose another --output.") from error
    return path


def small_png(png: bytes) -> bytes:
    """Return a picture with 256 colours, and with fewer colours and pixels until it is small enough."""
    whole, small = Image.open(io.BytesIO(png)).convert("RGB"), png
    for scale, colours in product((1.0, 0.8, 0.65, 0.5), (256, 128, 64)):
        buffer = io.BytesIO()
        size = (round(whole.width * scale), round(whole.height * scale))
        scaled = whole if scale == 1 else whole.resize(size, Image.Resampling.LANCZOS)
        scaled.quantize(colours, method=_method(whole), dither=Image.Dither.NONE).save(buffer, "png", optimize=True)
        small = buffer.getvalue()
        if len(small) <= MAX_BYTES:
            break
    return small


def _method(picture: Image.Image) -> Image.Quantize:
    """Return how to choose colours: in a drawing none must be far off, in photographs most of them must be right."""
    is_drawing = picture.getcolors(_COLOURS_OF_DRAWING) is not None
    return Image.Quantize.MAXCOVERAGE if is_drawing else Image.Quantize.MEDIANCUT
