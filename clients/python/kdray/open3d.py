# SPDX-License-Identifier: Apache-2.0
"""Open3D's RaycastingScene, answered by a kdray server.

The methods, shapes, dtypes and miss values are those of `open3d.t.geometry.RaycastingScene`.
Answers are NumPy arrays that also have the methods `numpy()` and `cpu()` of Open3D's tensors, and
Open3D's functions take them. Differences:

- vertices and rays may also be float64, and are then not rounded;
- `count_intersections`, `list_intersections` and the signs are exact, so `nsamples` has no use;
- rays may have 8 columns, with t_min and t_max;
- where an open mesh leaves it unknown, a point is outside;
- `nthreads` and `device` are accepted and ignored.
"""
from __future__ import annotations

from typing import Any, Dict, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

from .batches import BatchInfo
from .client import Client
from .npy import Array
from .queries import MOST_HITS, warn_of_truncation
from .tree import Tree

__all__ = ["RaycastingScene", "Tensor"]


class Tensor(np.ndarray[Any, Any]):
    """A NumPy array with the two methods of Open3D's tensors that code calls on answers."""

    def numpy(self) -> Array:
        return self.view(np.ndarray)

    def cpu(self) -> "Tensor":
        return self


class RaycastingScene:
    """Meshes that are asked together, uploaded as one at the first query after a change.

    client: default `Client()`.
    """

    INVALID_ID = 0xFFFFFFFF

    def __init__(
        self, nthreads: int = 0, device: Any = None, *, client: Optional[Client] = None
    ) -> None:
        self._client = client or Client()
        self._meshes: List[Tuple[Array, Array]] = []
        # The first triangle of each geometry, and the number of all.
        self._starts: Array = np.zeros(1, np.int64)
        self._tree: Optional[Tree] = None

    def add_triangles(self, vertex_positions: Any, triangle_indices: Any = None) -> int:
        """Adds positions (N, 3) and indices (M, 3), or an Open3D mesh. Its geometry id, from 0."""
        if triangle_indices is None:
            vertex_positions, triangle_indices = parts_of(vertex_positions)
        vertices, triangles = plain(vertex_positions), plain(triangle_indices)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind != "f":
            raise ValueError(
                f"vertex_positions must be floats (N, 3), not {vertices.dtype} {vertices.shape}"
            )
        if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
            raise ValueError(
                f"triangle_indices must be integers (M, 3), not {triangles.dtype} {triangles.shape}"
            )
        triangles = triangles.astype(np.int64)
        if triangles.size and not (0 <= triangles.min() and triangles.max() < len(vertices)):
            raise ValueError(f"triangle_indices must be from 0 to {len(vertices) - 1}")
        self._meshes.append((vertices.copy(), triangles))
        self._starts = np.append(self._starts, self._starts[-1] + len(triangles))
        self._tree = None
        return len(self._meshes) - 1

    @property
    def tree(self) -> Tree:
        """The tree on the server, for all that Open3D has no method for."""
        if self._tree is None:
            starts = np.cumsum([0] + [len(vertices) for vertices, _ in self._meshes])
            self._tree = self._client.upload(
                (
                    np.concatenate([vertices for vertices, _ in self._meshes]),
                    np.concatenate(
                        [triangles + start for (_, triangles), start in zip(self._meshes, starts)]
                    ),
                )
            )
        return self._tree

    def cast_rays(self, rays: Any, nthreads: int = 0) -> Dict[str, Tensor]:
        """The first hits: t_hit, geometry_ids, primitive_ids, primitive_uvs and primitive_normals.

        A miss has t_hit inf, both ids INVALID_ID, and zeros.
        """
        rows = rows_of(rays, (6, 8), "rays")
        hits = self._closest(rows)
        hit = hits["triangle"] >= 0
        geometries, primitives = self._ids(hits["triangle"])
        return tensors(
            t_hit=np.where(hit, hits["t"], np.inf).astype(np.float32),
            geometry_ids=geometries,
            primitive_ids=primitives,
            primitive_uvs=np.where(hit[..., None], np.stack([hits["u"], hits["v"]], -1), 0).astype(
                np.float32
            ),
            primitive_normals=np.where(hit[..., None], hits["normal"], 0).astype(np.float32),
        )

    def test_occlusions(
        self, rays: Any, tnear: float = 0.0, tfar: float = np.inf, nthreads: int = 0
    ) -> Tensor:
        """Whether each ray hits anything: bool."""
        rows = rows_of(rays, (6, 8), "rays")
        if self._is_empty():
            return tensor(np.zeros(rows.shape[:-1], bool))
        return tensor(self.tree.any(rows, t_min=float(tnear), t_max=float(tfar)))

    def count_intersections(self, rays: Any, nthreads: int = 0) -> Tensor:
        """How often each ray crosses the surface: int32."""
        rows = rows_of(rays, (6, 8), "rays")
        if self._is_empty():
            return tensor(np.zeros(rows.shape[:-1], np.int32))
        return tensor(self.tree.count(rows).astype(np.int32))

    def list_intersections(self, rays: Any, nthreads: int = 0) -> Dict[str, Tensor]:
        """All hits; of more than 1024 of a ray, the nearest, with a warning.

        ray_splits, ray_ids, t_hit, geometry_ids, primitive_ids and primitive_uvs.
        """
        rows = rows_of(rays, (6, 8), "rays")
        number = int(np.prod(rows.shape[:-1], dtype=np.int64))
        if self._is_empty():
            hits: Array = np.zeros(
                0, [("ray", "i4"), ("t", "f4"), ("triangle", "i4"), ("u", "f4"), ("v", "f4")]
            )
        else:
            info = BatchInfo()
            hits = self.tree.all(rows, max_hits=MOST_HITS, info=info)
            warn_of_truncation(info, MOST_HITS)
        geometries, primitives = self._ids(hits["triangle"])
        splits = np.concatenate([[0], np.cumsum(np.bincount(hits["ray"], minlength=number))])
        return tensors(
            ray_splits=splits.astype(np.uint32),
            ray_ids=hits["ray"].astype(np.uint32),
            t_hit=hits["t"].astype(np.float32),
            geometry_ids=geometries,
            primitive_ids=primitives,
            primitive_uvs=np.stack([hits["u"], hits["v"]], -1).astype(np.float32),
        )

    def compute_closest_points(self, query_points: Any, nthreads: int = 0) -> Dict[str, Tensor]:
        """points, geometry_ids, primitive_ids, primitive_uvs and primitive_normals."""
        rows = rows_of(query_points, (3,), "query_points")
        self._require_triangles()
        found = self.tree.closest_points(rows, "point,triangle,u,v,normal")
        geometries, primitives = self._ids(found["triangle"])
        return tensors(
            points=found["point"].astype(np.float32),
            geometry_ids=geometries,
            primitive_ids=primitives,
            primitive_uvs=np.stack([found["u"], found["v"]], -1).astype(np.float32),
            primitive_normals=found["normal"].astype(np.float32),
        )

    def compute_distance(self, query_points: Any, nthreads: int = 0) -> Tensor:
        """The distance to the surface: float32."""
        rows = rows_of(query_points, (3,), "query_points")
        self._require_triangles()
        return tensor(self.tree.closest_points(rows, "distance").astype(np.float32))

    def compute_signed_distance(
        self, query_points: Any, nthreads: int = 0, nsamples: int = 1
    ) -> Tensor:
        """The distance to the surface, negative inside: float32."""
        rows = rows_of(query_points, (3,), "query_points")
        self._require_triangles()
        distances = np.atleast_1d(self.tree.signed_distance(rows))
        unknown = np.isnan(distances)
        if unknown.any():
            distances[unknown] = self.tree.closest_points(rows[unknown], "distance")
        return tensor(distances.astype(np.float32))

    def compute_occupancy(self, query_points: Any, nthreads: int = 0, nsamples: int = 1) -> Tensor:
        """1 for points inside a closed surface, else 0: float32."""
        rows = rows_of(query_points, (3,), "query_points")
        self._require_triangles()
        return tensor((self.tree.inside(rows) == 1).astype(np.float32))

    @staticmethod
    def create_rays_pinhole(*arguments: Any, **named: Any) -> Tensor:
        """Rays of a camera: float32 (height_px, width_px, 6).

        create_rays_pinhole(intrinsic_matrix, extrinsic_matrix, width_px, height_px) or
        create_rays_pinhole(fov_deg, center, eye, up, width_px, height_px), fov_deg being
        horizontal. Directions have length 1 along the view. As in Open3D, the second form has row 0
        at the bottom and column 0 at the right.
        """
        if "fov_deg" in named or len(arguments) + len(named) == 6:
            return rays_of_view(*arguments, **named)
        return rays_of_matrices(*arguments, **named)

    def _is_empty(self) -> bool:
        return int(self._starts[-1]) == 0

    def _require_triangles(self) -> None:
        if self._is_empty():
            raise RuntimeError("the scene has no triangles")

    def _closest(self, rows: Array) -> Array:
        if not self._is_empty():
            return self.tree.closest(rows, "t,triangle,u,v,normal")
        misses = np.zeros(
            rows.shape[:-1],
            [("t", "f4"), ("triangle", "i4"), ("u", "f4"), ("v", "f4"), ("normal", "f4", 3)],
        )
        misses["triangle"] = -1
        return misses

    def _ids(self, triangles: Array) -> Tuple[Array, Array]:
        """Geometry and primitive ids of triangle numbers; INVALID_ID for -1."""
        geometries = np.searchsorted(self._starts, triangles, side="right") - 1
        primitives = triangles - self._starts[np.maximum(geometries, 0)]
        is_hit = triangles >= 0
        return (
            np.where(is_hit, geometries, self.INVALID_ID).astype(np.uint32),
            np.where(is_hit, primitives, self.INVALID_ID).astype(np.uint32),
        )


