"""The “Go” tab: goals by image, and the running query.

Uploaded images are decoded defensively, because a file of a hundred kilobytes can expand to gigabytes: the size is read
from the header before any pixel is decoded, and the image is scaled down before it is copied.
"""

import asyncio
import io
import warnings
from collections.abc import Callable
from html import escape

import numpy as np
import viser
from PIL import Image, ImageOps, UnidentifiedImageError

from ltvn_core.errors import ImageError, LtvnError
from ltvn_core.navigation.events import Outcome
from ltvn_core.network.allocator import return_freed_memory
from ltvn_core.preprocessing import preprocess_image
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId, Rgb
from ltvn_viz.panels.html_widgets import REACHED_BY_TAB, ActionButton, HtmlBlock, button_row, note, toggle
from ltvn_viz.session.snapshot import Snapshot, UploadMatch, WayNodes
from ltvn_viz.wishes.commands import Command, NavigateToImage, ReportError
from ltvn_viz.wishes.modes import STANDING, Mode
from ltvn_viz.wishes.wish_table import Action

GO_TO_UPLOAD = "Go to an uploaded image"
FIND_UPLOAD = "Find an uploaded image in this map"
MOST_PIXELS = {"JPEG": 25_000_000, "PNG": 12_000_000, "WEBP": 12_000_000, "BMP": 12_000_000}
"""Maximum number of pixels by format, enough for cameras and screens; decoding needs at most 256 MB for a moment."""
MOST_SIDE = 20_000
LEAST_SIDE = 480
"""Least length of the shorter side in pixels after an image was scaled down by an integer factor."""


