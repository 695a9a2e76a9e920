#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""numpy's side of numpy_test.cc.

  numpy_oracle.py write FOLDER SEED   N.npy files of every form, each with the same rows as doubles in C order in N.rows
  numpy_oracle.py dump FILE.npy...    the type, shape and numbers of each as text
"""
import io
import sys

import numpy as np


def rays(random):
    """Arrays that kdray takes: both types, both orders, any leading shape, rows of 6 and 8."""
    for dtype in ("<f4", "<f8"):
        for leading in ((), (1,), (7,), (0,), (3, 0), (2, 3), (2, 3, 4), (5, 1, 2, 2), (1,) * 31):
            for columns in (6, 8):
                array = random.standard_normal((*leading, columns)).astype(dtype)
                yield array
                yield np.asfortranarray(array)
                yield np.ascontiguousarray(array.T).T  # Fortran order by another way


def write(folder, seed):
    random = np.random.default_rng(seed)
    count = 0
    for array in rays(random):
        for version in ((1, 0), (2, 0), (3, 0)):
            file = io.BytesIO()
            np.lib.format.write_array(file, array, version=version, allow_pickle=False)
            with open(f"{folder}/{count}.npy", "wb") as out:
                out.write(file.getvalue())
            array.reshape(-1, array.shape[-1]).astype("<f8").tofile(f"{folder}/{count}.rows")
            count += 1
    print(count)


def dump(path):
    array = np.load(path, allow_pickle=False)
    print(array.dtype.descr if array.dtype.names else array.dtype.str, array.shape)
    columns = [array[name] for name in array.dtype.names] if array.dtype.names else [array]
    for column in columns:
        print(" ".join(repr(float(number)) for number in column.reshape(-1)))


if __name__ == "__main__":
    {"write": lambda: write(sys.argv[2], int(sys.argv[3])), "dump": lambda: [dump(path) for path in sys.argv[2:]]}[sys.argv[1]]()
