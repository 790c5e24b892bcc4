"""Prepares a glTF file for trimesh: names the compressions that nobody here reads, and scales normalised integers.

Reads the JSON of the file alone. Draco is read by trimesh where DracoPy is installed; trimesh itself leaves integers
that stand for shares of 1 (`KHR_mesh_quantization`) as they are, and passes over extensions in silence.
"""

import base64
import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.exchange.gltf.extensions import register_handler

from ltvn_core.errors import SceneError
from ltvn_core.extras import is_installed, missing_text
from ltvn_core.structured_text import parse_json

SUFFIXES = (".glb", ".gltf")

_DRACO = "KHR_draco_mesh_compression"
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_BASIS = "KHR_texture_basisu"
_READ = (_DRACO, _BASIS, "KHR_mesh_quantization", "EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness")
_NORMALISED = "LTVN_normalised"
"""Our mark at a primitive: its accessors of normalised integers, and the number that stands for 1 in each."""
_ONE = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}
"""Component type -> the integer that stands for 1."""
_MAGIC, _JSON = b"glTF", b"JSON"
_KTX2 = b"\xabKTX 20\xbb"


@dataclass(frozen=True, eq=False)
class GltfFile:
    """The JSON of a glTF file, and the bytes that follow it."""

    path: Path
    header: Mapping[str, Any]
    rest: bytes | None
    """The chunks after the JSON of a GLB; None for a glTF of text."""

    @classmethod
    def read(cls, path: Path) -> "GltfFile | None":
        """Read a file; None where its JSON cannot be read, of which trimesh says more."""
        try:
            data, rest = path.read_bytes(), None
            if data[:4] == _MAGIC:
                length, kind = struct.unpack("<I4s", data[12:20])
                if kind != _JSON:
                    return None
                data, rest = data[20 : 20 + length], data[20 + length :]
            header = parse_json(data)
        except (OSError, ValueError, struct.error):
            return None
        return cls(path, header, rest) if isinstance(header, dict) else None

    def require_readable(self) -> None:
        """Raise SceneError for a compression that cannot be read here, with the way out."""
        required = self._required()
        way_out = f"`npx @gltf-transform/cli cp {self.path.name} plain.glb` writes it without the compression"
        for name in _MESHOPT:
            if name in required:
                raise SceneError(f"{self.path} is compressed with meshopt ({name}), which is not read. {way_out}.")
        if _DRACO in required and not is_installed("DracoPy"):
            raise SceneError(f"{self.path} is compressed with Draco. {missing_text('DracoPy')} Or {way_out}.")

    @property
    def is_draco(self) -> bool:
        """Whether the triangles are compressed with Draco and nothing else."""
        return _DRACO in self._required()

    def with_marked_integers(self) -> bytes | None:
        """Return the file with marks at normalised integers, by which trimesh scales them; None where it has none."""
        accessors = self.header.get("accessors", [])
        ones = {
            str(place): _ONE[each["componentType"]]
            for place, each in enumerate(accessors)
            if each.get("normalized") and each.get("componentType") in _ONE
        }
        marked, count = json.loads(json.dumps(self.header)), 0
        for primitive in (each for mesh in marked.get("meshes", []) for each in mesh.get("primitives", [])):
            names = primitive.get("attributes", {})
            mine = [
                str(place) for name, place in names.items() if not name.startswith("COLOR")
            ]  # trimesh scales those.
            if found := {place: ones[place] for place in mine if place in ones}:
                primitive.setdefault("extensions", {})[_NORMALISED] = found
                count += 1
        return self._joined(marked) if count else None

    def texture_doubts(self) -> Iterator[str]:
        """Yield what will look different from what the file says, in whole sentences."""
        images = [each for each in self.header.get("images", []) if self._is_ktx2(each)]
        if images:
            yield (
                f"{self.path.name}: {len(images)} of {len(self.header['images'])} textures are in KTX2 (Basis "
                "Universal), which is not read, so their surfaces are plain. `npx @gltf-transform/cli ktxdecompress "
                f"{self.path.name} plain.glb` turns them into PNG."
            )
        if unread := sorted(self._required() - set(_READ)):
            yield f"{self.path.name} requires {', '.join(unread)}, which is not read; its surfaces may look different."

    def _required(self) -> set[str]:
        required = self.header.get("extensionsRequired", [])
        return {each for each in required if isinstance(each, str)} if isinstance(required, list) else set()

    def _is_ktx2(self, image: Mapping[str, Any]) -> bool:
        uri = str(image.get("uri", ""))
        if "base64," in uri:
            return base64.b64decode(uri.partition("base64,")[2][:16] or "")[: len(_KTX2)] == _KTX2
        return image.get("mimeType") == "image/ktx2" or uri.lower().endswith((".ktx2", ".basis"))

    def _joined(self, header: Mapping[str, Any]) -> bytes:
        text = json.dumps(header).encode()
        if self.rest is None:
            return text
        text += b" " * (-len(text) % 4)
        length = 20 + len(text) + len(self.rest)
        return struct.pack("<4sIII4s", _MAGIC, 2, length, len(text), _JSON) + text + self.rest


@register_handler(_NORMALISED, scope="primitive_preprocess")
def _scale(context: Any) -> None:
    """Divide the marked integers of a primitive, once where several primitives share them."""
    accessors = context["accessors"]
    for place, one in context["data"].items():
        numbers = accessors[int(place)]
        if numbers.dtype.kind in "iu":
            accessors[int(place)] = np.maximum(numbers.astype(np.float32) / np.float32(one), -1)
