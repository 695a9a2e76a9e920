# SPDX-License-Identifier: Apache-2.0
"""The measured speed and accuracy of every build and precision on a mesh, as a table."""
from __future__ import annotations

import html
from typing import Any, Dict, List, Mapping, Optional

__all__ = ["Tradeoff"]

HEAD = ("build", "precision", "build s", "MiB", "random M/s", "aimed M/s", "leaks", "t error")


class Tradeoff:
    """`data` is the contract's Tradeoff, `rows` its results. print() shows a table."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.data: Dict[str, Any] = dict(data)

    @property
    def rows(self) -> List[Dict[str, Any]]:
        """A dict for each build and precision."""
        return list(self.data["results"])

    def row(self, build: str, precision: str) -> Dict[str, Any]:
        """The row of a build and precision."""
        for row in self.rows:
            if (row["build"], row["precision"]) == (build, precision):
                return row
        raise KeyError(f"no row of {build}, {precision}")

    def __str__(self) -> str:
        table = [list(HEAD)] + self._cells()
        widths = [max(len(line[i]) for line in table) for i in range(len(HEAD))]
        lines = [
            "  ".join(
                cell.ljust(width) if i < 2 else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(line, widths))
            ).rstrip()
            for line in table
        ]
        return "\n".join(lines + [self._conditions()])

    def _repr_html_(self) -> str:
        def line(cells: List[str], tag: str) -> str:
            return (
                "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"
            )

        return (
            "<table>"
            + line(list(HEAD), "th")
            + "".join(line(cells, "td") for cells in self._cells())
            + f"</table><p>{html.escape(self._conditions())}</p>"
        )

    def _cells(self) -> List[List[str]]:
        return [
            [
                row["build"],
                row["precision"],
                f"{row['build_ms'] / 1e3:.3f}",
                f"{row['bytes'] / 2 ** 20:.1f}",
                f"{row['random']['rays_per_s'] / 1e6:.2f}",
                f"{row['aimed']['rays_per_s'] / 1e6:.2f}",
                share(row["leaks"]),
                f"{row['t_error']['p999']:.1e}",
            ]
            for row in self.rows
        ]

    def _conditions(self) -> str:
        mesh, conditions = self.data["mesh"], self.data["conditions"]
        return (
            f"{mesh['triangles']:,} triangles, {'closed' if mesh['closed'] else 'open'}; "
            f"{conditions['threads']} threads, "
            f"{conditions['disturbed_runs']} of {conditions['runs']} runs disturbed; "
            "t error: 999 of 1000 aimed rays have at most this"
        )


def share(errors: Optional[Mapping[str, Any]]) -> str:
    """A rate; of no event the bound at 95% confidence; "-" where it is not defined."""
    if errors is None:
        return "-"
    return f"< {errors['below']:.1e}" if errors["count"] == 0 else f"{errors['rate']:.1e}"
