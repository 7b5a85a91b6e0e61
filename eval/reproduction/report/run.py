"""From sections by name to rows, numbers, tables and pictures in one directory."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ....controllers.errors import InvalidValueError
from ....controllers.files import read_file, write_text
from ....controllers.json_text import parse_json
from ...output.place import require_place
from ...output.rows import default_directory
from ..jobs import Job, Rows, config, open_store, run_jobs
from ..sections import ablations, limits, scenario_1, scenario_2
from ..tables import Table, markdown
from .page import write_page

RESULT = "reproduction.json"
TABLES = "tables.md"
SECTION_NAMES = ("scenario-1", "scenario-2", "ablations", "limits")
ALL = "all"


class Section(Protocol):
    """A module of this package that reproduces one part of the paper."""

    NAME: str

    def jobs(self, directions: int) -> Sequence[Job]:
        """What has to be computed."""
        ...

    def summary(self, rows: Rows, directions: int) -> dict[str, Any]:
        """Its part of the result object."""
        ...

    def tables(self, content: dict[str, Any]) -> list[Table]:
        """That part for people."""
        ...

    def draw(self, content: dict[str, Any], directory: Path) -> list[Path]:
        """Its pictures."""
        ...


SECTIONS: tuple[Any, ...] = (scenario_1, scenario_2, ablations, limits)  # modules, each a Section


@dataclass(frozen=True)
class Reproduction:
    """What one run of the command found."""

    content: dict[str, Any]  # of the sections that ran
    tables: list[Table]
    pictures: list[Path]
    directory: Path


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
        section: one of SECTION_NAMES, or `all`.
        directions: of scenario 2, counter-clockwise from forward.
        workers: processes; changes no result.
        directory: for rows, reproduction.json, tables.md and pictures; by default one under runs/ named after
            the code.
        overwrite: start over where the directory holds rows.
        page: where to write the page that holds the paper's claims against the run; needs all sections.

    Raises:
        PushRecoveryError: an unknown section, a page of some sections only, a directory of other code, or one
            to which another run is writing.
    """
    chosen = _chosen(section, page)
    if page is not None:
        require_place(page)
    directory = directory or default_directory("reproduce", config())
    with open_store(directory, overwrite) as store:  # to the end: the result is read and written again
        if overwrite:
            (directory / RESULT).unlink(missing_ok=True)
        rows = run_jobs([job for module in chosen for job in module.jobs(directions)], store, workers)
        return _written(chosen, rows, directions, directory, page)


def _written(
    chosen: Sequence[Any], rows: Rows, directions: int, directory: Path, page: Path | None
) -> Reproduction:
    """Numbers, tables, pictures and page of the chosen sections, in the directory."""
    content = {name: part for module in chosen for name, part in module.summary(rows, directions).items()}
    together = _merged(directory, content)
    write_text(directory / RESULT, json.dumps(together, indent=1, allow_nan=False) + "\n")
    known = [module for module in SECTIONS if module.NAME.replace("-", "_") in together]
    every = {module.NAME: module.tables(together) for module in known}
    texts = [markdown(table) for section in every.values() for table in section]
    write_text(directory / TABLES, "\n".join(texts))
    tables = [table for module in chosen for table in module.tables(content)]
    pictures = [path for module in chosen for path in module.draw(content, directory)]
    if page is not None:
        pictures += write_page(content, every, directory, page)
    return Reproduction(content, tables, pictures, directory)


def _chosen(section: str, page: Path | None) -> list[Any]:
    """The sections of that name."""
    chosen = [module for module in SECTIONS if section in (ALL, module.NAME)]
    if not chosen:
        raise InvalidValueError(f"section must be one of {ALL}, {', '.join(SECTION_NAMES)}, got {section!r}")
    if page is not None and section != ALL:
        raise InvalidValueError(f"a page needs all sections, got {section!r}: leave the section out")
    return chosen


def _merged(directory: Path, content: dict[str, Any]) -> dict[str, Any]:
    """The sections of this run over those that earlier runs left in the directory."""
    path = directory / RESULT
    try:
        before = parse_json(RESULT, read_file(path)) if path.exists() else {}
    except InvalidValueError:
        before = None  # it can be made again from the rows
    return {**(before if isinstance(before, dict) else {}), **content}
