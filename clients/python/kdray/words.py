# SPDX-License-Identifier: Apache-2.0
"""The words of the contract, for type checkers and editors. The server knows which there are."""
from __future__ import annotations

from typing import Any, Literal, Sequence, Union

import numpy.typing as npt

Build = Literal["auto", "kd-sah", "kd-binned", "kd-cyclic", "kd-median", "bvh", "box"]
Precision = Literal["auto", "fast", "watertight", "double", "exact"]
PointPrecision = Literal["auto", "double", "exact"]
Cull = Literal["none", "back", "front"]
Mode = Literal["shaded", "normal", "depth", "triangle", "ambient-occlusion", "cost"]
ArrayMode = Literal[
    "shaded", "normal", "depth", "triangle", "ambient-occlusion", "cost", "position"
]
Projection = Literal["perspective", "orthographic", "spherical"]
View = Literal["iso", "front", "back", "left", "right", "top", "bottom"]

Interval = Union[float, Literal["auto"]]  # t_min, t_max
Fields = Union[str, Sequence[str]]  # "t,triangle" or ["t", "triangle"]
Vector = Union[Sequence[float], npt.NDArray[Any]]  # three numbers, if not said otherwise
