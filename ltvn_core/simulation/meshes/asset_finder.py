"""Finds the files that a mesh names, such as pictures and material libraries, and remembers those it does not find."""

from pathlib import Path
from typing import Any
from urllib.parse import unquote

from trimesh.resolvers import FilePathResolver


class AssetFinder(FilePathResolver):
    """Looks a file up by the path in the mesh, and else by its bare name in the folder of the mesh.

    Meshes from other machines name their pictures by paths there, of Windows as well.
    """

    def __init__(self, mesh: Path) -> None:
        """Look beside a mesh."""
        super().__init__(str(mesh))
        self.missing: list[str] = []
        """Names of files that were not found."""

    def get(self, name: str) -> Any:
        """Return the bytes of a file. Raises OSError where there is none."""
        plain = unquote(name)  # Names in glTF are parts of URLs: a space is %20.
        for candidate in (name, plain, *self._beside(plain)):
            try:
                return super().get(candidate)
            except (OSError, ValueError):
                continue
        if name not in self.missing:
            self.missing.append(name)
        raise FileNotFoundError(name)

    def _beside(self, name: str) -> list[str]:
        """Return the files in the folder of the mesh of the same bare name, in large or small letters."""
        bare = name.replace("\\", "/").rpartition("/")[2].strip()
        wanted = [bare.lower()]
        if " " in bare:
            wanted.append(bare.split()[-1].lower())  # The file comes last, after the options of a material library.
        files = sorted(each.name for each in Path(self.parent).iterdir() if each.is_file())
        return [file for each in wanted for file in files if file.lower() == each]
