# SPDX-License-Identifier: Apache-2.0
"""Progress of uploads, builds, batches and measurements, as calls of a function or as bars."""
from __future__ import annotations

import importlib
import sys
import time
from dataclasses import dataclass
from typing import Any, Callable, Optional, Union

__all__ = ["Progress", "ProgressLike"]


@dataclass(frozen=True)
class Progress:
    """One report: `done` of `total`, which never decreases within a stage.

    stage is "upload" (bytes), "build" (0 to 1), "rays", "points", "pairs" (rows that are answered)
    or "measure" (0 to 1). done == total ends it.
    """

    stage: str
    done: float
    total: float


# True shows bars, a function gets every report, None and False do nothing.
ProgressLike = Union[None, bool, Callable[[Progress], None]]


class Reporter:
    """Hands the reports of one stage to what the caller gave. A context manager: ends its bar."""

    def __init__(self, progress: ProgressLike, stage: str, total: float) -> None:
        self._stage, self._total = stage, total
        self._last = -1.0
        self._bar: Optional[_Bar] = _Bar(stage, total) if progress is True else None
        self._function = progress if callable(progress) else None

    def __call__(self, done: float) -> None:
        if done <= self._last:  # a request that is repeated sends again
            return
        self._last = done
        if self._function is not None:
            self._function(Progress(self._stage, done, self._total))
        elif self._bar is not None:
            self._bar.show(done)

    def __enter__(self) -> "Reporter":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None and self._last < self._total:
            self(self._total)
        if self._bar is not None:
            self._bar.close()


class _Bar:
    """A bar of tqdm if it is installed, else a line of text; shown only for waits that last."""

    FIRST_S, EVERY_S = 0.3, 0.2

    def __init__(self, stage: str, total: float) -> None:
        self._stage, self._total = stage, total
        self._next = time.monotonic() + self.FIRST_S
        self._tqdm: Any = None
        self._is_shown = False
        try:
            self._make: Any = importlib.import_module("tqdm.auto").tqdm
        except ImportError:
            self._make = None

    def show(self, done: float) -> None:
        now = time.monotonic()
        if now < self._next and not (done >= self._total and self._is_shown):
            return
        self._next = now + self.EVERY_S
        self._is_shown = True
        if self._make is not None:
            if self._tqdm is None:
                unit = {"upload": "B", "build": "", "measure": ""}.get(
                    self._stage, " " + self._stage
                )
                self._tqdm = self._make(
                    total=self._total, unit=unit, unit_scale=True, desc=self._stage
                )
            self._tqdm.update(done - self._tqdm.n)
        else:
            share = done / self._total if self._total else 1.0
            print(f"\r{self._stage} {share:4.0%}", end="", file=sys.stderr, flush=True)

    def close(self) -> None:
        if self._tqdm is not None:
            self._tqdm.close()
        elif self._is_shown:
            print(file=sys.stderr)
