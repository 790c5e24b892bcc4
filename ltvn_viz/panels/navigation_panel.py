"""The “Go” tab: goals by image, and the query under way.

Images that a person uploads are decoded with care: a file of a hundred kilobytes can unfold to gigabytes. So its
header is asked for the size before a pixel is decoded, and pixels are made fewer before they are copied.
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
from ltvn_core.types import NodeId, Rgb
from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, note, toggle
from ltvn_viz.server.keymap import Action
from ltvn_viz.session.commands import Command, NavigateToImage, ReportError
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.snapshot import Snapshot

GO_TO_UPLOAD, FIND_UPLOAD = "Go to an uploaded image", "Find an uploaded image in this map"
MOST_PIXELS = {"JPEG": 25_000_000, "PNG": 12_000_000, "WEBP": 12_000_000, "BMP": 12_000_000}
"""By format, as cameras take and screens show them; decoding needs at most a quarter of a gigabyte for a moment."""
MOST_SIDE = 20_000
LEAST_SIDE = 480
"""A larger image is made smaller by a whole factor, but not below this."""


class NavigationPanel:
    """Images to go to, and how it goes."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None], file_address: Callable[[str], str]) -> None:
        """Add the controls to the tab that is open; `send` takes commands and returns at once.

        `file_address` makes the address of a file one that a picture of this page may be loaded from.
        """
        self._file_address = file_address
        HtmlBlock(gui, note("Click an image, or a node in the scene, and the robot drives there by what it sees."))
        self.task, self.keep_going = HtmlBlock(gui), HtmlBlock(gui)
        self.state, self.gallery = HtmlBlock(gui), HtmlBlock(gui)
        self._upload = gui.add_upload_button(
            GO_TO_UPLOAD,
            icon=viser.Icon.PHOTO_UP,
            color=(73, 80, 87),
            mime_type="image/*",
            hint="JPEG, PNG or WebP",
        )
        self._matching_nodes = HtmlBlock(gui)

        self._is_decoding = False

        @self._upload.on_upload
        async def _(_: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            send(await self._read_upload())

    async def _read_upload(self) -> NavigateToImage | ReportError:
        """Decode the uploaded image, one at a time, and let go of the file."""
        file, self._upload._impl.value = self._upload.value, viser.UploadedFile("", b"")
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
        """Show the goals on offer and the query."""
        label = FIND_UPLOAD if snapshot.mode is Mode.REPLAY else GO_TO_UPLOAD
        if self._upload.label != label:
            self._upload.label = label
        self.task.show(_task(snapshot))
        self.keep_going.show(_keep_going(snapshot.keeps_going))
        self.state.show(_state(snapshot))
        self.gallery.show(
            self._goal_images(snapshot.gallery, snapshot, "Drive a little: goal images appear as the map grows.")
        )
        self._matching_nodes.show(self._goal_images(snapshot.similar_nodes, snapshot, ""))

    def _goal_images(self, nodes: tuple[NodeId, ...], snapshot: Snapshot, instead: str) -> str:
        if not nodes:
            return note(instead) if instead else ""
        images = "".join(
            f'<img src="{escape(self._file_address(f"/thumb/{node}.jpg"))}" data-ltvn-action="{Action.SELECT}" '
            f'data-id="{node}" alt="goal {node}" title="go to node {node}" '
            f'class="{"lt-chosen" if node == snapshot.selected else ""}">'
            for node in map(int, nodes)
        )
        return f'<div class="lt"><div class="lt-gallery" role="group" aria-label="goal images">{images}</div></div>'


def _task(snapshot: Snapshot) -> str:
    busy, paused = snapshot.mode in (Mode.NAVIGATING, Mode.PAUSED), snapshot.mode is Mode.PAUSED
    ready = snapshot.mode is Mode.TELEOP and snapshot.selected is not None
    resume = "Go on" if snapshot.pause_notice else "Resume"
    pause = ActionButton(Action.PAUSE, resume if paused else "Pause", "P", is_main=paused, is_enabled=busy)
    return button_row(
        ActionButton(Action.GOAL, "Navigate", "G", "go to the chosen goal", is_main=True, is_enabled=ready),
        pause,
        ActionButton(Action.STEP, "Step", ".", "one control step, then pause", is_enabled=busy),
        ActionButton(Action.CANCEL, "Cancel", "Esc", "end the query", is_enabled=busy),
        ActionButton(Action.CANCEL, "Take over", "W A S D", "end the query and drive yourself", is_enabled=busy),
    )


def _keep_going(is_on: bool | None) -> str:
    """Return the switch for runs that nobody watches; a real robot has none."""
    if is_on is None:
        return ""
    return toggle(
        Action.KEEP_GOING,
        "Keep going when this page closes",
        "for long runs in simulation; otherwise a query pauses as soon as no page is open",
        is_on=is_on,
    )


def _state(snapshot: Snapshot) -> str:
    progress = snapshot.moment.progress
    if progress.query is not None:
        text = f"{progress.navigator} · {len(progress.plan)} nodes planned"
        if progress.localised is not None and progress.localised.node is not None:
            text += f" · at node {progress.localised.node} (d {progress.localised.distance:.2f})"
    elif progress.ended is not None:
        text = _ending(progress.ended.outcome, snapshot)
    elif snapshot.selected is not None:
        text = f"Goal: node {snapshot.selected}."
    else:
        text = "No goal yet."
    return note(text)


def _ending(outcome: Outcome, snapshot: Snapshot) -> str:
    judged = snapshot.moment.progress.judged
    truth = "" if judged is None else f", in truth {judged.position_error_m:.2f} m from the goal"
    return f"Last query: {outcome}{truth}."


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
        raise ImageError(f"{name}: this is no whole image. Upload a JPEG, PNG, WebP or BMP file.") from error


def _check_size(name: str, image: Image.Image) -> None:
    most = MOST_PIXELS[image.format or ""]
    if image.width * image.height > most or max(image.size) > MOST_SIDE:
        raise ImageError(
            f"{name}: {image.width} x {image.height} pixels are too many; {most // 10**6} million are read of a "
            f"{image.format}, and {MOST_SIDE:,} along a side. Scale it down first."
        )


def _smaller(image: Image.Image) -> Image.Image:
    """Decode an image with no more pixels than are of use."""
    image.draft("RGB", (2 * LEAST_SIDE, 2 * LEAST_SIDE))  # A JPEG can be decoded small.
    if image.mode not in ("L", "RGB"):
        image = image.convert("RGB")
    factor = min(image.size) // LEAST_SIDE
    return image.reduce(factor) if factor > 1 else image
