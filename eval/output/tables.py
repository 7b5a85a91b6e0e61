"""Tables of results, the same cells on a terminal, in Markdown and on a page; pictures beside them."""

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich import table
from rich.console import Console
from rich.markup import escape

from ...controllers.files import write_atomically, write_text


@dataclass(frozen=True)
class Table:
    """Text cells under columns; false where it has no rows. Pages render it by `templates/table.html`."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""  # how to read it
    words: int = 1  # columns at the left that hold words, not numbers

    def __bool__(self) -> bool:
        return bool(self.rows)

    def markdown(self) -> str:
        """The table in Markdown, title and note included."""
        note = f"\n{self.note}\n" if self.note else ""
        return f"## {self.title}\n\n{markdown_table(self.columns, self.rows)}{note}"

    def print(self) -> None:
        """Print title and cells on standard output, 160 columns wide where that is no terminal."""
        shown = table.Table(title=escape(self.title), title_justify="left")  # brackets are units, no markup
        for index, column in enumerate(self.columns):
            at_an_end = index in {0, len(self.columns) - 1}
            shown.add_column(escape(column), overflow="fold" if at_an_end else "ellipsis")
        for row in self.rows:
            shown.add_row(*map(escape, row))
        console = Console()
        (console if console.is_terminal else Console(width=160)).print(shown)


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells under columns in Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def markdown_page(title: str, tables: Iterable[Table]) -> str:
    """All tables that have rows, under a title."""
    return "\n".join([f"# {title}\n", *(one.markdown() for one in tables if one)])


def write_reports(directory: Path, content: Mapping[str, Any], markdown: str) -> Path:
    """Write report.json and report.md into a directory; returns the path of the latter."""
    write_text(directory / "report.json", json.dumps(content, indent=1) + "\n")
    path = directory / "report.md"
    write_text(path, markdown)
    return path


def write_pictures(figure: Any, directory: Path, stem: str) -> list[Path]:
    """Write stem.png and stem.svg of a figure; the same figure gives the same bytes."""
    paths = [directory / f"{stem}.{kind}" for kind in ("png", "svg")]
    for path in paths:
        buffer, kind = io.BytesIO(), path.suffix[1:]
        figure.savefig(buffer, format=kind, dpi=130, metadata={"Date": None} if kind == "svg" else None)
        write_atomically(path, buffer.getvalue())
    return paths
