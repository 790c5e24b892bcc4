"""The style of figures: small files for the documentation, and SVG for the HTML pages of evaluations.

Owns fonts, colours of text, the file size, the colours of methods and causes, and SVG that inherits the text colour of
its page. The other colours come from the page's palette, through `FigurePalette`.
"""

import io
import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, PercentFormatter, StrMethodFormatter
from PIL import Image

from ltvn_core import palette
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.palette import PROBABILITY_RAMP_ON_WHITE

MAX_BYTES = 150_000
"""Largest size of a figure's file."""
DOTS_PER_INCH = 150
_COLOURS_OF_DRAWING = 10_000
"""Number of colours above which a picture counts as a photograph."""
Colour: TypeAlias = tuple[float, float, float]
"""Red, green, blue in [0, 1]."""
WIDTH_IN = 8.4
"""Width of a figure in inches, as on the other pages."""
_MORE_COLOURS: tuple[Colour, ...] = (
    (0.0, 0.6, 0.45),
    (0.78, 0.24, 0.32),
    (0.55, 0.45, 0.1),
    (0.25, 0.62, 0.75),
    (0.5, 0.5, 0.5),
    (0.95, 0.62, 0.1),
    (0.93, 0.5, 0.72),
)
_CAUSE_COLOURS: dict[FailureCause, Colour] = {
    FailureCause.MISLOCALISED: (0.8, 0.47, 0.65),
    FailureCause.SPURIOUS_EDGE: (0.84, 0.37, 0.0),
    FailureCause.WRONG_ARRIVAL: (0.9, 0.62, 0.0),
    FailureCause.COLLISION: (0.0, 0.45, 0.7),
    FailureCause.NO_PATH: (0.34, 0.71, 0.91),
    FailureCause.STEP_LIMIT: (0.55, 0.57, 0.6),
}


@dataclass(frozen=True, slots=True)
class FigurePalette:
    """Colours on white that are distinguishable with every common kind of colour blindness."""

    first: Colour
    """Colour of source images and of the first series."""
    second: Colour
    """Colour of target images and of the second series."""
    third: Colour
    """Colour of the network's predictions."""
    grey: Colour = (0.45, 0.47, 0.5)
    """Colour of series for comparison."""
    text: Colour = (0.13, 0.15, 0.18)


FIGURE_PALETTE = FigurePalette(palette.SOURCE.on_white, palette.TARGET.on_white, palette.GOAL.on_white)
"""The colours of the page, as ink on white."""


@contextmanager
def documentation_style(palette: FigurePalette) -> Iterator[None]:
    """Draw in the style of the documentation: white background, few lines, and text in the size of the page's text."""
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
        raise OptionError(f"{path}: the figure could not be written ({error}); choose another --output.") from error
    return path


def small_png(png: bytes) -> bytes:
    """Return a picture with 256 colours, and with fewer colours and pixels until it is small enough."""
    whole = Image.open(io.BytesIO(png)).convert("RGB")
    small = png
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
    """Return the quantization method: for drawings it limits the largest error, for photographs the mean error."""
    is_drawing = picture.getcolors(_COLOURS_OF_DRAWING) is not None
    return Image.Quantize.MAXCOVERAGE if is_drawing else Image.Quantize.MEDIANCUT


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """A figure with its title and caption; `draw` creates it."""

    kind: str
    """Part of the report that the figure belongs to."""
    name: str
    """File name without extension."""
    title: str
    caption: str
    """Description in short sentences."""
    draw: Callable[[], Figure]
    """Creates the figure; call it inside `drawing`."""


def method_colours(methods: Sequence[str], palette: FigurePalette) -> dict[str, Colour]:
    """Return a colour for each method; the same methods in the same order get the same colours."""
    colours = (palette.first, palette.second, palette.third, *_MORE_COLOURS)
    return {method: colours[number % len(colours)] for number, method in enumerate(methods)}


def cause_colour(cause: FailureCause) -> Colour:
    """Return the colour of a cause; they are distinguishable with every common kind of colour blindness."""
    return _CAUSE_COLOURS[cause]


def probability_colour_map() -> LinearSegmentedColormap:
    """Return the colours of p from 0 to 1 on white."""
    return LinearSegmentedColormap.from_list("p", (PROBABILITY_RAMP_ON_WHITE / 255).tolist())


def in_percent(axes: Axes, **limits: Any) -> None:
    """Write the y axis in percent."""
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.set(**limits)


def in_counts(axes: Axes) -> None:
    """Write a logarithmic y axis with a few whole numbers. Call it after everything is drawn."""
    low, high = axes.get_ylim()
    decades = math.log10(high / low)
    subs = (1.0,) if decades > 3 else (1.0, 2.0, 5.0) if decades > 1 else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
    axes.yaxis.set_major_locator(LogLocator(subs=subs, numticks=8))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def slug(text: str) -> str:
    """Return a text as part of a file's name."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "unnamed"


def inline_svg(picture: ReportFigure, palette: FigurePalette) -> str:
    """Return a figure as an SVG element for an HTML page, in the page's colours, without external links."""
    buffer = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": picture.name}):
        picture.draw().savefig(buffer, format="svg", transparent=True, metadata=nothing, dpi=160)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", text).replace("xlink:href", "href")
    # Two equal images would have the same id, and nothing refers to it.
    text = re.sub(r'(<image\b[^>]*?)\sid="[^"]*"', r"\1", text)
    # Several figures share one page, so every id must be unique.
    text = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{picture.name}-", text)
    # Axes are black, whatever the text colour.
    text = re.sub(f"#000000|{to_hex(palette.text)}", "currentColor", text)
    text = text.replace(str(mpl.rcParams["grid.color"]), "var(--line)")
    return text.replace("<svg ", '<svg role="img" ', 1)
