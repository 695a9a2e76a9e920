# SPDX-License-Identifier: Apache-2.0
"""Rays of a lidar whose beams have given elevations, with the angles of spherical renders."""
from __future__ import annotations

from typing import NamedTuple, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt

from .npy import Array
from .words import Vector

__all__ = ["Scan"]


class Scan(NamedTuple):
    """The hits of a scan, in the order in which the lidar turns; misses are left out."""

    points: Array  # (N, 3) f8
    ranges: Array  # (N,) f8: distance from the eye
    beams: Array  # (N,) i8: index into elevations_deg
    azimuths_deg: Array  # (N,) f8


def beam_rays(
    eye: Vector,
    elevations_deg: npt.ArrayLike,
    azimuths_deg: Union[int, npt.ArrayLike],
    forward: Optional[Vector],
    up: Optional[Vector],
) -> Tuple[Array, Array, Array]:
    """Unit rays (A * B, 6), azimuth by azimuth; the beam and the azimuth of each."""
    elevations = np.asarray(elevations_deg, float).reshape(-1)
    if isinstance(azimuths_deg, (int, np.integer)):
        if azimuths_deg < 1:
            raise ValueError(
                f"azimuths_deg must be an array or a number of steps from 1, not {azimuths_deg}"
            )
        azimuths = np.arange(int(azimuths_deg)) * (360.0 / int(azimuths_deg))
    else:
        azimuths = np.asarray(azimuths_deg, float).reshape(-1)
    ahead, right, above = camera_axes(forward, up)
    a, e = (
        part.reshape(-1)
        for part in np.meshgrid(np.radians(azimuths), np.radians(elevations), indexing="ij")
    )
    rays = np.empty((len(a), 6))
    rays[:, :3] = np.asarray(eye, float)
    rays[:, 3:] = (
        np.outer(np.cos(e) * np.cos(a), ahead)
        + np.outer(np.cos(e) * np.sin(a), right)
        + np.outer(np.sin(e), above)
    )
    return (
        rays,
        np.tile(np.arange(len(elevations)), len(azimuths)),
        np.repeat(azimuths, len(elevations)),
    )


def camera_axes(forward: Optional[Vector], up: Optional[Vector]) -> Tuple[Array, Array, Array]:
    """Unit vectors ahead (without its component along up), right, above."""
    above = np.asarray((0, 1, 0) if up is None else up, float)
    if above.shape != (3,) or not np.isfinite(above).all() or not above.any():
        raise ValueError(f"up must be three finite numbers, not all 0, not {up!r}")
    above = above / np.linalg.norm(above)
    if forward is None:
        forward = (0, 0, -1) if abs(above[2]) < 0.9 else (0, 1, 0)
    ahead = np.asarray(forward, float)
    ahead = ahead - (ahead @ above) * above
    length = np.linalg.norm(ahead)
    if ahead.shape != (3,) or not length > 1e-9 * np.linalg.norm(np.asarray(forward, float)):
        raise ValueError(f"forward {forward!r} must not be parallel to up {up!r}")
    ahead = ahead / length
    return ahead, np.cross(ahead, above), above
