# SPDX-License-Identifier: Apache-2.0
"""The calls by which the adaptors of the Python package are compared with the real libraries.

`python3 adaptor_cases.py` records the answers of the installed libraries (Debian: python3-trimesh
with python3-rtree, python3-open3d) in recorded/, for machines that do not have them.
"""
import json
import sys
from pathlib import Path

import numpy as np

RECORDED = Path(__file__).resolve().parent / "recorded"


class Mesh:
    """What RayMeshIntersector needs of a trimesh.Trimesh."""

    def __init__(self, vertices, faces):
        self.vertices, self.faces = vertices, faces


def icosphere():
    """320 triangles, closed."""
    phi = (1 + 5**0.5) / 2
    vertices = [
        [-1, phi, 0],
        [1, phi, 0],
        [-1, -phi, 0],
        [1, -phi, 0],
        [0, -1, phi],
        [0, 1, phi],
        [0, -1, -phi],
        [0, 1, -phi],
        [phi, 0, -1],
        [phi, 0, 1],
        [-phi, 0, -1],
        [-phi, 0, 1],
    ]
    faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ]
    for _ in range(2):
        middles, finer = {}, []
        for a, b, c in faces:
            corners = []
            for edge in ((a, b), (b, c), (c, a)):
                key = tuple(sorted(edge))
                if key not in middles:
                    middles[key] = len(vertices)
                    vertices.append((np.array(vertices[edge[0]]) + vertices[edge[1]]) / 2)
                corners.append(middles[key])
            d, e, f = corners
            finer += [[a, d, f], [b, e, d], [c, f, e], [d, e, f]]
        faces = finer
    vertices = np.array([np.array(v) / np.linalg.norm(v) for v in vertices])
    return vertices.round(6), np.array(faces)


def box():
    corners = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], float) * 2 - [4, 1, 1]
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
    return corners, np.array(faces)


def some_rays(count, seed):
    """Rounded, so a text holds them; in general position, so no answer hangs on an edge."""
    generator = np.random.default_rng(seed)
    origins = generator.uniform(-5, 4, (count, 3)).round(3)
    targets = generator.uniform(-3, 1.2, (count, 3)).round(3)
    return origins, targets - origins


def some_points(count, seed):
    return np.random.default_rng(seed).uniform(-3.5, 1.5, (count, 3)).round(3)


def trimesh_answers(intersector):
    """name: array of each answer. intersector(vertices, faces) makes the object under test."""
    answers = {}

    def keep(name, values):
        for i, value in enumerate(values if isinstance(values, tuple) else (values,)):
            answers[f"{name}.{i}"] = np.asarray(value)

    for name, mesh in (("sphere", icosphere()), ("box", box())):
        ray = intersector(*mesh)
        origins, directions = some_rays(40, 1)
        keep(f"{name} id", ray.intersects_id(origins, directions))
        keep(f"{name} id first", ray.intersects_id(origins, directions, multiple_hits=False))
        keep(f"{name} id locations", ray.intersects_id(origins, directions, return_locations=True))
        keep(f"{name} location", ray.intersects_location(origins, directions))
        keep(
            f"{name} location first",
            ray.intersects_location(origins, directions, multiple_hits=False),
        )
        keep(f"{name} first", ray.intersects_first(origins, directions))
        keep(f"{name} any", ray.intersects_any(origins, directions))
        keep(f"{name} lists", ray.intersects_first(origins.tolist(), directions.tolist()))
        keep(f"{name} contains", ray.contains_points(some_points(200, 2)))
        away = np.tile([0, 50.0, 0], (3, 1)), np.tile([0, 1.0, 0.3], (3, 1))
        keep(f"{name} missed id", ray.intersects_id(*away))
        keep(f"{name} missed location", ray.intersects_location(*away))
        keep(f"{name} missed first", ray.intersects_first(*away))
        keep(f"{name} missed any", ray.intersects_any(*away))
    return answers


