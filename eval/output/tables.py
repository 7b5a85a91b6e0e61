"""Tables of results, the same cells on a terminal, in Markdown and on a page; pictures beside them."""

import hashlib
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich import table
from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape

from ...controllers.files import write_atomically, write_text
from .rows import read_json


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
        """Print title and cells on standard output, 160 columns wide where that is no terminal.

        Columns that do not fit beside each other follow below, behind the first one again.
        """
        console = Console()
        if not console.is_terminal:
            console = Console(width=160)
        widths, last = self._widths(), len(self.columns) - 1
        whole = [max(map(cell_len, column)) for column in zip(self.columns, *self.rows, strict=True)]
        fits = len(_side_by_side(whole, console.width)) == 1
        for number, part in enumerate(_side_by_side(widths, console.width)):
            title = escape(self.title) if number == 0 else None  # brackets are units, no markup
            shown = table.Table(title=title, title_justify="left")
            for index in part:
                width = None if fits or index == last else widths[index]
                shown.add_column(escape(self.columns[index]), overflow="fold", width=width)
            for row in self.rows:
                shown.add_row(*(escape(row[index]) for index in part))
            console.print(shown)

    def _widths(self) -> list[int]:
        """Characters that the columns need: headings and cells of the last column may be broken at spaces."""
        last = len(self.columns) - 1
        words = [heading.split() for heading in self.columns]
        for index, found in enumerate(words):
            cells = [row[index] for row in self.rows]
            found += [word for cell in cells for word in cell.split()] if index == last else cells
        return [max(map(cell_len, found), default=1) for found in words]


PADDING = 3  # of a column, its line included


def _side_by_side(widths: Sequence[int], most: int) -> list[list[int]]:
    """Columns of the tables that are as wide as `most` allows; each of them begins with the first column."""
    parts, used = [[0]], 1 + widths[0] + PADDING
    for index, width in enumerate(widths[1:], start=1):
        if used + width + PADDING > most and len(parts[-1]) > 1:
            parts.append([0])
            used = 1 + widths[0] + PADDING
        parts[-1].append(index)
        used += width + PADDING
    return parts


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells under columns in Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def markdown_page(title: str, tables: Iterable[Table]) -> str:
    """All tables that have rows, under a title."""
    return "\n".join([f"# {title}\n", *(one.markdown() for one in tables if one)])


LONGEST_STEM = 80
ASKED = "asked"  # entry of report.json: what a question is about besides policies


def file_stem(text: str) -> str:
    """The text as the name of a file without its ending."""
    return re.sub(r"[^\w+.-]+", "-", text).strip("-.")


def stem_or_hash(words: Sequence[str], whole: str) -> str:
    """A file's name from words, or a hash of the whole question where they are none or too long for one."""
    stem = file_stem("-".join(words))
    return stem if 0 < len(stem) <= LONGEST_STEM else hashlib.sha256(whole.encode()).hexdigest()[:8]


def named_apart(directory: Path, policies: Iterable[str], more: Sequence[str] = ()) -> str:
    """What names of files about these policies end on, so that nothing is lost: "", or "-A-B".

    The first question that is asked in a directory has report.json, and another one report-A-B.json.

    Args:
        directory: of the reports.
        policies: that the question is about.
        more: what else may differ from one question to the next there, in words.
    """
    path, asked = directory / "report.json", [*policies, *more]
    if not path.is_file():
        return ""
    first = read_json(path)
    if isinstance(first, dict) and [*first.get("policies", ()), *first.get(ASKED, ())] == asked:
        return ""
    return f"-{stem_or_hash(asked, ' '.join(asked))}"


def write_reports(
    directory: Path, content: Mapping[str, Any], markdown: str, more: Sequence[str] = ()
) -> Path:
    """Write report.json, with an entry "policies", and report.md; returns the path of the latter.

    Where they answer another question, the names have what `named_apart` says after "report".
    """
    stem = f"report{named_apart(directory, content['policies'], more)}"
    whole = {**content, ASKED: list(more)} if more else content
    write_text(directory / f"{stem}.json", json.dumps(whole, indent=1) + "\n")
    path = directory / f"{stem}.md"
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
