# SPDX-License-Identifier: Apache-2.0
"""The ray and point queries of a tree, over batches of any size."""
from __future__ import annotations

import warnings
from contextlib import closing
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Tuple

import numpy as np
import numpy.typing as npt

from .batches import BatchInfo, block_rows, blocks
from .npy import Array, as_rows, body_of, join, read_array
from .progress import ProgressLike, Reporter
from .transport import Flight, Parameter
from .words import Cull, Fields, Interval, PointPrecision, Precision

if TYPE_CHECKING:
    from .client import Client

DEFAULT_DEADLINE_MS = 30_000  # the contract's, for batches
DEFAULT_MAX_HITS = 64  # the contract's
MOST_HITS = 1024  # of a row in one request


class Queries:
    """Rows of rays are `ox oy oz dx dy dz`, or 8 columns with `t_min t_max`; of points, `x y z`.

    Arrays may have any leading shape, which the answer has too. float32 is sent as it is, all else
    as float64; the numbers of the answer have the same type, or `dtype`. Directions need not be
    unit: t counts their lengths. Options left out (None) are the server's defaults. Every query
    takes

    - deadline_ms: the time for the answer to each block of a large batch;
    - progress: True or a function, as `Client`;
    - info: a `BatchInfo` to be filled.

    An invalid row (NaN, a zero direction) is a miss. The server's refusals are raised as `Problem`.
    """

    client: "Client"

    @property
    def id(self) -> str:
        """The tree id."""
        raise NotImplementedError

    def closest(
        self,
        rays: npt.ArrayLike,
        fields: Fields = "t,triangle,u,v",
        *,
        precision: Optional[Precision] = None,
        t_min: Optional[Interval] = None,
        t_max: Optional[Interval] = None,
        cull: Optional[Cull] = None,
        dtype: Optional[npt.DTypeLike] = None,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """The first hit of each ray: a structured array, or a plain one if there is one field.

        fields: t, triangle, u, v, normal, point, side, group, uv and shading_normal. A miss has
        triangle -1 and t inf (an invalid row NaN).
        """
        return self._batch("rays/closest", "rays", locals())

    def any(
        self,
        rays: npt.ArrayLike,
        *,
        precision: Optional[Precision] = None,
        t_min: Optional[Interval] = None,
        t_max: Optional[Interval] = None,
        cull: Optional[Cull] = None,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """Whether each ray hits anything: bool. Cheaper than `closest`."""
        return self._batch("rays/any", "rays", locals())

    def count(
        self,
        rays: npt.ArrayLike,
        *,
        precision: Optional[Precision] = None,
        t_min: Optional[Interval] = None,
        t_max: Optional[Interval] = None,
        cull: Optional[Cull] = None,
        dtype: Optional[npt.DTypeLike] = None,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """How often each ray crosses the surface; exact by default, so the parity is right."""
        return self._batch("rays/count", "rays", locals())

    def all(
        self,
        rays: npt.ArrayLike,
        fields: Fields = "t,triangle,u,v",
        *,
        max_hits: Optional[int] = None,
        precision: Optional[Precision] = None,
        t_min: Optional[Interval] = None,
        t_max: Optional[Interval] = None,
        cull: Optional[Cull] = None,
        dtype: Optional[npt.DTypeLike] = None,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """All hits of each ray: one flat structured array, sorted by ray, then t, then triangle.

        Its first column `ray` is the number of the row, counted through the leading shape. Of more
        than max_hits hits of a row (default 64, at most 1024) the nearest are kept; without
        max_hits, that raises a warning. The hits are crossings, exact by default.
        """
        info = info or BatchInfo()
        answer = self._batch("rays/all", "rays", locals())
        if max_hits is None:
            warn_of_truncation(info, DEFAULT_MAX_HITS)
        return answer

    def closest_points(
        self,
        points: npt.ArrayLike,
        fields: Fields = "distance,point,triangle,u,v",
        *,
        precision: Optional[PointPrecision] = None,
        dtype: Optional[npt.DTypeLike] = None,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """The closest point of the mesh for each point. Another field is normal."""
        return self._batch("points/closest", "points", locals())

    def signed_distance(
        self,
        points: npt.ArrayLike,
        *,
        precision: Optional[PointPrecision] = None,
        dtype: Optional[npt.DTypeLike] = None,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """The distance to the surface, negative inside; NaN where an open mesh has no sides."""
        return self._batch("points/signed-distance", "points", locals())

    def inside(
        self,
        points: npt.ArrayLike,
        *,
        precision: Optional[PointPrecision] = None,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """int8: 1 inside or on the surface, 0 outside, -1 where an open mesh leaves it unknown."""
        return self._batch("points/inside", "points", locals())

    def visibility(
        self,
        from_points: npt.ArrayLike,
        to: npt.ArrayLike,
        *,
        to_directions: bool = False,
        precision: Optional[Precision] = None,
        t_min: Optional[Interval] = None,
        t_max: Optional[Interval] = None,
        cull: Optional[Cull] = None,
        bits: bool = False,
        deadline_ms: Optional[int] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
    ) -> Array:
        """Which points see each other: bool (N, M) for N points (N, 3) and M points (M, 3).

        Points may lie on the mesh. to_directions: `to` are directions, and the rays have no end.
        bits: uint8 (N, ceil(M / 8)) in the order of numpy.packbits, an eighth of the memory.
        """
        sources, shape = as_rows(from_points, (3,), "from_points")
        targets, to_shape = as_rows(to, (3,), "to")
        if len(shape) > 1 or len(to_shape) > 1:
            raise ValueError("from_points and to must have the shapes (N, 3) and (M, 3)")
        if sources.dtype != targets.dtype:
            sources, targets = sources.astype("<f8"), targets.astype("<f8")
        options: Dict[str, Parameter] = dict(
            precision=precision,
            t_min=t_min,
            t_max=t_max,
            cull=cull,
            deadline_ms=deadline_ms,
            bits=True,
            to_directions=True if to_directions else None,
        )
        pairs = int(self.client.limits["max_rays"])
        # Of one request: a multiple of 8, so parts of rows are whole bytes, or all.
        columns = min(len(targets), max(8, pairs // 8 * 8))
        packed = np.empty((len(sources), -(-len(targets) // 8)), np.uint8)
        info = info or BatchInfo()
        info.clear()
        total = float(len(sources) * len(targets))
        with Reporter(self.client.progress_or(progress), "pairs", total) as report:
            for left in range(0, max(len(targets), 1), max(columns, 1)):
                seen = targets[left : left + columns]

                def ask(start: int, stop: int, flight: Flight) -> Tuple[Array, BatchInfo]:
                    return self._ask(
                        "visibility",
                        dict(options, from_count=stop - start),
                        (sources[start:stop], seen),
                        flight,
                    )

                rows = block_rows(len(sources), self.client.parallel, pairs // max(len(seen), 1))
                with closing(blocks(len(sources), rows, self.client.parallel, ask)) as answers:
                    for start, stop, (part, part_info) in answers:
                        info.merge(part_info)
                        packed[start:stop, left // 8 : left // 8 + part.shape[1]] = part
                        report(float(len(sources) * left + stop * len(seen)))
        info.invalid = count_invalid(sources) + count_invalid(targets)
        if to_directions:
            info.invalid += int((~targets.any(axis=1)).sum())
        if bits:
            return packed
        return np.unpackbits(packed, axis=1, count=len(targets)).view(bool)

    def _path(self, part: str = "") -> str:
        return f"/v1/trees/{self.id}" + ("/" + part if part else "")

    def _batch(self, query: str, kind: str, given: Mapping[str, Any]) -> Array:
        """The joined answer for all rows, in their leading shape (`all`: flat).

        kind: rays or points. given: the arguments of the query, named as the contract's parameters.
        """
        rows, shape = as_rows(given[kind], (6, 8) if kind == "rays" else (3,), kind)
        options = options_of(given)
        info = given["info"] if given["info"] is not None else BatchInfo()
        info.clear()
        limits = self.client.limits
        most = int(limits["max_rays"])
        is_flat = query == "rays/all"
        if is_flat:  # so no block has more hits than an answer may have
            most = min(
                most, int(limits["max_answer_hits"]) // int(options["max_hits"] or DEFAULT_MAX_HITS)
            )

        def ask(start: int, stop: int, flight: Flight) -> Tuple[Array, BatchInfo]:
            return self._ask(query, options, (rows[start:stop],), flight)

        parts: List[Array] = []
        answer: Optional[Array] = None
        block = block_rows(len(rows), self.client.parallel, most)
        with Reporter(self.client.progress_or(given["progress"]), kind, len(rows)) as report, closing(
            blocks(len(rows), block, self.client.parallel, ask)
        ) as answers:
            for start, stop, (part, part_info) in answers:
                info.merge(part_info)
                if is_flat:
                    part["ray"] += start
                    parts.append(part)
                elif stop - start == len(rows):
                    answer = part
                else:
                    if answer is None:
                        answer = np.empty((len(rows), *part.shape[1:]), part.dtype)
                    answer[start:stop] = part
                report(stop)
        if is_flat:
            return join(parts)
        assert answer is not None
        return answer.reshape((*shape, *answer.shape[1:]))

    def _ask(
        self, query: str, options: Mapping[str, Parameter], parts: Tuple[Array, ...], flight: Flight
    ) -> Tuple[Array, BatchInfo]:
        deadline_ms = options.get("deadline_ms")
        answer = self.client.request(
            "POST",
            self._path(query),
            options,
            body_of(*parts),
            flight=flight,
            work_s=float(DEFAULT_DEADLINE_MS if deadline_ms is None else deadline_ms) / 1000,
        )
        return read_array(answer.content), BatchInfo.of(answer)


def count_invalid(points: Array) -> int:
    """Rows with a number that is not finite. Each is in many requests, so theirs do not add up."""
    return int((~np.isfinite(points).all(axis=1)).sum())


def warn_of_truncation(info: BatchInfo, most: int) -> None:
    """Warns the caller's caller of hits that are missing because a row has more than `most`."""
    if info.truncated:
        more = f"; pass max_hits (at most {MOST_HITS})" if most < MOST_HITS else ""
        warnings.warn(
            f"{info.truncated} rays have more than {most} hits, of which the nearest are kept{more}",
            stacklevel=3,
        )


def options_of(given: Mapping[str, Any]) -> Dict[str, Parameter]:
    """The contract's parameters among the arguments of a query."""
    own = ("self", "rays", "points", "progress", "info")
    options = {name: value for name, value in given.items() if name not in own}
    if "fields" in options:
        options["fields"] = field_text(options["fields"])
    if "dtype" in options:
        options["dtype"] = dtype_text(options["dtype"])
    return options


def dtype_text(dtype: Optional[npt.DTypeLike]) -> Optional[str]:
    """f4 or f8, of whatever NumPy takes as a dtype."""
    if dtype is None:
        return None
    text = np.dtype(dtype).str[1:]
    if text not in ("f4", "f8"):
        raise ValueError(f"dtype must be float32 or float64, not {dtype}")
    return text


def field_text(fields: Fields) -> str:
    return fields if isinstance(fields, str) else ",".join(fields)