def open3d_answers(new_scene, tensor):
    """The same for RaycastingScene; tensor(array) makes an argument."""
    answers = {}

    def keep(name, value):
        for key, part in value.items() if isinstance(value, dict) else [("", value)]:
            answers[f"{name}.{key}"] = np.asarray(part.numpy() if hasattr(part, "numpy") else part)

    scene = new_scene()
    keep("invalid id", scene.INVALID_ID)
    for i, (vertices, faces) in enumerate((icosphere(), box())):
        keep(
            f"id {i}",
            scene.add_triangles(tensor(vertices.astype("f4")), tensor(faces.astype("u4"))),
        )
    rays = tensor(np.hstack(some_rays(60, 1)).astype("f4"))
    grid = tensor(np.hstack(some_rays(60, 1)).astype("f4").reshape(3, 20, 6))
    keep("cast", scene.cast_rays(rays))
    keep("cast grid", scene.cast_rays(grid))
    keep("occlusions", scene.test_occlusions(grid))
    keep("occlusions between", scene.test_occlusions(rays, tnear=0.3, tfar=0.8))
    keep("count", scene.count_intersections(grid))
    if hasattr(scene, "list_intersections"):  # not in 0.16
        keep("list", scene.list_intersections(rays))
    points = tensor(some_points(60, 2).astype("f4"))
    point_grid = tensor(some_points(60, 2).astype("f4").reshape(5, 12, 3))
    keep("closest", scene.compute_closest_points(point_grid))
    keep("distance", scene.compute_distance(point_grid))
    keep("signed", scene.compute_signed_distance(points))
    keep("occupancy", scene.compute_occupancy(points))
    keep(
        "pinhole",
        scene.create_rays_pinhole(
            fov_deg=60, center=[0, 0.5, 0], eye=[3, 2, 4], up=[0, 1, 0], width_px=4, height_px=3
        ),
    )
    keep(
        "pinhole matrices",
        scene.create_rays_pinhole(
            tensor(np.array([[50.0, 0, 2.5], [0, 40, 1], [0, 0, 1]])),
            tensor(np.array([[0, -1, 0, 0.5], [1, 0, 0, -1], [0, 0, 1, 2], [0, 0, 0, 1.0]])),
            5,
            3,
        ),
    )
    return answers


def as_text(answers):
    return {
        name: {
            "dtype": str(array.dtype),
            "shape": list(array.shape),
            "values": [repr(x) for x in array.reshape(-1).tolist()],
        }
        for name, array in answers.items()
    }


def from_text(name):
    """(origin, answers) of a recording."""
    recorded = json.loads((RECORDED / f"{name}.json").read_text())
    values = {"True": True, "False": False}
    return recorded["origin"], {
        key: np.array(
            [values[x] if x in values else float(x) for x in part["values"]], part["dtype"]
        ).reshape(part["shape"])
        for key, part in recorded["answers"].items()
    }


def real_trimesh():
    import trimesh
    from trimesh.ray.ray_triangle import RayMeshIntersector

    return f"trimesh {trimesh.__version__}, trimesh.ray.ray_triangle", trimesh_answers(
        lambda vertices, faces: RayMeshIntersector(trimesh.Trimesh(vertices, faces, process=False))
    )


def real_open3d():
    import open3d

    return f"Open3D {open3d.__version__}", open3d_answers(
        open3d.t.geometry.RaycastingScene, open3d.core.Tensor
    )


if __name__ == "__main__":
    RECORDED.mkdir(exist_ok=True)
    for name, real in (("trimesh", real_trimesh), ("open3d", real_open3d)):
        if sys.argv[1:] in ([], [name]):
            origin, answers = real()
            lines = ",\n".join(
                f" {json.dumps(key)}: {json.dumps(value)}"
                for key, value in as_text(answers).items()
            )
            (RECORDED / f"{name}.json").write_text(
                f'{{"origin": {json.dumps(origin)}, "answers": {{\n{lines}\n}}}}\n'
            )
