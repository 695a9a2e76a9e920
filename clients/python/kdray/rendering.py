# SPDX-License-Identifier: Apache-2.0
"""Fields of a render as JSON, and the image that comes back."""
from __future__ import annotations

import json
from typing import Any, Dict, Mapping

import numpy as np

DEFAULT_DEADLINE_MS = 60_000  # the contract's, for renders


def render_fields(arguments: Mapping[str, Any]) -> Dict[str, Any]:
    """The fields that were given (not None), with arrays as lists."""
    return {
        name: _plain(value, name)
        for name, value in arguments.items()
        if value is not None and name != "self"
    }


def render_json(fields: Mapping[str, Any]) -> bytes:
    try:
        return json.dumps(fields, allow_nan=False).encode()
    except ValueError:
        raise ValueError("numbers of a render must be finite") from None


def _plain(value: Any, name: str) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        # A 4 x 4 extrinsic goes row by row; a 3 x 3 intrinsic is the camera matrix.
        if name == "intrinsic" and value.shape == (3, 3):
            return [float(value[0, 0]), float(value[1, 1]), float(value[0, 2]), float(value[1, 2])]
        return value.reshape(-1).tolist()
    if isinstance(value, Mapping):
        return {key: _plain(item, "") for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        if name in ("intrinsic", "extrinsic"):
            return _plain(np.asarray(value, float), name)
        return [_plain(item, "") for item in value]
    return value