class NavigationPanel:
    """The offered goal images, and the progress of the query."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None], file_address: Callable[[str], str]) -> None:
        """Add the controls to the open tab; `send` takes commands and returns at once.

        `file_address` adds the key for loading a picture to the address of a file.
        """
        self._file_address = file_address
        HtmlBlock(gui, note("Click an image, or a node of the map, and the robot drives there with its camera."))
        self.task = HtmlBlock(gui)
        self.state = HtmlBlock(gui)
        self.way = HtmlBlock(gui)
        self._upload = gui.add_upload_button(
            GO_TO_UPLOAD,
            icon=viser.Icon.PHOTO_UP,
            color=(73, 80, 87),
            mime_type="image/*",
            hint="JPEG, PNG or WebP",
        )
        self.upload_match = HtmlBlock(gui)
        self.gallery = HtmlBlock(gui)
        self.more = HtmlBlock(gui)

        self._is_decoding = False

        @self._upload.on_upload
        async def _(_: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            send(await self._read_upload())

    async def _read_upload(self) -> NavigateToImage | ReportError:
        """Decode the uploaded image, one at a time, and release the file."""
        file = self._upload.value
        self._upload._impl.value = viser.UploadedFile("", b"")
        if self._is_decoding:
            return ReportError(f"{file.name}: another image is still being read; upload this one once more.")
        self._is_decoding = True
        try:
            image = await asyncio.to_thread(decode_upload, file.name, file.content)
            return NavigateToImage(preprocess_image(image, file.name), image)
        except LtvnError as error:
            return ReportError(str(error))
        finally:
            self._is_decoding = False

    def show(self, snapshot: Snapshot) -> None:
        """Show the offered goals and the query."""
        label = FIND_UPLOAD if snapshot.mode is Mode.REPLAY else GO_TO_UPLOAD
        if self._upload.label != label:
            self._upload.label = label
        is_closed = snapshot.mode not in STANDING
        if self._upload.disabled != is_closed:
            self._upload.disabled = is_closed
        self.task.show(_task(snapshot))
        self.state.show(_state(snapshot))
        self.way.show(self._way(snapshot.way))
        self.upload_match.show("" if snapshot.upload is None else self._match(snapshot.upload, snapshot.selected))
        self.gallery.show(self._goals(snapshot))
        self.more.show(_more(snapshot))

    def _goals(self, snapshot: Snapshot) -> str:
        if not snapshot.gallery:
            return note("Drive a little: goal images appear as the map grows.")
        images = "".join(self._goal_image(int(node), snapshot.selected) for node in snapshot.gallery)
        return f'<div class="lt">{_titled_group("Places to go to", images)}</div>'

    def _way(self, way: WayNodes | None) -> str:
        """Return the pictures of the localised node, the subgoal and the goal, side by side, each with its room kept
        free until there is one."""
        figures = zip(("Here", "Next", "Goal"), (None, None, None) if way is None else way, strict=True)
        pictures = "".join(self._way_image(name, node) for name, node in figures)
        return f'<div class="lt lt-way">{_titled_group("On the way", pictures)}</div>'

    def _way_image(self, name: str, node: NodeId | None) -> str:
        if node is None:
            return f'<figure><span class="lt-none"></span><figcaption>{name}</figcaption></figure>'
        address = escape(self._file_address(f"/thumb/{node}.jpg"))
        image = f'<img src="{address}" alt="{name}: node {node}">'
        return f"<figure>{image}<figcaption>{name} · node {node}</figcaption></figure>"

    def _match(self, upload: UploadMatch, selected: NodeId | None) -> str:
        own = f'<h2>Your image</h2><img src="{upload.picture}" alt="your image">'
        places = "".join(
            f"<figure>{self._goal_image(int(place.node), selected)}"
            f"<figcaption>node {place.node}, likeness {place.likeness:.2f}</figcaption></figure>"
            for place in upload.places
        )
        return f'<div class="lt lt-upload"><div>{own}</div><div>{_titled_group(LOOKS_LIKE_IT, places)}</div></div>'

    def _goal_image(self, node: NodeId, selected: NodeId | None) -> str:
        return (
            f'<img src="{escape(self._file_address(f"/thumb/{node}.jpg"))}" data-ltvn-action="{Action.SELECT}" '
            f'data-id="{node}" {REACHED_BY_TAB} alt="goal {node}" title="go to node {node}" '
            f'class="{"lt-chosen" if node == selected else ""}">'
        )


LOOKS_LIKE_IT = "Places in the map that look like it"


def _titled_group(title: str, content: str) -> str:
    return f'<h2>{title}</h2><div class="lt-gallery" role="group" aria-label="{title}">{content}</div>'


def _task(snapshot: Snapshot) -> str:
    busy = snapshot.mode in (Mode.NAVIGATING, Mode.PAUSED)
    paused = snapshot.mode is Mode.PAUSED
    resume = "Go on" if snapshot.pause_notice else "Resume"
    pause = ActionButton(Action.PAUSE, resume if paused else "", is_main=paused, is_enabled=busy)
    return button_row(
        ActionButton(Action.GOAL, is_main=True, is_enabled=snapshot.selected is not None),
        pause,
        ActionButton(Action.CANCEL, is_enabled=busy),
        mode=snapshot.mode,
    )


def _more(snapshot: Snapshot) -> str:
    """Return what a query seldom needs; a real robot has no queries that continue without a page."""
    busy = snapshot.mode in (Mode.NAVIGATING, Mode.PAUSED)
    buttons = button_row(
        ActionButton(Action.STEP),
        ActionButton(Action.CANCEL, "Take over", "W A S D", "end the query and drive yourself", is_enabled=busy),
        mode=snapshot.mode,
    )
    keeps_going = snapshot.keeps_going
    return buttons + ("" if keeps_going is None else toggle(Action.KEEP_GOING, is_on=keeps_going))


def _state(snapshot: Snapshot) -> str:
    progress = snapshot.moment.progress
    if progress.query is not None:
        text = f"{progress.navigator} · {count_text(len(progress.plan), 'node')} planned"
        if progress.localised is not None and progress.localised.node is not None:
            text += f" · at node {progress.localised.node} (d {progress.localised.distance:.2f})"
        if snapshot.selected is not None and snapshot.way is not None and snapshot.selected != snapshot.way.goal:
            text += f" · next goal: node {snapshot.selected}"
    elif progress.ended is not None:
        text = _ending(progress.ended.outcome, snapshot)
        if snapshot.selected is not None and snapshot.selected != progress.ended.goal:
            text += f" Next goal: node {snapshot.selected}."
    elif snapshot.selected is not None:
        text = f"Goal: node {snapshot.selected}."
    else:
        text = "No goal yet."
    return note(text)


def _ending(outcome: Outcome, snapshot: Snapshot) -> str:
    judged = snapshot.moment.progress.judged
    truth = "" if judged is None else f", in truth {judged.position_error_m:.2f} m from the goal"
    return f"Last query: {outcome}{truth}."


_PER_LEVEL_OF_8_BIT = 257
"""Number of levels of a 16-bit image per level of an 8-bit image."""


def decode_upload(name: str, content: bytes) -> Rgb:
    """Decode an uploaded file into an image (H, W, 3) of moderate size; raises ImageError."""
    try:
        return _decoded(name, content)
    finally:
        return_freed_memory()


def _decoded(name: str, content: bytes) -> Rgb:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(content), formats=tuple(MOST_PIXELS))
        with image:
            _check_size(name, image)
            return np.asarray(ImageOps.exif_transpose(_smaller(image)).convert("RGB"))
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ImageError(f"{name}: this is not a complete image. Upload a JPEG, PNG, WebP or BMP file.") from error


def _check_size(name: str, image: Image.Image) -> None:
    most = MOST_PIXELS[image.format or ""]
    if image.width * image.height > most or max(image.size) > MOST_SIDE:
        raise ImageError(
            f"{name}: {image.width} x {image.height} pixels are too many; at most {most // 10**6} million are "
            f"allowed for {image.format}, and {MOST_SIDE:,} per side. Scale it down first."
        )


def _smaller(image: Image.Image) -> Image.Image:
    """Decode an image at reduced size."""
    image.draft("RGB", (2 * LEAST_SIDE, 2 * LEAST_SIDE))  # JPEG can be decoded at a reduced size.
    if image.mode.startswith("I"):  # Pillow's conversion would clip 16 bits to white.
        image = Image.fromarray((np.asarray(image) / _PER_LEVEL_OF_8_BIT).astype(np.uint8))
    if image.mode not in ("L", "RGB"):
        image = image.convert("RGB")
    factor = min(image.size) // LEAST_SIDE
    return image.reduce(factor) if factor > 1 else image
