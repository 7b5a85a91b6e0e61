"""Tables of the reproduction: text cells under columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..output.tables import markdown_table


class Table(NamedTuple):
    """Text cells under columns."""

    title: str
    columns: Sequence[str]
    cells: Sequence[Sequence[str]]


def markdown(table: Table) -> str:
    """The table in Markdown under its title."""
    return f"**{table.title}**\n\n{markdown_table(table.columns, table.cells)}"
