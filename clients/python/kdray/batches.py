# SPDX-License-Identifier: Apache-2.0
"""Large batches: cut into blocks that the server accepts, sent in parallel, joined in order."""
from __future__ import annotations

import collections
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import Context, copy_context
from dataclasses import dataclass
from typing import Callable, Deque, Generator, List, Optional, Tuple, TypeVar

from .errors import Problem
from .transport import Answer, Flight

# Rows of a block. Smaller blocks overlap better: one is encoded, sent or joined while the server
# traces another.
BLOCK_ROWS = 1 << 18
SPLIT_CODES = {"too_many_rays", "too_many_hits", "body_too_large"}

Part = TypeVar("Part")
Block = Tuple[int, int, Part]  # first row, row after the last, answer


@dataclass
class BatchInfo:
    """What the server says of a batch besides its results. `info=` of a query fills one."""

    precision: str = ""  # the precision that was used, never auto
    invalid: int = 0  # invalid rows, which are misses
    truncated: int = 0  # rows with more than max_hits hits
    offset: Optional[
        float
    ] = None  # Kdray-Offset, with t_min or t_max auto; the largest of the blocks

    def clear(self) -> None:
        self.precision, self.invalid, self.truncated, self.offset = "", 0, 0, None

    @staticmethod
    def of(answer: Answer) -> "BatchInfo":
        headers = answer.headers
        offset = headers.get("kdray-offset")
        return BatchInfo(
            headers.get("kdray-precision", ""),
            int(headers.get("kdray-invalid", 0)),
            int(headers.get("kdray-truncated", 0)),
            None if offset is None else float(offset),
        )

    def merge(self, block: "BatchInfo") -> None:
        self.precision = block.precision or self.precision
        self.invalid += block.invalid
        self.truncated += block.truncated
        if block.offset is not None:
            self.offset = max(block.offset, self.offset or 0.0)


def blocks(
    count: int, rows: int, parallel: int, ask: Callable[[int, int, Flight], Part]
) -> Generator[Block[Part], None, None]:
    """The answers for rows 0 to count, in order; one answer if there are no rows.

    ask(start, stop, flight) runs in up to `parallel` threads. A block that is refused as too large
    is asked in halves. When the generator is closed early, or an ask fails, the other requests are
    given up.
    """
    flight = Flight()
    rows = max(rows, 1)
    if count <= rows:
        yield from ask_halving(ask, 0, count, flight)
        return
    waiting: Deque["Future[List[Block[Part]]]"] = collections.deque()
    pool = ThreadPoolExecutor(parallel, "kdray-batch")
    try:
        for start in range(0, count, rows):
            if len(waiting) > parallel:  # bounds the answers that wait for their turn
                yield from first_of(waiting)
            waiting.append(
                pool.submit(
                    as_caller, copy_context(), ask, start, min(start + rows, count), flight
                )
            )
        while waiting:
            yield from first_of(waiting)
    except BaseException:
        for future in waiting:
            future.cancel()
        flight.abort()
        raise
    finally:
        pool.shutdown()


def first_of(waiting: Deque["Future[List[Block[Part]]]"]) -> List[Block[Part]]:
    """Takes the first one when it is done. If another fails earlier, its error is raised."""
    while not waiting[0].done():
        pending = [future for future in waiting if not future.done()]
        for future in waiting:
            if future not in pending:
                future.result()
        wait(pending, return_when=FIRST_COMPLETED)
    return waiting.popleft().result()


def as_caller(
    context: Context,
    ask: Callable[[int, int, Flight], Part],
    start: int,
    stop: int,
    flight: Flight,
) -> List[Block[Part]]:
    """ask_halving in the context of the caller, where its tracing looks for the present span."""
    return context.run(lambda: ask_halving(ask, start, stop, flight))


def ask_halving(
    ask: Callable[[int, int, Flight], Part], start: int, stop: int, flight: Flight
) -> List[Block[Part]]:
    try:
        return [(start, stop, ask(start, stop, flight))]
    except Problem as problem:
        if problem.status != 413 or problem.code not in SPLIT_CODES or stop - start < 2:
            raise
    middle = (start + stop) // 2
    return ask_halving(ask, start, middle, flight) + ask_halving(ask, middle, stop, flight)


def block_rows(count: int, parallel: int, most: int) -> int:
    """Rows of a block for count rows: equal blocks, at most `most` and about BLOCK_ROWS."""
    rows = max(1, min(BLOCK_ROWS, most))
    number = -(-count // rows) or 1
    return max(1, -(-count // number))
