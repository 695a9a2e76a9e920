# SPDX-License-Identifier: Apache-2.0
"""The server: uploads, and the trees that it has."""
from __future__ import annotations

import json
import os
import ssl
from typing import Any, Callable, Dict, Iterator, Mapping, Optional

from .errors import Problem
from .meshes import MeshLike, Source
from .progress import ProgressLike, Reporter
from .transport import Answer, Body, Flight, Parameter, TraceLike, Transport
from .tree import Tree
from .words import Build

__all__ = ["Client"]

DEFAULT_URL = "http://127.0.0.1:8080"
FIRST_WAIT_MS = 100  # small meshes are built within it


class Client:
    """A kdray server. Safe from many threads; connections are kept and shared.

    url: default KDRAY_SERVER, else http://127.0.0.1:8080; it may have a path, and be https.
    token: default KDRAY_TOKEN; for servers that need one.
    progress: True shows bars (of tqdm if it is installed) for whatever takes longer than a moment,
    a function gets each `Progress`; each method that takes `progress` may override it.
    parallel: requests of one large batch at the same time.
    retry_s: how long an overloaded server (503) and a tree that is being built (409) are asked
    again; connections that break are replaced, and the request repeated, a few times. 0 for
    neither.
    stall_s: a server that sends nothing for this long, beyond the time of the request's own work,
    is given up.
    ssl_context: for https with certificates of your own.
    traceparent: the trace of the requests (W3C Trace Context), or a function that returns the
    present one; default TRACEPARENT, at each request. Servers log it beside the request's id.
    """

    def __init__(
        self,
        url: Optional[str] = None,
        *,
        token: Optional[str] = None,
        progress: ProgressLike = None,
        parallel: int = 4,
        retry_s: float = 60.0,
        stall_s: float = 60.0,
        ssl_context: Optional[ssl.SSLContext] = None,
        traceparent: TraceLike = None,
    ) -> None:
        if parallel < 1:
            raise ValueError(f"parallel must be at least 1, not {parallel}")
        if not retry_s >= 0 or not stall_s > 0:
            raise ValueError(
                f"retry_s must be at least 0 and stall_s above 0, not {retry_s} and {stall_s}"
            )
        self.progress = progress
        self.parallel = parallel
        self._token = token if token is not None else os.environ.get("KDRAY_TOKEN") or None
        self._settings = (retry_s, stall_s)
        self._traceparent = traceparent if isinstance(traceparent, str) else None
        url = url or os.environ.get("KDRAY_SERVER") or DEFAULT_URL
        self._transport = Transport(
            url, self._token, ssl_context, stall_s, retry_s, traceparent
        )
        self._info: Optional[Dict[str, Any]] = None

    @property
    def url(self) -> str:
        return self._transport.url

    @property
    def info(self) -> Dict[str, Any]:
        """Name, version, formats, builds, precisions and limits of the server, asked once."""
        if self._info is None:
            self._info = dict(json.loads(self.request("GET", "/v1").content))
        return self._info

    @property
    def limits(self) -> Dict[str, int]:
        """The server's limits, by the names that its problems use."""
        return dict(self.info["limits"])

    def upload(
        self,
        mesh: MeshLike,
        *,
        build: Build = "auto",
        wait: bool = True,
        progress: ProgressLike = None,
    ) -> Tree:
        """The tree of a mesh; nothing is sent that the server has.

        mesh: the path of an OBJ, PLY, STL, OFF, GLB or glTF file; its bytes; (vertices, faces) as
        arrays (N, 3) and (M, k); or an object with `vertices` and `faces`, such as a
        trimesh.Trimesh. A face of k corners becomes k - 2 triangles.
        wait: until the tree is built. A mesh that is refused raises a Problem with its line or
        byte.
        """
        source = Source(mesh)
        progress = self.progress_or(progress)
        tree = self._known(f"{source.sha256}-{build}")
        if tree is None:
            try:
                tree = self.tree_of_stored_mesh(source.sha256, build)
            except Problem as problem:
                if problem.status != 404:
                    raise
                tree = self._send(source, build, progress)
        return tree.wait(progress) if wait else tree

    def tree(self, id: str) -> Tree:
        """The tree of an id."""
        answer = self.request("GET", f"/v1/trees/{checked_id(id)}")
        return Tree(self, json.loads(answer.content))

    def trees(self, mesh: Optional[str] = None) -> Iterator[Tree]:
        """All trees, newest first; of one mesh, if its SHA-256 is given."""
        after: Optional[str] = None
        while True:
            page = json.loads(
                self.request("GET", "/v1/trees", {"mesh": mesh, "after": after}).content
            )
            yield from (Tree(self, description) for description in page["trees"])
            after = page["next"]
            if after is None:
                return

    def tree_of_stored_mesh(self, sha256: str, build: Build = "auto") -> Tree:
        """A build of a mesh that the server has, perhaps unfinished; else mesh_not_found."""
        answer = self.request(
            "POST", "/v1/trees", {"mesh": sha256, "build": build, "wait_ms": FIRST_WAIT_MS}
        )
        return Tree(self, json.loads(answer.content))

    def close(self) -> None:
        """Closes idle connections. The client can still be used."""
        self._transport.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<kdray.Client {self.url}>"

    def __getstate__(self) -> Dict[str, Any]:
        # Connections stay behind. An ssl_context and a function for the trace cannot be pickled, so
        # the defaults take their places.
        retry_s, stall_s = self._settings
        progress = self.progress if self.progress in (None, True, False) else None
        return {
            "url": self.url,
            "token": self._token,
            "progress": progress,
            "parallel": self.parallel,
            "retry_s": retry_s,
            "stall_s": stall_s,
            "traceparent": self._traceparent,
        }

    def __setstate__(self, state: Dict[str, Any]) -> None:
        Client.__init__(self, **state)

    def request(
        self,
        method: str,
        path: str,
        parameters: Optional[Mapping[str, Parameter]] = None,
        body: Optional[Body] = None,
        *,
        work_s: float = 0,
        on_sent: Optional[Callable[[int], None]] = None,
        flight: Optional[Flight] = None,
    ) -> Answer:
        """One request of the contract, with all this package knows about connections and errors."""
        return self._transport.request(
            method, path, parameters, body, work_s=work_s, on_sent=on_sent, flight=flight
        )

    def find(self, method: str, path: str) -> Optional[Answer]:
        """The answer; None for 404."""
        try:
            return self.request(method, path)
        except Problem as problem:
            if problem.status == 404:
                return None
            raise

    def progress_or(self, progress: ProgressLike) -> ProgressLike:
        return self.progress if progress is None else progress

    def _known(self, id: str) -> Optional[Tree]:
        """The tree if the server has it. A failed build is tried again by an upload."""
        try:
            return self.tree(id)
        except Problem as problem:
            if problem.status in (404, 422):
                return None
            raise

    def _send(self, source: Source, build: Build, progress: ProgressLike) -> Tree:
        # A server that refuses an upload early may close before its reason is read, so the limit
        # comes first.
        limit = self.limits["max_upload_bytes"]
        if source.size > limit:
            raise Problem(
                413,
                {
                    "code": "mesh_too_large",
                    "limit": limit,
                    "actual": source.size,
                    "detail": f"{source.name} has {source.size} bytes; this server takes {limit}. "
                    "Nothing was sent.",
                },
            )
        with Reporter(progress, "upload", source.size) as report:
            answer = self.request(
                "POST",
                "/v1/trees",
                {"build": build, "wait_ms": FIRST_WAIT_MS},
                source.body(),
                on_sent=report,
                work_s=60,
            )
        tree = Tree(self, json.loads(answer.content))
        if not tree.id.startswith(source.sha256):
            raise ValueError(
                f"{source.name} changed while it was sent; the server now has tree {tree.id}"
            )
        return tree


def checked_id(id: str) -> str:
    digest, dash, build = id.partition("-")
    allowed = set("abcdefghijklmnopqrstuvwxyz0123456789.-")
    if (
        len(digest) != 64
        or not set(digest) <= set("0123456789abcdef")
        or not dash
        or not build
        or not (set(build) <= allowed)
    ):
        raise ValueError(f"{id!r} is not a tree id: 64 hexadecimal digits, a dash, and a build")
    return id
