# SPDX-License-Identifier: Apache-2.0
"""What may be uploaded: a file, bytes, or arrays of vertices and faces, which become a PLY file."""
from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any, Iterable, Tuple, Union

import numpy as np
import numpy.typing as npt

from .transport import Body, Buffer

# An object with `vertices` and `faces`, such as a trimesh.Trimesh, is taken too (hence Any).
MeshLike = Union[
    str, "os.PathLike[str]", bytes, bytearray, memoryview, Tuple[npt.ArrayLike, npt.ArrayLike], Any
]

PIECE_BYTES = 1 << 20
TYPE = "application/octet-stream"


class Source:
    """The bytes of a mesh: their SHA-256, and a body that sends them."""

    def __init__(self, mesh: Any) -> None:  # MeshLike
        self.name = "the mesh"
        self._path = None
        self._content: Buffer = b""
        if isinstance(mesh, (str, os.PathLike)):
            self._path = Path(mesh)
            self.name = str(mesh)
        elif isinstance(mesh, (bytes, bytearray, memoryview)):
            self._content = memoryview(mesh).cast("B")
        elif isinstance(mesh, (tuple, list)) and len(mesh) == 2:
            self._content = ply_bytes(*mesh)
        elif hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
            self._content = ply_bytes(mesh.vertices, mesh.faces)
        else:
            raise TypeError(
                "a mesh is a path, bytes, (vertices, faces), or an object with vertices and faces, "
                f"not {type(mesh).__name__}"
            )
        digest = hashlib.sha256()
        self.size = 0
        for piece in self.pieces():
            digest.update(piece)
            self.size += len(piece)
        self.sha256 = digest.hexdigest()

    def pieces(self) -> Iterable[Buffer]:
        if self._path is None:
            for start in range(0, len(self._content), PIECE_BYTES):
                yield self._content[start : start + PIECE_BYTES]
            return
        with open(self._path, "rb") as file:
            while True:
                piece = file.read(PIECE_BYTES)
                if not piece:
                    return
                yield piece

    def body(self) -> Body:
        return Body(self.size, TYPE, self.pieces, self.sha256)


def ply_bytes(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> bytes:
    """A binary PLY file. Equal arrays give equal bytes, so equal tree ids.

    vertices: (N, 3); float32 is stored as float, all else as double. faces: (M, k) with k from 3 to
    255, integers from 0 to N - 1; face i has the triangle number i if k is 3.
    """
    points, corners = np.asarray(vertices), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"vertices must have the shape (N, 3), not {points.shape}")
    if points.dtype.kind not in "fiu":
        raise TypeError(f"vertices must be numbers, not {points.dtype}")
    if corners.ndim != 2 or not 3 <= corners.shape[1] <= 255:
        raise ValueError(
            f"faces must have the shape (M, k) with k from 3 to 255, not {corners.shape}"
        )
    if corners.dtype.kind not in "iu":
        raise TypeError(f"faces must be integers, not {corners.dtype}")
    if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
        row = int(np.flatnonzero(((corners < 0) | (corners >= len(points))).any(axis=1))[0])
        raise ValueError(
            f"faces[{row}] is {corners[row].tolist()}; there are {len(points)} vertices"
        )
    if len(points) >= 1 << 31:
        raise ValueError(f"a PLY file has at most 2^31 - 1 vertices, not {len(points)}")
    name, kind = ("float", "<f4") if points.dtype == np.float32 else ("double", "<f8")
    rows = np.empty(
        len(corners), np.dtype([("count", "u1"), ("corners", "<i4", (corners.shape[1],))])
    )
    rows["count"], rows["corners"] = corners.shape[1], corners
    header = "".join(
        line + "\n"
        for line in (
            "ply",
            "format binary_little_endian 1.0",
            f"element vertex {len(points)}",
            *(f"property {name} {axis}" for axis in "xyz"),
            f"element face {len(corners)}",
            "property list uchar int vertex_indices",
            "end_header",
        )
    )
    return header.encode() + np.ascontiguousarray(points, kind).tobytes() + rows.tobytes()
