"""The page of `reproduce`: the paper's claims and what became of them, pictures and tables."""

import base64
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..output.tables import Table
from ..reproduction.page import DIFFERS, REPRODUCED, SHOWN, UNSTATED, Claim, claims
from ..reproduction.run import Reproduction
from .page import Command, manifest, rows_hash, write_page

NEEDED = {"scenario_1", "scenario_2"}  # sections that the claims are about
TYPES = {".png": "image/png", ".gif": "image/gif"}
CODE = str.maketrans("", "", "`")  # marks of Markdown, which HTML has none of


def write_reproduction_page(found: Reproduction, command: Command) -> Path:
    """Write report.html beside the rows of a reproduction; returns its path.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    known = list(claims(found.content)) if found.content.keys() >= NEEDED else []
    content = {
        "title": "The paper's results, measured again",
        "verdict": verdict(known),
        "claims": _plain("Claim by claim", ("claim", "paper", "here", "verdict"), known, 4),
        "pictures": pictures(found.pictures, found.directory),
        "tables": [_plain(table.title, table.columns, table.rows) for table in found.tables],
        "manifest": manifest(command, [rows_hash(found.directory)], "nothing is random"),
    }
    return write_page(found.directory, "reproduction.html", content)


def _plain(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> Table:
    """A table without marks of Markdown."""
    cells = [tuple(cell.translate(CODE) for cell in row) for row in rows]
    return Table(title.translate(CODE), columns, cells, words=words)


def verdict(known: Sequence[Claim]) -> str:
    """Counts of the claims that were reproduced, differ, or are not clear from the text."""
    if not known:
        return "One part of the paper; its claims are told where all parts run: push-recovery reproduce."
    counts = Counter(claim.verdict.split(":")[0] for claim in known)
    return (
        f"Of {len(known)} claims {counts[REPRODUCED]} are reproduced, {counts[DIFFERS]} differ, and "
        f"{counts[UNSTATED]} cannot be told from the text."
    )


def pictures(paths: Sequence[Path], directory: Path) -> list[tuple[str, str]]:
    """Caption and content of each picture that stands for a figure of the paper; folders have variants."""
    by_name = {path.name: path for path in paths if path.parent == directory}
    found = []
    for name, caption in SHOWN:
        if name in by_name:
            content = base64.b64encode(by_name[name].read_bytes()).decode()
            kind = TYPES[by_name[name].suffix]
            found.append((caption.translate(CODE), f"data:{kind};base64,{content}"))
    return found
