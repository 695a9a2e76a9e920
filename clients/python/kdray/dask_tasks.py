# SPDX-License-Identifier: Apache-2.0
"""The tasks of `kdray.dask`: what a worker does with one, and which server it asks."""
from __future__ import annotations

import threading
import time
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Dict, Optional, Tuple

import numpy as np

from .batches import BatchInfo
from .client import Client
from .errors import ConnectionFailed, Problem
from .npy import Array
from .tree import Tree

STALL_S = 20.0
AVOID_S = 5.0  # for which a server that failed is asked last


@dataclass(frozen=True)
class Access:
    """How a worker reaches the servers."""

    urls: Tuple[str, ...]
    token: Optional[str] = field(repr=False)  # Dask logs the arguments of tasks that fail
    patience_s: float
    traceparent: Optional[str] = None


@dataclass(frozen=True)
class Slice:
    """Rows of a `.npy` file, counted through its leading shape."""

    path: str
    start: int
    stop: int

    def read(self) -> Array:
        array = np.load(self.path, mmap_mode="r")
        return np.array(array.reshape(-1, array.shape[-1])[self.start : self.stop])


@dataclass(frozen=True)
class Task:
    """A method of `kdray.Tree`, its options, and its rows if it is a query.

    Consecutive numbers begin at different servers.
    """

    tree: str
    method: str
    options: Dict[str, Any]
    number: int
    rows: Optional[Array] = field(default=None, repr=False)
    source: Optional[Slice] = None  # of the rows, instead of `rows`


_lock = threading.Lock()
_clients: Dict[Tuple[str, Optional[str]], Client] = {}
_avoided: Dict[str, float] = {}  # until when
_trace: ContextVar[Optional[str]] = ContextVar("kdray_trace", default=None)


def client_of(url: str, token: Optional[str]) -> Client:
    """One for each server and process, so connections are kept. It repeats nothing by itself."""
    with _lock:
        key = (url, token)
        if key not in _clients:
            _clients[key] = Client(
                url,
                token=token or "",
                parallel=1,
                retry_s=0,
                stall_s=STALL_S,
                traceparent=_trace.get,
            )
        return _clients[key]


def perform(access: Access, task: Task) -> Any:
    """The result of a task, from the first server that gives it."""
    _trace.set(access.traceparent)
    rows = task.rows if task.source is None else task.source.read()
    start = task.number % len(access.urls)
    give_up = time.monotonic() + access.patience_s
    pause_s = 0.1
    while True:
        now = time.monotonic()
        order = [access.urls[(start + i) % len(access.urls)] for i in range(len(access.urls))]
        order.sort(key=lambda url: _avoided.get(url, 0.0) > now)
        lacking = 0
        failure: Optional[Exception] = None
        for url in order:
            try:
                return ask(
                    Tree(client_of(url, access.token), {"id": task.tree, "state": "ready"}),
                    task,
                    rows,
                )
            except ConnectionFailed as error:
                _avoided[url] = time.monotonic() + AVOID_S
                failure = error
            except Problem as problem:
                if problem.code == "tree_not_found":
                    lacking += 1
                elif problem.status not in (409, 429, 502, 503):
                    raise
                failure = problem
        if failure is not None and (lacking == len(order) or time.monotonic() + pause_s > give_up):
            raise failure
        time.sleep(pause_s)
        pause_s = min(2 * pause_s, 5.0)


def ask(tree: Tree, task: Task, rows: Optional[Array]) -> Any:
    if rows is not None:
        info = BatchInfo()
        return getattr(tree, task.method)(rows, info=info, **task.options), info
    if task.method == "render":
        picture = tree.render(**task.options)
        return picture.array(), picture.depth_range
    return tree.render_array(**task.options)