def rays_of_matrices(
    intrinsic_matrix: Any, extrinsic_matrix: Any, width_px: int, height_px: int
) -> Tensor:
    intrinsic, extrinsic = plain(intrinsic_matrix).astype(float), plain(extrinsic_matrix).astype(
        float
    )
    if intrinsic.shape != (3, 3) or extrinsic.shape != (4, 4):
        raise ValueError(
            "the matrices must have the shapes (3, 3) and (4, 4), not "
            f"{intrinsic.shape} and {extrinsic.shape}"
        )
    rotation, shift = extrinsic[:3, :3], extrinsic[:3, 3]
    x, y = np.meshgrid(np.arange(width_px) + 0.5, np.arange(height_px) + 0.5)
    pixels = np.stack([x, y, np.ones_like(x)], -1)
    directions = pixels @ np.linalg.inv(intrinsic).T @ rotation
    origins = np.broadcast_to(-rotation.T @ shift, directions.shape)
    return tensor(np.concatenate([origins, directions], -1).astype(np.float32))


def rays_of_view(
    fov_deg: float, center: Any, eye: Any, up: Any, width_px: int, height_px: int
) -> Tensor:
    focal = 0.5 * width_px / np.tan(np.radians(float(fov_deg)) / 2)
    intrinsic = np.array([[focal, 0, 0.5 * width_px], [0, focal, 0.5 * height_px], [0, 0, 1]])
    position = plain(eye).astype(float)
    ahead = plain(center).astype(float) - position
    left = np.cross(plain(up).astype(float), ahead)
    if not left.any():
        raise ValueError("up must not be parallel to the view")
    axes = np.stack([left, np.cross(ahead, left), ahead])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    extrinsic = np.eye(4)
    extrinsic[:3, :3], extrinsic[:3, 3] = axes, -axes @ position
    return rays_of_matrices(intrinsic, extrinsic, width_px, height_px)


def parts_of(mesh: Any) -> Tuple[Any, Any]:
    """Positions and indices of an Open3D mesh, tensor or legacy."""
    if hasattr(mesh, "vertex") and hasattr(mesh, "triangle"):
        return mesh.vertex["positions"], mesh.triangle["indices"]
    if hasattr(mesh, "vertices") and hasattr(mesh, "triangles"):
        return np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    raise TypeError(
        f"add_triangles takes positions and indices, or a TriangleMesh, not {type(mesh).__name__}"
    )


def plain(values: Any) -> Array:
    """An array of a tensor, array or list."""
    for method in ("cpu", "numpy"):
        if hasattr(values, method):
            values = getattr(values, method)()
    return np.asarray(values)


def rows_of(values: Any, columns: Tuple[int, ...], name: str) -> Array:
    rows = plain(values)
    if rows.ndim < 2 or rows.shape[-1] not in columns:
        raise ValueError(
            f"{name} must have at least 2 dimensions, the last of {columns[0]}, not {rows.shape}"
        )
    return rows


def tensor(array: Array) -> Tensor:
    return array.view(Tensor)


def tensors(**arrays: Array) -> Dict[str, Tensor]:
    return {name: tensor(array) for name, array in arrays.items()}
