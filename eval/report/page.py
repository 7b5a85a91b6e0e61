"""A page from a template: style and script inside it, nothing that is asked for elsewhere."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ...controllers.errors import MissingExtraError
from ...controllers.files import write_text
from ..output.provenance import machine_kind, source_commit, versions
from ..rollout.environments import code_digest
from .replay import Command

PAGE = "report.html"
TEMPLATES = Path(__file__).parent / "templates"


def require_report() -> None:
    """Raise MissingExtraError where jinja2 is not installed."""
    if find_spec("jinja2") is None:
        raise MissingExtraError("jinja2", "report")


def write_page(directory: Path, template: str, content: Mapping[str, Any]) -> Path:
    """Write report.html from a template; returns its path.

    Args:
        directory: where the page goes.
        template: file of `templates`; every text of `content` is escaped but for the figures of `figure`.
        content: what the template shows.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    require_report()
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    env = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    env.filters["figure"] = Markup  # of to_svg, which escapes what it is told
    path = directory / PAGE
    write_text(path, env.get_template(template).render(content))
    return path


def rows_hash(directory: Path) -> str:
    """Of the rows in a directory of results."""
    rows = (directory / "outcomes.jsonl").read_bytes()
    return f"sha256 {hashlib.sha256(rows).hexdigest()}"


def code_hash() -> tuple[str, str]:
    """Of the code that all rows come from, as a line of the manifest."""
    return "code of controllers and envs", f"sha256 {code_digest()}"


def manifest(command: Command, hashes: Sequence[tuple[str, str]], seeds: str) -> list[tuple[str, str]]:
    """What a page is made from and by: names and values.

    Args:
        command: that wrote it.
        hashes: of what the numbers come from, by name.
        seeds: what stands for the random part of the pushes.
    """
    return [
        ("command", command.text),
        *hashes,
        ("seeds", seeds),
        ("versions", ", ".join(f"{name} {number}" for name, number in versions().items())),
        ("git commit", source_commit() or "none: installed from a package"),
        ("machine", machine_kind()),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
    ]
