# SPDX-License-Identifier: Apache-2.0
"""Arrays as bodies (`.npy`), and answers as arrays, without copies of the data."""
from __future__ import annotations

import io
from typing import Any, Iterable, List, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from .transport import Body, Buffer

Array = npt.NDArray[Any]
PIECE_BYTES = 1 << 20
FORMAT: Any = np.lib.format  # without types in the NumPy of Debian 12


def as_rows(
    values: npt.ArrayLike, columns: Sequence[int], name: str
) -> Tuple[Array, Tuple[int, ...]]:
    """The rows as a 2-D array of <f4 or <f8, and the shape of the answer.

    float32 and float16 stay or become <f4; other numbers become <f8.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name} must be numbers, not {array.dtype}")
    if array.ndim == 1 and array.size == 0:  # []
        array = array.reshape(0, columns[0])
    if array.ndim == 0 or array.shape[-1] not in columns:
        allowed = " or ".join(f"(…, {count})" for count in columns)
        raise ValueError(f"{name} must have the shape {allowed}, not {array.shape}")
    is_single = array.dtype.kind == "f" and array.dtype.itemsize <= 4
    rows = array.astype("<f4" if is_single else "<f8", copy=False)
    return rows.reshape(-1, array.shape[-1]), array.shape[:-1]


def body_of(*parts: Array) -> Body:
    """2-D arrays of one type and width, one after the other, as one .npy body."""
    arrays = [np.ascontiguousarray(part) for part in parts]
    head = io.BytesIO()
    FORMAT.write_array_header_1_0(
        head,
        {
            "descr": FORMAT.dtype_to_descr(arrays[0].dtype),
            "fortran_order": False,
            "shape": (sum(len(array) for array in arrays), arrays[0].shape[1]),
        },
    )
    header = head.getvalue()

    def pieces() -> Iterable[Buffer]:
        yield header
        for array in arrays:
            if array.size:
                data: memoryview = array.reshape(-1).view(np.uint8).data
                for start in range(0, len(data), PIECE_BYTES):
                    yield data[start : start + PIECE_BYTES]

    return Body(len(header) + sum(array.nbytes for array in arrays), "application/x-npy", pieces)


def read_array(content: bytearray) -> Array:
    """The array in an answer; it shares the memory of content and can be written."""
    head = io.BytesIO(bytes(content[: 1 << 16]))
    version = FORMAT.read_magic(head)
    read = FORMAT.read_array_header_1_0 if version == (1, 0) else FORMAT.read_array_header_2_0
    shape, is_fortran, dtype = read(head)
    count = int(np.prod(shape, dtype=np.int64))
    array = np.frombuffer(content, dtype, count, head.tell())
    return array.reshape(shape, order="F" if is_fortran else "C")


def join(parts: List[Array]) -> Array:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
