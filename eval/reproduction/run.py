"""`push-recovery reproduce`: sections by name to rows, numbers, tables, pictures and pages."""

import base64
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file, write_text
from ...controllers.validation import parse_json
from ..output.rows import default_directory, require_place
from ..output.tables import Table
from ..report.page import Command, manifest, rows_hash
from ..report.page import write_page as write_report
from .jobs import Rows, Section, config, open_store, run_jobs
from .page import DIFFERS, REPRODUCED, SHOWN, UNSTATED, Claim, claims, table_text, write_page
from .scenarios import SCENARIO_1, SCENARIO_2
from .studies import ABLATIONS, LIMITS_STUDY

RESULT = "reproduction.json"
TABLES = "tables.md"
SECTIONS = (SCENARIO_1, SCENARIO_2, ABLATIONS, LIMITS_STUDY)
NEEDED = {"scenario_1", "scenario_2"}  # sections that the claims are about
ALL = "all"


@dataclass(frozen=True)
class Reproduction:
    """Result of one run of the command."""

    content: dict[str, Any]  # of the sections that ran
    known: dict[str, Any]  # of those, and of the ones that ran in the directory before
    tables: list[Table]  # of the sections that ran
    pictures: list[Path]
    directory: Path

    @cached_property
    def claims(self) -> list[Claim]:
        """The paper's claims held against the numbers; none where a section that they need has not run."""
        return list(claims(self.known)) if self.known.keys() >= NEEDED else []

    @property
    def sections(self) -> list[Section]:
        """Those that are known."""
        return [one for one in SECTIONS if one.name.replace("-", "_") in self.known]


def reproduce(
    section: str = ALL,
    directions: int = 36,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
    page: Path | None = None,
) -> Reproduction:
    """Run sections; what the directory already holds is not computed again.

    Args:
        section: the name of one of SECTIONS, or `all`.
        directions: of scenario 2, counter-clockwise from forward.
        workers: processes; changes no result.
        directory: for rows, numbers, tables and pictures; by default one under runs/ named after the code.
        overwrite: start over where the directory holds rows.
        page: where to write the page that holds the paper's claims against the run; needs all sections.

    Raises:
        PushRecoveryError: an unknown section, a page of some sections only, or a directory that is in use or
            of other code.
    """
    chosen = [one for one in SECTIONS if section in (ALL, one.name)]
    if not chosen:
        names = ", ".join(one.name for one in SECTIONS)
        raise InvalidValueError(f"section must be one of {ALL}, {names}, got {section!r}")
    if page is not None and section != ALL:
        raise InvalidValueError(f"a page needs all sections, got {section!r}: leave the section out")
    if page is not None:
        require_place(page)
    directory = directory or default_directory("reproduce", config())
    with open_store(directory, overwrite) as store:  # to the end: the result is read and written again
        if overwrite:
            for name in (RESULT, *(name for name, _ in SHOWN)):
                (directory / name).unlink(missing_ok=True)
        rows = run_jobs([job for one in chosen for job in one.jobs(directions)], store, workers)
        return _written(chosen, rows, directions, directory, page)


def _written(
    chosen: Sequence[Section], rows: Rows, directions: int, directory: Path, page: Path | None
) -> Reproduction:
    """Numbers, tables, pictures and page of the chosen sections, in the directory."""
    content = {name: part for one in chosen for name, part in one.summary(rows, directions).items()}
    together = {**_earlier(directory), **content}
    write_text(directory / RESULT, json.dumps(together, indent=1, allow_nan=False) + "\n")
    tables = [table for one in chosen for table in one.tables(content)]
    pictures = [path for one in chosen for path in one.draw(content, directory)]
    found = Reproduction(content, together, tables, pictures, directory)
    every = {one.name: one.tables(together) for one in found.sections}
    write_text(directory / TABLES, "\n".join(table_text(table) for part in every.values() for table in part))
    if page is not None:
        pictures += write_page(content, every, directory, page)
    return found


def _earlier(directory: Path) -> dict[str, Any]:
    """The sections that earlier runs left in the directory."""
    path = directory / RESULT
    try:
        found = parse_json(RESULT, read_file(path)) if path.exists() else {}
    except InvalidValueError:
        return {}  # it can be made again from the rows
    return found if isinstance(found, dict) else {}


TYPES = {".png": "image/png", ".gif": "image/gif"}
CODE = str.maketrans("", "", "`")  # marks of Markdown, which HTML has none of


def write_reproduction_page(found: Reproduction, command: Command) -> Path:
    """Write report.html beside the rows of a reproduction, of all sections that are known; returns its path.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    if found.known.keys() > found.content.keys():
        command = replace(command, words=command.words[:1])  # which runs every section
    tables = [table for one in found.sections for table in one.tables(found.known)]
    content = {
        "title": "The paper's results, measured again",
        "verdict": verdict(found.claims),
        "claims": _plain("Claim by claim", ("claim", "paper", "here", "verdict"), found.claims, 4),
        "pictures": pictures(found.directory),
        "tables": [_plain(table.title, table.columns, table.rows) for table in tables],
        "manifest": manifest(command, [rows_hash(found.directory)], "nothing is random"),
    }
    return write_report(found.directory, "reproduction.html", content)


def claims_table(known: Sequence[Claim]) -> Table:
    """Every claim behind its verdict, whose reasons the page has; false where there are none."""
    rows = [(claim.verdict.partition(":")[0], claim.claim) for claim in known]
    return _plain("The paper's claims", ("verdict", "claim"), rows, 2)


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


def pictures(directory: Path) -> list[tuple[str, str]]:
    """Caption and content of each picture there that stands for a figure of the paper."""
    found = []
    for name, caption in SHOWN:
        path = directory / name
        if path.is_file():
            content = base64.b64encode(path.read_bytes()).decode()
            kind = TYPES[path.suffix]
            found.append((caption.translate(CODE), f"data:{kind};base64,{content}"))
    return found
