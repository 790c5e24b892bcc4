"""Intersections of rays with triangles. The only module that imports Embree."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class RayHits(NamedTuple):
    """The first intersections of N rays with triangles."""

    face: NDArray[np.int32]
    """(N,) index of the triangle, -1 for none."""
    t: NDArray[np.float32]
    """(N,) distance along the ray in units of its direction vector; undefined without a hit."""
    u: NDArray[np.float32]
    """(N,) barycentric weight of the triangle's second corner."""
    v: NDArray[np.float32]
    """(N,) barycentric weight of the triangle's third corner."""

    def take(self, rays: NDArray[np.intp]) -> "RayHits":
        """Return the intersections of some of the rays (M,)."""
        return RayHits(face=self.face[rays], t=self.t[rays], u=self.u[rays], v=self.v[rays])


class RayCaster:
    """Finds the first triangle along each ray; its cost hardly depends on the number of triangles."""

    def __init__(self, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> None:
        """Index vertices (V, 3) and faces (F, 3).

        Raises:
            ImportError: Embree is not installed.
        """
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        # The scene does not keep its mesh alive, so it is kept here.
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(vertices, np.float32), faces.astype(np.int32))

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> RayHits:
        """Cast rays from origins (N, 3) along directions (N, 3), which need not have unit length."""
        found = self._scene.run(origins, directions, output=True)
        return RayHits(face=found["primID"], t=found["tfar"], u=found["u"], v=found["v"])
