# SPDX-License-Identifier: Apache-2.0
"""A `.npy` file that is written piece by piece and appears under its name when it is complete."""
from __future__ import annotations

import os
from typing import IO, Any, Optional, Sequence, Tuple, Union

import numpy as np

from .npy import FORMAT, Array

# Room for the header, whose length depends on the shape, and the shape is known at the end.
HEADER_BYTES = 1024


class ArrayFile:
    """Rows of one type, written at their places. A context manager; without `finish` nothing stays.

    The first piece decides the type and the shape of a row. Memory does not grow with the file.
    """

    def __init__(self, path: Union[str, "os.PathLike[str]"]) -> None:
        self._path = os.fspath(path)
        self._unfinished = f"{self._path}.{os.getpid()}.part"
        self._file: Optional[IO[bytes]] = open(self._unfinished, "wb")
        self._row: Optional[Tuple[Any, Tuple[int, ...]]] = None
        self._row_bytes = 0

    def write(self, index: int, rows: Array) -> None:
        """Rows index to index + len(rows)."""
        row = (rows.dtype, rows.shape[1:])
        if self._row is None:
            self._row = row
            self._row_bytes = int(np.prod(rows.shape[1:], dtype=np.int64)) * rows.dtype.itemsize
        if row != self._row:
            raise ValueError(f"rows of {row[0]} {row[1]} after rows of {self._row[0]}")
        if rows.size and self._file is not None:
            self._file.seek(HEADER_BYTES + index * self._row_bytes)
            self._file.write(np.ascontiguousarray(rows).reshape(-1).view(np.uint8).data)

    def finish(self, shape: Sequence[int]) -> None:
        """Writes the header for an array of this leading shape, and gives the file its name."""
        if self._row is None or self._file is None:
            raise ValueError("an array of no known type cannot be written")
        dtype, inner = self._row
        text = repr(
            {
                "descr": FORMAT.dtype_to_descr(dtype),
                "fortran_order": False,
                "shape": (*(int(size) for size in shape), *inner),
            }
        )
        room = HEADER_BYTES - 10  # after the magic, the version and the length
        if len(text) >= room:
            raise ValueError(f"a type of {len(text)} characters does not fit the file's header")
        self._file.seek(0)
        self._file.write(b"\x93NUMPY\x01\x00" + room.to_bytes(2, "little"))
        self._file.write(text.ljust(room - 1).encode() + b"\n")
        self._file.close()
        self._file = None
        os.replace(self._unfinished, self._path)

    def __enter__(self) -> "ArrayFile":
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()
            os.unlink(self._unfinished)
