# SPDX-License-Identifier: Apache-2.0
"""A tree on a server: what it is, ray and point queries, pictures. All methods are thread-safe."""
from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any, Dict, List, Mapping

import numpy as np

from .npy import Array
from .pictures import Pictures
from .progress import ProgressLike, Reporter
from .tradeoff import Tradeoff
from .words import Build

if TYPE_CHECKING:
    from .client import Client

__all__ = ["Tree"]

POLL_MS = 500


class Tree(Pictures):
    """A tree, named by its id: `Client.upload` and `Client.tree` give it.

    `description` is the server's (`GET /v1/trees/{id}`); the properties read it. Queries of a tree
    that is still being built wait for it.
    """

    def __init__(self, client: "Client", description: Mapping[str, Any]) -> None:
        self.client = client
        self.description: Dict[str, Any] = dict(description)

    @property
    def id(self) -> str:
        """SHA-256 of the mesh bytes, a dash, and the build."""
        return str(self.description["id"])

    @property
    def is_ready(self) -> bool:
        return bool(self.description["state"] == "ready")

    @property
    def mesh(self) -> Dict[str, Any]:
        """sha256, format, bytes, triangles, vertices, bounds, health, groups, area, volume."""
        return dict(self._ready()["mesh"])

    @property
    def triangles(self) -> int:
        """Triangle numbers are below this."""
        return int(self.mesh["triangles"])

    @property
    def bounds(self) -> Array:
        """(2, 3): smallest and largest coordinates of the vertices that triangles use."""
        box = self.mesh["bounds"]
        return np.array([box["min"], box["max"]], float)

    @property
    def is_closed(self) -> bool:
        """Whether inside and outside are defined everywhere."""
        return bool(self.mesh["health"]["closed"])

    @property
    def groups(self) -> List[str]:
        """Names of the mesh's parts; the answer field `group` is an index into it."""
        if "groups" not in self.mesh:  # lists of trees leave them out
            self.refresh()
        return list(self.mesh.get("groups", []))

    @property
    def build(self) -> str:
        """The structure that was built, never auto."""
        return str(self._ready()["tree"]["build"])

    def refresh(self, wait_ms: int = 0) -> "Tree":
        """Asks for the description again; waits up to wait_ms for a build."""
        answer = self.client.request(
            "GET", self._path(), {"wait_ms": wait_ms}, work_s=wait_ms / 1000
        )
        self.description = dict(json.loads(answer.content))
        return self

    def wait(self, progress: ProgressLike = None) -> "Tree":
        """Waits until the tree is built. A build that fails raises its Problem."""
        with Reporter(self.client.progress_or(progress), "build", 1.0) as report:
            while not self.is_ready:
                report(float(self.description["progress"]))
                asked = time.monotonic()
                self.refresh(POLL_MS)
                if not self.is_ready:  # no tight loop with a server that does not wait
                    time.sleep(max(0.0, 0.05 - (time.monotonic() - asked)))
        return self

    def rebuild(self, build: Build) -> "Tree":
        """Another build of the same mesh; nothing is sent."""
        return self.client.tree_of_stored_mesh(
            str(self.description["mesh"]["sha256"]), build
        ).wait()

    def delete(self) -> None:
        """The mesh goes with its last tree."""
        self.client.request("DELETE", self._path())

    def mesh_bytes(self) -> bytes:
        """The bytes that were uploaded."""
        return bytes(self.client.request("GET", self._path("mesh")).content)

    def cells(self, depth: int) -> Array:
        """The boxes of the nodes at a depth, and of leaves above it.

        Structured: min and max (3,) f8, depth i8, leaf bool, triangles i8.
        """
        answer = self.client.request("GET", self._path("cells"), {"depth": depth}, work_s=30)
        cells = json.loads(answer.content)["cells"]
        kind = np.dtype(
            [
                ("min", "f8", 3),
                ("max", "f8", 3),
                ("depth", "i8"),
                ("leaf", "?"),
                ("triangles", "i8"),
            ]
        )
        return np.array([tuple(cell[name] for name in kind.names or ()) for cell in cells], kind)

    def tradeoff(self, *, again: bool = False, progress: ProgressLike = None) -> Tradeoff:
        """Speed and accuracy of every build and precision on this mesh; `print` it.

        The server measures once and keeps the result, until `again` or `forget_tradeoff`.
        """
        path = self._path("tradeoff")
        with Reporter(self.client.progress_or(progress), "measure", 1.0) as report:
            answer = None if again else self.client.find("GET", path)
            if answer is None:
                answer = self.client.request("POST", path, {"wait_ms": 0})
            while True:
                result = json.loads(answer.content)
                if result["state"] == "measured":
                    return Tradeoff(result)
                report(float(result["progress"]))
                answer = self.client.request(
                    "GET", path, {"wait_ms": POLL_MS}, work_s=POLL_MS / 1000
                )

    def forget_tradeoff(self) -> None:
        """Stops a measurement and deletes the result."""
        self.client.request("DELETE", self._path("tradeoff"))

    def __repr__(self) -> str:
        if not self.is_ready:
            return f"<kdray.Tree {self.id[:12]}…, {self.description['state']}>"
        return f"<kdray.Tree {self.id[:12]}…: {self.triangles:,} triangles, {self.build}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Tree) and (self.client.url, self.id) == (
            other.client.url,
            other.id,
        )

    def __hash__(self) -> int:
        return hash((self.client.url, self.id))

    def _ready(self) -> Dict[str, Any]:
        """The description of the built tree."""
        return self.description if self.is_ready else self.wait().description
