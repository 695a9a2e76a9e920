# SPDX-License-Identifier: Apache-2.0
"""Large batches and pictures over several servers, by the workers of a Dask cluster.

    import distributed, kdray.dask
    cluster = distributed.Client("tcp://scheduler:8786")
    servers = kdray.dask.Servers(cluster, ["http://10.0.0.1:8080", "http://10.0.0.2:8080"])
    tree = servers.upload("city.ply")                     # to every server
    tree.closest("rays.npy", out="hits.npy", progress=True)
    depth = tree.render_array("depth", width=20000, height=20000)

A batch is cut into chunks, a picture into regions. Each is a task for any worker and a request to
any server; answers are joined in order, and are the same bytes as those of one server. A task whose
worker is lost runs on another. A request whose server is lost, busy, or lacks the tree goes to the
next server. The workers need this package and the way to the servers.
"""
from __future__ import annotations

import collections
import dataclasses
import os
import warnings
from contextlib import nullcontext
from typing import (
    Any,
    Callable,
    ContextManager,
    Deque,
    Dict,
    Generator,
    List,
    Optional,
    Sequence,
    Tuple,
    Union,
)

import numpy as np
import numpy.typing as npt

from .array_file import ArrayFile
from .batches import BatchInfo
from .client import Client, checked_id
from .dask_tasks import Access, Slice, Task, perform
from .meshes import MeshLike
from .npy import Array, as_rows, join
from .picture import Picture
from .progress import ProgressLike, Reporter
from .rendering import render_fields
from .transport import TraceLike, trace_of
from .words import ArrayMode, Build

__all__ = ["Servers", "SpreadTree"]

CHUNK_ROWS = 1 << 18
SENT_BYTES = 8 << 20  # of a chunk that goes to the worker with its task; the scheduler holds it
TILE_PX = 1024
MAX_TILE_PX = 16384  # the contract's largest side of a region
PATIENCE_S = 60.0  # of a request that no server takes

Path = Union[str, "os.PathLike[str]"]


class Servers:
    """Servers that have the same trees, and the Dask cluster whose workers ask them.

    cluster: a `distributed.Client`. urls: the servers; or one, that of a proxy before them.
    token: default KDRAY_TOKEN. chunk_rows: rows of a task. patience_s: how long a request is
    repeated if no server takes it. traceparent: as of `kdray.Client`; a batch or picture is of one
    trace, on all workers and servers.
    """

    def __init__(
        self,
        cluster: Any,
        urls: Sequence[str],
        *,
        token: Optional[str] = None,
        chunk_rows: int = CHUNK_ROWS,
        tile_px: int = TILE_PX,
        patience_s: float = PATIENCE_S,
        traceparent: TraceLike = None,
    ) -> None:
        if isinstance(urls, str) or not urls:
            raise ValueError(f"urls must be a list of at least one server, not {urls!r}")
        if chunk_rows < 1 or not 1 <= tile_px <= MAX_TILE_PX:
            raise ValueError(
                f"chunk_rows must be at least 1 and tile_px 1 to {MAX_TILE_PX}, "
                f"not {chunk_rows} and {tile_px}"
            )
        self.cluster = cluster
        self.chunk_rows = chunk_rows
        self.tile_px = tile_px
        token = token if token is not None else os.environ.get("KDRAY_TOKEN") or None
        self._trace = trace_of(traceparent)
        self._access = Access(tuple(url.rstrip("/") for url in urls), token, patience_s)

    @property
    def urls(self) -> Tuple[str, ...]:
        return self._access.urls

    def upload(
        self, mesh: MeshLike, *, build: Build = "auto", progress: ProgressLike = None
    ) -> "SpreadTree":
        """The tree of a mesh, on every server; nothing is sent to one that has it."""
        trees = [
            Client(
                url, token=self._access.token, progress=progress, traceparent=self._trace
            ).upload(mesh, build=build)
            for url in self.urls
        ]
        return self.tree(trees[0].id)

    def tree(self, id: str) -> "SpreadTree":
        """The tree of an id, which at least one server should have."""
        return SpreadTree(self, checked_id(id))

    def run(
        self, tasks: Sequence[Callable[[int], "Task"]]
    ) -> Generator[Tuple[int, Any], None, None]:
        """The numbers and results of tasks, in order. A bounded number of them is in work."""
        most = max(4, 2 * sum(self.cluster.nthreads().values()))
        access = dataclasses.replace(self._access, traceparent=self._trace())
        waiting: Deque[Tuple[int, Any]] = collections.deque()
        try:
            for number, make in enumerate(tasks):
                if len(waiting) >= most:
                    yield self._first(waiting)
                waiting.append(
                    (number, self.cluster.submit(perform, access, make(number), pure=False))
                )
            while waiting:
                yield self._first(waiting)
        finally:
            if waiting:
                self.cluster.cancel([future for _, future in waiting])

    @staticmethod
    def _first(waiting: Deque[Tuple[int, Any]]) -> Tuple[int, Any]:
        number, future = waiting[0]
        result = future.result()
        waiting.popleft()
        return number, result


