# SPDX-License-Identifier: Apache-2.0
"""What may go wrong: `Problem` is a server's answer, `ConnectionFailed` the lack of one."""
from __future__ import annotations

import json
from typing import Any, Mapping, Optional

__all__ = ["ConnectionFailed", "Error", "Problem"]


class Error(Exception):
    """Base of this package's own errors. Wrong arguments raise ValueError or TypeError."""


class ConnectionFailed(Error, ConnectionError):
    """No connection, or it broke, or the server fell silent."""


class Problem(Error):
    """The server refused a request, and says why (`application/problem+json`, RFC 9457).

    code, detail and the rest are the contract's; a code that is not known is to be treated by its
    status. An answer of something between client and server has the code "unknown".
    """

    def __init__(self, status: int, fields: Mapping[str, Any]) -> None:
        self.status = status
        self.code: str = str(fields.get("code", "unknown"))
        self.title: str = str(fields.get("title", ""))
        self.detail: str = str(fields.get("detail", ""))
        self.parameter: Optional[str] = fields.get("parameter")
        self.limit: Optional[float] = fields.get("limit")
        self.actual: Optional[float] = fields.get("actual")
        self.line: Optional[int] = fields.get("line")
        self.request_id: Optional[str] = fields.get("request_id")
        self.fields = dict(fields)
        super().__init__(str(self))

    def __str__(self) -> str:
        where = [f"HTTP {self.status}"]
        if self.parameter:
            where.append(f"parameter {self.parameter}")
        if self.line is not None:
            where.append(f"line {self.line}")
        if self.request_id:
            where.append(f"request {self.request_id}")
        return f"{self.code}: {self.detail or self.title} ({', '.join(where)})"

    def __reduce__(self) -> Any:
        return Problem, (self.status, self.fields)

    @staticmethod
    def of_answer(status: int, content: bytes) -> "Problem":
        """The problem in an answer; of another server's page, its first 200 characters."""
        try:
            fields = json.loads(content)
        except ValueError:
            fields = None
        if not isinstance(fields, dict):
            text = " ".join(content[:200].decode("utf-8", "replace").split())
            fields = {"detail": text or "an answer without a reason"}
        return Problem(status, fields)
