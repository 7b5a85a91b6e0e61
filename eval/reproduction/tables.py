"""Tables of the reproduction, for terminal and Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.markup import escape

from ..tables import markdown_table, print_table


class Table(NamedTuple):
    """Text cells under columns."""

    title: str
    columns: Sequence[str]
    cells: Sequence[Sequence[str]]


def show(table: Table) -> None:
    """Print on standard output; brackets are units here, no markup."""
    cells = [tuple(escape(cell) for cell in row) for row in table.cells]
    print_table(escape(table.title), [escape(column) for column in table.columns], cells)


def markdown(table: Table) -> str:
    """The table in Markdown under its title."""
    return f"**{table.title}**\n\n{markdown_table(table.columns, table.cells)}"
