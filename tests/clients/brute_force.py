# SPDX-License-Identifier: Apache-2.0
"""Ray and point queries the slow, obvious way: every row with every triangle, in double.

triangles: (M, 3, 3), the corners of each. Compare with a tolerance.
"""
import numpy as np


def crossings(triangles, rays):
    """t, u, v of every ray with every triangle, each (N, M); t is inf for a miss."""
    a = triangles[:, 0]
    e1, e2 = triangles[:, 1] - a, triangles[:, 2] - a
    origins, directions = rays[:, None, :3], rays[:, None, 3:6]
    normal = np.cross(directions, e2[None])
    offset = origins - a[None]
    moment = np.cross(offset, e1[None])
    with np.errstate(all="ignore"):
        determinant = (e1[None] * normal).sum(-1)
        u = (offset * normal).sum(-1) / determinant
        v = (directions * moment).sum(-1) / determinant
        t = (e2[None] * moment).sum(-1) / determinant
        low, high = (rays[:, 6:7], rays[:, 7:8]) if rays.shape[1] == 8 else (0.0, np.inf)
        is_hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= low) & (t <= high)
    return np.where(is_hit, t, np.inf), u, v


def closest_hits(triangles, rays):
    """The smallest t of each ray, inf for a miss."""
    return crossings(triangles, rays)[0].min(axis=1)


def distances(triangles, points):
    """The distance of each point from the surface: from each plane, edge and corner."""
    best = np.full(len(points), np.inf)
    for corners in triangles:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        length = np.linalg.norm(normal)
        if length == 0:
            continue
        for i in range(3):  # the edges, with their ends
            start, along = corners[i], corners[(i + 1) % 3] - corners[i]
            share = np.clip((points - start) @ along / (along @ along), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - start - share[:, None] * along, axis=1))
        height = (points - corners[0]) @ normal / length
        foot = points - height[:, None] * normal / length
        is_over = np.ones(len(points), bool)
        for i in range(3):
            along = corners[(i + 1) % 3] - corners[i]
            is_over &= np.cross(along, foot - corners[i]) @ normal >= 0
        best = np.where(is_over, np.minimum(best, np.abs(height)), best)
    return best


def winding_numbers(triangles, points):
    """How often the surface winds around each point.

    By solid angles: van Oosterom and Strackee, "The Solid Angle of a Plane Triangle", 1983.
    """
    total = np.zeros(len(points))
    for corners in triangles:
        a, b, c = (corner - points for corner in corners)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        others = (
            la * lb * lc
            + np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", b, c) * la
            + np.einsum("ij,ij->i", c, a) * lb
        )
        total += 2 * np.arctan2(volume, others)
    return np.rint(total / (4 * np.pi)).astype(int)
