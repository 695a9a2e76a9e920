# SPDX-License-Identifier: Apache-2.0
"""The pictures and scans of a tree."""
from __future__ import annotations

from typing import Any, Dict, List, Optional, Union

import numpy as np
import numpy.typing as npt

from . import scans
from .npy import Array, read_array
from .picture import Picture
from .progress import ProgressLike
from .queries import Queries
from .rendering import DEFAULT_DEADLINE_MS, render_fields, render_json
from .transport import Answer, Body
from .words import ArrayMode, Mode, Precision, Projection, Vector, View


class Pictures(Queries):
    """Renders. Fields and defaults are the contract's (RenderRequest in /docs of a server)."""

    def render(
        self,
        *,
        width: Optional[int] = None,
        height: Optional[int] = None,
        projection: Optional[Projection] = None,
        eye: Optional[Vector] = None,
        target: Optional[Vector] = None,
        up: Optional[Vector] = None,
        view: Optional[View] = None,
        fov_deg: Optional[float] = None,
        view_height: Optional[float] = None,
        h_fov_deg: Optional[float] = None,
        v_fov_deg: Optional[float] = None,
        intrinsic: Optional[npt.ArrayLike] = None,
        extrinsic: Optional[npt.ArrayLike] = None,
        mode: Optional[Mode] = None,
        depth_range: Optional[Vector] = None,
        samples: Optional[int] = None,
        precision: Optional[Precision] = None,
        color: Union[None, str, Vector] = None,
        background: Union[None, str, Vector] = None,
        lights: Optional[List[Dict[str, Any]]] = None,
        shadows: Optional[bool] = None,
        smooth: Optional[bool] = None,
        ao_radius: Optional[float] = None,
        edges: Optional[bool] = None,
        cells_depth: Optional[int] = None,
        region: Optional[Vector] = None,
        seed: Optional[int] = None,
        budget_ms: Optional[int] = None,
        max_noise: Optional[float] = None,
        max_samples: Optional[int] = None,
        deadline_ms: Optional[int] = None,
    ) -> Picture:
        """A picture, which a notebook shows. `tree.render()` shows the whole mesh.

        The fields are the contract's (`/docs`), and so are their defaults. intrinsic may also be a
        3 x 3 camera matrix, extrinsic a 4 x 4 matrix.
        """
        return self._picture(render_fields(locals()))

    def render_array(
        self,
        mode: ArrayMode,
        *,
        width: Optional[int] = None,
        height: Optional[int] = None,
        projection: Optional[Projection] = None,
        eye: Optional[Vector] = None,
        target: Optional[Vector] = None,
        up: Optional[Vector] = None,
        view: Optional[View] = None,
        fov_deg: Optional[float] = None,
        view_height: Optional[float] = None,
        h_fov_deg: Optional[float] = None,
        v_fov_deg: Optional[float] = None,
        intrinsic: Optional[npt.ArrayLike] = None,
        extrinsic: Optional[npt.ArrayLike] = None,
        samples: Optional[int] = None,
        precision: Optional[Precision] = None,
        color: Union[None, str, Vector] = None,
        lights: Optional[List[Dict[str, Any]]] = None,
        shadows: Optional[bool] = None,
        smooth: Optional[bool] = None,
        ao_radius: Optional[float] = None,
        edges: Optional[bool] = None,
        cells_depth: Optional[int] = None,
        region: Optional[Vector] = None,
        seed: Optional[int] = None,
        budget_ms: Optional[int] = None,
        max_noise: Optional[float] = None,
        max_samples: Optional[int] = None,
        deadline_ms: Optional[int] = None,
    ) -> Array:
        """The image as an array; row 0 is the top.

        depth (H, W) f4, inf for a miss; triangle (H, W) i4, -1 for a miss; normal (H, W, 3) f4;
        position (H, W, 3) f8, NaN for a miss; cost (H, W, 2) i4; shaded (H, W, 4) f4 and
        ambient-occlusion (H, W) f4, both linear.
        """
        return self._array(render_fields(locals()))

    def scan(
        self,
        eye: Optional[Vector] = None,
        target: Optional[Vector] = None,
        up: Optional[Vector] = None,
        h_fov_deg: float = 360.0,
        v_fov_deg: float = 180.0,
        width: int = 1024,
        height: int = 256,
        **fields: Any,
    ) -> Array:
        """A lidar scan: the points that a spherical camera sees, (N, 3) f8; misses are left out.

        Rows run from the top; of each row, from left to right. For a list of beams: `scan_beams`.
        """
        points = self._array(
            render_fields(
                dict(
                    fields,
                    mode="position",
                    projection="spherical",
                    eye=eye,
                    target=target,
                    up=up,
                    h_fov_deg=h_fov_deg,
                    v_fov_deg=v_fov_deg,
                    width=width,
                    height=height,
                )
            )
        ).reshape(-1, 3)
        return np.ascontiguousarray(points[~np.isnan(points[:, 0])])

    def scan_beams(
        self,
        eye: Vector,
        elevations_deg: npt.ArrayLike,
        azimuths_deg: Union[int, npt.ArrayLike] = 1800,
        *,
        forward: Optional[Vector] = None,
        up: Optional[Vector] = None,
        min_range: float = 0.0,
        max_range: float = np.inf,
        precision: Optional[Precision] = None,
        progress: ProgressLike = None,
    ) -> scans.Scan:
        """A scan by a lidar whose beams have these elevations, in the order in which it turns.

        elevations_deg: above the plane across `up`. azimuths_deg: from `forward` to the right, or a
        number of equal steps of a whole turn. up is 0,1,0 and forward 0,0,-1 by default, as in
        pictures.
        """
        rays, beams, azimuths = scans.beam_rays(eye, elevations_deg, azimuths_deg, forward, up)
        hits = self.closest(
            rays,
            fields="t,point",
            precision=precision,
            t_min=min_range,
            t_max=max_range,
            progress=progress,
        )
        hit = np.isfinite(hits["t"])
        return scans.Scan(
            np.ascontiguousarray(hits["point"][hit]),
            np.ascontiguousarray(hits["t"][hit]),
            beams[hit],
            azimuths[hit],
        )

    def _image(self, form: str, fields: Dict[str, Any]) -> Answer:
        deadline_ms = int(fields.get("deadline_ms", DEFAULT_DEADLINE_MS))
        return self.client.request(
            "POST",
            self._path("render." + form),
            None,
            Body.of(render_json(fields), "application/json"),
            work_s=deadline_ms / 1000,
        )

    def _picture(self, fields: Dict[str, Any]) -> Picture:
        answer = self._image("png", fields)
        return Picture(bytes(answer.content), answer.headers)

    def _array(self, fields: Dict[str, Any]) -> Array:
        return read_array(self._image("npy", fields).content)
