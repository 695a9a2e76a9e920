# SPDX-License-Identifier: Apache-2.0
"""trimesh's ray queries, answered by a kdray server: `mesh.ray = RayMeshIntersector(mesh)`.

The methods, shapes, dtypes and miss values are those of `trimesh.ray.ray_triangle` and
`trimesh.ray.ray_pyembree`. Differences, which come from kdray's answers being exact:

- hits are sorted by ray, then by distance;
- a ray through an edge or a vertex crosses the surface once, not once for each triangle there;
- without hits, locations have the shape (0, 3), as in ray_pyembree;
- of more than 1024 hits of a ray, the nearest are given, with a warning;
- of an open mesh, `contains_points` is False where inside and outside are not defined.
"""
from __future__ import annotations

from typing import Any, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt

from .batches import BatchInfo
from .client import Client
from .npy import Array
from .queries import MOST_HITS, warn_of_truncation
from .tree import Tree

__all__ = ["RayMeshIntersector"]


class RayMeshIntersector:
    """Ray queries of a mesh: any object with `vertices` (N, 3) and `faces` (M, 3).

    The mesh is uploaded at the first query, and again when hash(mesh) has changed, which is how a
    trimesh.Trimesh tells that its vertices or faces were edited. client: default `Client()`.
    scale_to_box is accepted and ignored: kdray is accurate at any scale.
    """

    def __init__(
        self, geometry: Any, scale_to_box: bool = True, *, client: Optional[Client] = None
    ) -> None:
        self.mesh = geometry
        self._client = client or Client()
        self._scale_to_box = scale_to_box
        self._uploaded: Optional[Tuple[int, Tree]] = None

    @property
    def tree(self) -> Tree:
        """The tree on the server, for all that trimesh has no method for."""
        key = hash(self.mesh)
        if self._uploaded is None or self._uploaded[0] != key:
            self._uploaded = key, self._client.upload((self.mesh.vertices, self.mesh.faces))
        return self._uploaded[1]

    def intersects_id(
        self,
        ray_origins: npt.ArrayLike,
        ray_directions: npt.ArrayLike,
        multiple_hits: bool = True,
        max_hits: int = MOST_HITS,
        return_locations: bool = False,
        **_: Any,
    ) -> Union[Tuple[Array, Array], Tuple[Array, Array, Array]]:
        """index_tri (h,) i8, index_ray (h,) i8 and, with return_locations, locations (h, 3) f8."""
        triangles, rays, locations = self._hits(
            ray_origins, ray_directions, multiple_hits, max_hits
        )
        return (triangles, rays, locations) if return_locations else (triangles, rays)

    def intersects_location(
        self,
        ray_origins: npt.ArrayLike,
        ray_directions: npt.ArrayLike,
        multiple_hits: bool = True,
        **_: Any,
    ) -> Tuple[Array, Array, Array]:
        """locations (h, 3) f8, index_ray (h,) i8, index_tri (h,) i8."""
        triangles, rays, locations = self._hits(
            ray_origins, ray_directions, multiple_hits, MOST_HITS
        )
        return locations, rays, triangles

    def intersects_first(
        self, ray_origins: npt.ArrayLike, ray_directions: npt.ArrayLike, **_: Any
    ) -> Array:
        """The first triangle that each ray hits: (n,) i8, -1 for a miss."""
        rays = joined(ray_origins, ray_directions)
        return self.tree.closest(rays, "triangle").astype(np.int64)

    def intersects_any(
        self, ray_origins: npt.ArrayLike, ray_directions: npt.ArrayLike, **_: Any
    ) -> Array:
        """Whether each ray hits the mesh: (n,) bool."""
        return self.tree.any(joined(ray_origins, ray_directions))

    def contains_points(self, points: npt.ArrayLike) -> Array:
        """Whether each point is inside: (n,) bool; points on the surface are."""
        points = np.asarray(points, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points must have the shape (n, 3), not {points.shape}")
        return np.equal(self.tree.inside(points), 1)

    def _hits(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike, multiple_hits: bool, max_hits: int
    ) -> Tuple[Array, Array, Array]:
        """(triangles, rays, locations)"""
        rays = joined(origins, directions)
        if multiple_hits:
            info = BatchInfo()
            most = min(max_hits, MOST_HITS)
            hits = self.tree.all(rays, "triangle,point", max_hits=most, info=info)
            if max_hits >= MOST_HITS:
                warn_of_truncation(info, MOST_HITS)
            numbers = hits["ray"]
        else:
            hits = self.tree.closest(rays, "triangle,point")
            numbers = np.flatnonzero(hits["triangle"] >= 0)
            hits = hits[numbers]
        return (
            hits["triangle"].astype(np.int64),
            numbers.astype(np.int64),
            np.ascontiguousarray(hits["point"], np.float64),
        )


def joined(origins: npt.ArrayLike, directions: npt.ArrayLike) -> Array:
    parts = [np.asarray(part, np.float64) for part in (origins, directions)]
    if parts[0].shape != parts[1].shape or parts[0].ndim != 2 or parts[0].shape[1] != 3:
        raise ValueError(
            "ray_origins and ray_directions must both have the shape (n, 3), not "
            f"{parts[0].shape} and {parts[1].shape}"
        )
    return np.hstack(parts)
