# SPDX-License-Identifier: Apache-2.0
"""Ray queries and pictures of triangle meshes, answered by a kdray server.

    import kdray
    tree = kdray.Client().upload("bunny.ply")     # the server of KDRAY_SERVER, or of this machine
    hits = tree.closest(kdray.rays(origins, directions))
    hits["t"], hits["triangle"]                   # arrays; a miss has triangle -1
    tree.render(view="iso")                       # a notebook shows the picture

`Client` has uploads, `Tree` the queries. `kdray.trimesh` and `kdray.open3d` have classes that take
the places of trimesh's RayMeshIntersector and Open3D's RaycastingScene.
"""
from __future__ import annotations

from typing import Optional

import numpy as np
import numpy.typing as npt

from .batches import BatchInfo
from .client import Client
from .errors import ConnectionFailed, Error, Problem
from .npy import Array
from .picture import Picture
from .progress import Progress
from .scans import Scan
from .tradeoff import Tradeoff
from .tree import Tree
from .version import VERSION as __version__

__all__ = [
    "BatchInfo",
    "Client",
    "ConnectionFailed",
    "Error",
    "Picture",
    "Problem",
    "Progress",
    "Scan",
    "Tradeoff",
    "Tree",
    "__version__",
    "rays",
]


def rays(
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    t_min: Optional[npt.ArrayLike] = None,
    t_max: Optional[npt.ArrayLike] = None,
) -> Array:
    """Rows of rays (…, 6), or (…, 8) if t_min or t_max is given; the arguments are broadcast.

    origins and directions have the shape (…, 3), t_min and t_max (…). float32 if all of them are.
    """
    vectors = [np.asarray(part) for part in (origins, directions)]
    for name, vector in zip(("origins", "directions"), vectors):
        if vector.ndim == 0 or vector.shape[-1] != 3:
            raise ValueError(f"{name} must have the shape (…, 3), not {vector.shape}")
    if t_min is not None or t_max is not None:
        ends = (0.0 if t_min is None else t_min, np.inf if t_max is None else t_max)
        vectors += [np.asarray(end)[..., None] for end in ends]
    # As in NumPy's own arithmetic, a single number does not decide the type.
    arrays = [np.asarray(part) for part in (origins, directions, t_min, t_max) if part is not None]
    is_single = all(part.dtype == np.float32 for part in arrays if part.ndim)
    shape = np.broadcast_shapes(*(vector.shape[:-1] for vector in vectors))
    parts = [np.broadcast_to(vector, (*shape, vector.shape[-1])) for vector in vectors]
    joined: Array = np.concatenate(parts, axis=-1).astype(np.float32 if is_single else np.float64)
    return joined
