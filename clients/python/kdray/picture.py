# SPDX-License-Identifier: Apache-2.0
"""Pictures: PNG files that notebooks show by themselves, and as arrays."""
from __future__ import annotations

import os
import struct
import zlib
from typing import Any, List, Mapping, Optional, Tuple, Union

import numpy as np
import numpy.typing as npt

from .npy import Array

__all__ = ["Picture"]

SIGNATURE = b"\x89PNG\r\n\x1a\n"
COLOUR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}  # channels to PNG's code


class Picture:
    """A PNG file in memory. As the last value of a notebook's cell it is shown.

    data are the bytes of the file. precision, samples, noise, stopped and depth_range are what the
    server says about its picture (`Kdray-Precision` and so on), and None for pictures of arrays.
    """

    def __init__(self, data: bytes, headers: Optional[Mapping[str, str]] = None) -> None:
        headers = headers or {}
        self.data = data
        self.precision: Optional[str] = headers.get("kdray-precision")
        self.samples = _number(int, headers.get("kdray-samples"))
        self.noise = _number(float, headers.get("kdray-noise"))
        self.stopped: Optional[str] = headers.get("kdray-stopped")
        depths = headers.get("kdray-depth-range")
        self.depth_range: Optional[Tuple[float, float]] = None
        if depths:
            near, far = depths.split(",")
            self.depth_range = float(near), float(far)

    @staticmethod
    def of(array: npt.ArrayLike) -> "Picture":
        """The picture of an array (H, W) or (H, W, 1 to 4): grey, grey with alpha, RGB, RGBA.

        uint8 is taken as it is; bool is black and white; other numbers are clipped to 0..1, and NaN
        is 0.
        """
        values = np.asarray(array)
        if values.ndim == 2:
            values = values[:, :, None]
        if values.ndim != 3 or values.shape[2] not in COLOUR_TYPES or 0 in values.shape:
            raise ValueError(
                f"a picture has the shape (H, W) or (H, W, 1 to 4), not {np.shape(array)}"
            )
        if values.dtype != np.uint8:
            values = (np.clip(np.nan_to_num(values.astype(float)), 0, 1) * 255 + 0.5).astype(
                np.uint8
            )
        return Picture(encode_png(values))

    def array(self) -> Array:
        """The pixels: uint8 of shape (H, W, channels)."""
        return decode_png(self.data)

    def __array__(self, dtype: Any = None, copy: Any = None) -> Array:
        return self.array().astype(dtype or np.uint8)

    def save(self, path: Union[str, "os.PathLike[str]"]) -> "Picture":
        """Writes the file, and returns the picture, so a notebook shows it too."""
        with open(path, "wb") as file:
            file.write(self.data)
        return self

    @property
    def size(self) -> Tuple[int, int]:
        """Width and height in pixels."""
        width, height = struct.unpack(">II", self.data[16:24])
        return width, height

    def _repr_png_(self) -> bytes:
        return self.data

    def __repr__(self) -> str:
        width, height = self.size
        return f"<kdray.Picture {width} x {height}, {len(self.data):,} bytes>"


def encode_png(pixels: Array) -> bytes:
    """uint8 (H, W, channels); each row is stored as its difference from the row above."""
    height, width, channels = pixels.shape
    rows = np.empty((height, 1 + width * channels), np.uint8)
    rows[:, 0] = 2
    flat = pixels.reshape(height, -1)
    rows[0, 1:] = flat[0]
    np.subtract(flat[1:], flat[:-1], out=rows[1:, 1:])  # modulo 256, as PNG wants it
    header = struct.pack(">IIBBBBB", width, height, 8, COLOUR_TYPES[channels], 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b"")
    return SIGNATURE + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


def decode_png(data: bytes) -> Array:
    """The pixels of a PNG of 8 bits a channel that is neither interlaced nor indexed."""
    if data[:8] != SIGNATURE:
        raise ValueError("not a PNG file")
    header, packed, at = b"", b"", 8
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + size]
        at += 12 + size
        if kind == b"IHDR":
            header = body
        elif kind == b"IDAT":
            packed += body
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    channels = {code: count for count, code in COLOUR_TYPES.items()}.get(colour)
    if depth != 8 or interlaced or channels is None:
        raise ValueError(
            "only PNG files of 8 bits a channel, without a palette, not interlaced, are read"
        )
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * channels)
    above = np.zeros((width, channels), np.uint8)
    pixels: List[Array] = []
    for row in rows:
        above = _unfilter(int(row[0]), row[1:].reshape(width, channels), above)
        pixels.append(above)
    return np.stack(pixels)


def _unfilter(kind: int, row: Array, above: Array) -> Array:
    """One row; the filters of the PNG specification, section 9."""
    if kind == 0:
        return row
    if kind == 1:
        return np.cumsum(row, axis=0, dtype=np.uint8)
    if kind == 2:
        return row + above
    if kind not in (3, 4):
        raise ValueError(f"PNG has no filter {kind}")
    result = np.zeros((len(row) + 1, row.shape[1]), np.int64)  # a pixel of zeros on the left
    up = np.vstack([np.zeros((1, row.shape[1]), np.uint8), above]).astype(np.int64)
    for x in range(len(row)):
        left, over, corner = result[x], up[x + 1], up[x]
        if kind == 3:
            guess = (left + over) // 2
        else:
            far = np.abs(np.stack([over - corner, left - corner, left + over - 2 * corner]))
            guess = np.choose(far.argmin(axis=0), [left, over, corner])
        result[x + 1] = (row[x] + guess) % 256
    return result[1:].astype(np.uint8)


def _number(kind: Any, text: Optional[str]) -> Any:
    return None if text is None else kind(text)
