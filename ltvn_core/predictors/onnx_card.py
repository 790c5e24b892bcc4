"""The card beside an ONNX model: a small TOML file that describes its inputs and outputs.

    model = "gnm.onnx"                  # beside the card

    [image]
    size = [85, 64]                     # width and height
    mean = [0.485, 0.456, 0.406]        # of colours from 0 to 1
    std = [0.229, 0.224, 0.225]

    [inputs]
    source = "obs_img"                  # (N, 3 * (context + 1), height, width)
    target = "goal_img"                 # (N, 3, height, width)
    context = 5                         # number of earlier images besides the source

    [outputs]
    distance = "dist_pred"              # (N, 1), in steps
    waypoints = "action_pred"           # (N, T, 2 or more): x, y, and cos and sin of the heading

    [units]
    reachable_below = 10.0              # steps
    distance_m = 0.12                   # metres per step
    waypoint_m = 0.25                   # metres per unit of the waypoints

A place descriptor has the input `image` and the output `embedding` instead, and `same_place_above`, the cosine at which
two images show one place with probability 0.5. Owns the format and its checks.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ltvn_core.errors import WeightsError
from ltvn_core.predictors.onnx_files import read_card_text
from ltvn_core.structured_text import parse_toml

_SECTIONS = {
    "image": {"size", "mean", "std"},
    "inputs": {"source", "target", "image", "context"},
    "outputs": {"reachability", "distance", "pose", "waypoints", "embedding"},
    "units": {"reachable_below", "distance_m", "waypoint_m", "same_place_above"},
}
_MOST_PX = 1024
_MOST_CONTEXT = 32


@dataclass(frozen=True, slots=True, kw_only=True)
class OnnxCard:
    """Contents of a card. Names of outputs that the model does not have are empty."""

    model: Path
    size: tuple[int, int]
    """Width and height of the images."""
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Mean that is subtracted from each colour channel in [0, 1]."""
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Standard deviation that divides each colour channel."""
    source: str = ""
    """Name of the input for source images."""
    target: str = ""
    """Name of the input for target images."""
    image: str = ""
    """Name of the input for the images of a place descriptor."""
    context: int = 0
    """Number of earlier images besides the source. A map compares single images, so the source is repeated."""
    reachability: str = ""
    """Name of the output (N,) or (N, 1) for the probability of reachability."""
    distance: str = ""
    """Name of the output (N,) or (N, 1) for the distance in steps."""
    pose: str = ""
    """Name of the output (N, 3) for the target's pose: x and y in units of `waypoint_m`, heading in radians."""
    waypoints: str = ""
    """Name of the output (N, T, 2) or (N, T, 4) for the path to the target: x and y in units of `waypoint_m`, then cos
    and sin of the heading."""
    embedding: str = ""
    """Name of the output (N, D) for a place descriptor."""
    reachable_below: float = 10.0
    """Distance in steps at which r is 0.5."""
    distance_m: float = 0.12
    """Metres per step."""
    waypoint_m: float = 1.0
    """Metres per unit of the waypoints."""
    same_place_above: float = 0.7
    """Cosine of two embeddings at which the probability of one place is 0.5."""

    @property
    def is_descriptor(self) -> bool:
        """Whether the model is a place descriptor, which does not compare pairs."""
        return bool(self.embedding)

    @property
    def names(self) -> tuple[list[str], list[str]]:
        """The inputs and the outputs that the model must have."""
        inputs = [self.source, self.target, self.image]
        outputs = [self.reachability, self.distance, self.pose, self.waypoints, self.embedding]
        return [name for name in inputs if name], [name for name in outputs if name]


def read_onnx_card(path: Path) -> OnnxCard:
    """Read and check a card. Raises WeightsError for an invalid one."""
    try:
        tables = parse_toml(read_card_text(path))
    except ValueError as error:
        raise WeightsError(f"{path}: is not TOML ({error}); name an ONNX model by its .toml card.") from error
    try:
        return _checked(tables, path.parent)
    except (TypeError, ValueError) as error:
        raise WeightsError(f"{path}: {error}. See `ltvn_core/predictors/onnx_card.py` for an example.") from error


def _checked(tables: Mapping[str, Any], folder: Path) -> OnnxCard:
    unknown = sorted(tables.keys() - {"model", *_SECTIONS})
    given: dict[str, Any] = {}
    for section, known in _SECTIONS.items():
        table = tables.get(section, {})
        if not isinstance(table, dict):
            raise ValueError(f"[{section}] is not a table")
        unknown += sorted(f"{section}.{name}" for name in table.keys() - known)
        given |= table
    if unknown:
        raise ValueError(f"unknown: {', '.join(unknown)}")
    name = tables.get("model")
    if not isinstance(name, str) or Path(name).name != name or "\0" in name:
        raise ValueError("`model` must name an .onnx file beside the card")
    for text in _SECTIONS["inputs"] | _SECTIONS["outputs"]:
        if text != "context" and not isinstance(given.get(text, ""), str):
            raise ValueError(f"`{text}` must be the name of an input or output")
    for number in _SECTIONS["units"] & given.keys():
        given[number] = _number(given[number], number)
    for colours in {"mean", "std"} & given.keys():
        given[colours] = tuple(_number(each, colours) for each in _list(given[colours], colours, 3))
    if "size" not in given:
        raise ValueError("[image] needs size = [width, height]")
    width, height = (_whole(each, "size", 1, _MOST_PX) for each in _list(given["size"], "size", 2))
    given["size"] = width, height
    given["context"] = _whole(given.get("context", 0), "context", 0, _MOST_CONTEXT)
    return _complete(OnnxCard(model=folder / name, **given))


def _complete(card: OnnxCard) -> OnnxCard:
    """Return the card if its inputs and outputs are complete, else raise ValueError."""
    if not all(spread > 0 for spread in card.std):
        raise ValueError("std must be above 0")
    if min(card.reachable_below, card.distance_m, card.waypoint_m) <= 0:
        raise ValueError("reachable_below, distance_m and waypoint_m must be above 0")
    if card.is_descriptor:
        if not card.image:
            raise ValueError("an embedding needs the input `image`")
        return card
    if not (card.source and card.target):
        raise ValueError("[inputs] needs source and target, or image for a place descriptor")
    if not (card.reachability or card.distance):
        raise ValueError("[outputs] needs reachability or distance, or embedding for a place descriptor")
    if not (card.pose or card.waypoints):
        raise ValueError("[outputs] needs pose or waypoints, because a map needs the pose of the target")
    return card


def _list(value: object, name: str, length: int) -> list[Any]:
    if not isinstance(value, list) or len(value) != length:
        raise ValueError(f"{name} must have {length} numbers")
    return value


def _number(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a number")
    return float(value)


def _whole(value: object, name: str, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{name} must be a whole number from {least} to {most}")
    return value