class SpreadTree:
    """Queries and pictures of a tree that several servers have.

    rays and points are arrays or the path of a `.npy` file that the workers can read as well; from
    a file only the parts in work are in memory. out: the path of a `.npy` file that takes the
    answer; it appears when it is complete, and the method returns None. Options are those of the
    methods of `kdray.Tree`.
    """

    def __init__(self, servers: Servers, id: str) -> None:
        self.servers = servers
        self.id = id

    def closest(self, rays: Union[npt.ArrayLike, Path], **options: Any) -> Optional[Array]:
        return self._batch("closest", "rays", rays, **options)

    def any(self, rays: Union[npt.ArrayLike, Path], **options: Any) -> Optional[Array]:
        return self._batch("any", "rays", rays, **options)

    def count(self, rays: Union[npt.ArrayLike, Path], **options: Any) -> Optional[Array]:
        return self._batch("count", "rays", rays, **options)

    def all(self, rays: Union[npt.ArrayLike, Path], **options: Any) -> Optional[Array]:
        """All hits, flat; the column `ray` is the number of the row in the whole batch."""
        return self._batch("all", "rays", rays, **options)

    def closest_points(self, points: Union[npt.ArrayLike, Path], **options: Any) -> Optional[Array]:
        return self._batch("closest_points", "points", points, **options)

    def signed_distance(
        self, points: Union[npt.ArrayLike, Path], **options: Any
    ) -> Optional[Array]:
        return self._batch("signed_distance", "points", points, **options)

    def inside(self, points: Union[npt.ArrayLike, Path], **options: Any) -> Optional[Array]:
        return self._batch("inside", "points", points, **options)

    def render_array(
        self,
        mode: ArrayMode,
        *,
        width: int = 640,
        height: int = 480,
        out: Optional[Path] = None,
        progress: ProgressLike = None,
        **fields: Any,
    ) -> Optional[Array]:
        """The image as an array, of any size: each region is a request of its own."""
        fields = checked_fields(dict(fields, mode=mode, width=width, height=height))
        tiles = tiles_of(width, height, self.servers.tile_px)
        image: Optional[Array] = None
        with file_at(out) as file:
            for (x0, y0, x1, y1), part in self._tiles("render_array", tiles, fields, progress):
                if file is not None:
                    for y in range(y0, y1):
                        file.write(y * width + x0, part[y - y0])
                else:
                    if image is None:
                        image = np.empty((height, width, *part.shape[2:]), part.dtype)
                    image[y0:y1, x0:x1] = part
            if file is not None:
                file.finish((height, width))
        return image

    def render(
        self, *, width: int = 640, height: int = 480, progress: ProgressLike = None, **fields: Any
    ) -> Picture:
        """The picture: the same pixels as one server's; the file may be compressed differently."""
        fields = checked_fields(dict(fields, width=width, height=height))
        tiles = tiles_of(width, height, self.servers.tile_px)
        if fields.get("mode") == "depth" and "depth_range" not in fields and len(tiles) > 1:
            # Of each region the range would be found anew, from the whole image.
            small = dict(fields, region=[0, 0, 1, 1])
            ((_, (_, depths)),) = self.servers.run(
                [lambda number: Task(self.id, "render", small, number)]
            )
            if depths is not None:
                fields["depth_range"] = list(depths)
        image: Optional[Array] = None
        for (x0, y0, x1, y1), (part, _) in self._tiles("render", tiles, fields, progress):
            if image is None:
                image = np.empty((height, width, part.shape[2]), np.uint8)
            image[y0:y1, x0:x1] = part
        return Picture.of(np.zeros((0, 0)) if image is None else image)

    def __repr__(self) -> str:
        return f"<kdray.dask.SpreadTree {self.id[:12]}… on {len(self.servers.urls)} servers>"

    def _batch(
        self,
        query: str,
        kind: str,
        values: Union[npt.ArrayLike, Path],
        *,
        out: Optional[Path] = None,
        progress: ProgressLike = None,
        info: Optional[BatchInfo] = None,
        **options: Any,
    ) -> Optional[Array]:
        rows, shape, path = rows_of(values, kind)
        step = self.servers.chunk_rows
        if path is None:
            step = min(step, max(1, SENT_BYTES // (rows.shape[1] * rows.itemsize)))

        def chunk(number: int) -> Task:
            start, stop = number * step, min((number + 1) * step, len(rows))
            part = rows[start:stop] if path is None else None
            source = None if path is None else Slice(path, start, stop)
            return Task(self.id, query, options, number, part, source)

        info = info if info is not None else BatchInfo()
        info.clear()
        is_flat = query == "all"
        parts: List[Array] = []
        length = 0
        chunks = max(1, -(-len(rows) // step))
        with file_at(out) as file, Reporter(progress, kind, len(rows)) as report:
            for number, (part, part_info) in self.servers.run([chunk] * chunks):
                info.merge(part_info)
                if is_flat:
                    part["ray"] += number * step
                if file is not None:
                    file.write(length, part)
                else:
                    parts.append(part)
                length += len(part)
                report(min((number + 1) * step, len(rows)))
            if file is not None:
                file.finish((length,) if is_flat else shape)
        if info.truncated and options.get("max_hits") is None:
            warnings.warn(
                f"{info.truncated} rays have more hits than max_hits, of which the nearest are kept",
                stacklevel=3,
            )
        if file is not None:
            return None
        answer = join(parts)
        return answer if is_flat else answer.reshape((*shape, *answer.shape[1:]))

    def _tiles(
        self,
        query: str,
        tiles: Sequence[Tuple[int, int, int, int]],
        fields: Dict[str, Any],
        progress: ProgressLike,
    ) -> Generator[Tuple[Tuple[int, int, int, int], Any], None, None]:
        def region(number: int) -> Task:
            return Task(self.id, query, dict(fields, region=list(tiles[number])), number)

        with Reporter(progress, "regions", len(tiles)) as report:
            for number, part in self.servers.run([region] * len(tiles)):
                yield tiles[number], part
                report(number + 1)


def rows_of(
    values: Union[npt.ArrayLike, Path], kind: str
) -> Tuple[Array, Tuple[int, ...], Optional[str]]:
    """The rows, the shape of the answer, and the absolute path if they are in a file."""
    columns = (6, 8) if kind == "rays" else (3,)
    if not isinstance(values, (str, os.PathLike)):
        return (*as_rows(values, columns, kind), None)
    path = os.path.abspath(os.fspath(values))
    array = np.load(path, mmap_mode="r")
    if array.dtype.str not in ("<f4", "<f8") or not array.flags.c_contiguous:
        raise ValueError(
            f"{path} has {array.dtype.str} in Fortran order or of another kind; allowed are <f4 and "
            "<f8 in C order"
        )
    return (*as_rows(array, columns, kind), path)


def file_at(out: Optional[Path]) -> ContextManager[Optional[ArrayFile]]:
    if out is None:
        return nullcontext()
    return ArrayFile(out)


def checked_fields(fields: Dict[str, Any]) -> Dict[str, Any]:
    for name in ("region", "budget_ms"):
        if fields.get(name) is not None:
            raise ValueError(f"{name} does not go with a picture that is made of regions")
    for name in ("width", "height"):
        if int(fields[name]) < 1:
            raise ValueError(f"{name} must be at least 1, not {fields[name]}")
    return render_fields(fields)


def tiles_of(width: int, height: int, side: int) -> List[Tuple[int, int, int, int]]:
    """Regions x0, y0, x1, y1 that cover the image, row by row."""
    return [
        (x, y, min(x + side, width), min(y + side, height))
        for y in range(0, height, side)
        for x in range(0, width, side)
    ]
