"""From sections by name to rows, numbers, tables, pictures and a page in one directory.

The page that holds the paper's claims against this run: docs/generated/reproduction.md.

From sections by name to rows, numbers, tables and pictures in one directory.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from ...controllers.errors import InvalidValueError
from ...controllers.files import read_file, write_text
from ...controllers.validation import parse_json
from ..output.rows import default_directory, require_place
from ..output.tables import markdown_table
from . import ablations, limits, scenario_1, scenario_2
from .claims import claims
from .jobs import Job, Rows, Table, config, markdown, open_store, run_jobs

Tables = Mapping[str, Sequence[Table]]  # by name of the section

PICTURES = "pictures"  # folder beside the page
SHOWN = (
    ("fig3_paths.png", "Top view of cases (a) and (b): soles, CoP, CoM and DCM (the paper's Fig. 3)"),
    ("fig4_histories.png", "Lateral DCM, CoM, feet, trunk angle and torque over time (Fig. 4)"),
    ("fig5_cartoon.png", "The motion from behind at some instants (Fig. 5)"),
    ("fig5_motion.gif", "The same as a film at half speed"),
    ("fig7_limits.png", "Largest push by direction, every arm and the closed-form limits (Fig. 7)"),
    ("fig7_variants.png", "What belongs to `two-stage` taken away"),
    ("fig7_jump.png", "Largest velocity jump by direction"),
)
HEAD = """# The paper's results, measured again

The paper is F. Nazemi, A. Yousefi-Koma, F. A. Shirazi, M. Khadiv, "A Reactive and Efficient Walking
Pattern Generator for Robust Bipedal Locomotion". This page holds each of its claims against what was
measured here on `PushRecovery/Pendulum-v0`. **A command writes this page**:

    push-recovery reproduce --page docs/generated/reproduction.md

Every number outside the column "paper" was measured by that run, and a second run gives the same numbers
bit for bit. The command also writes every number as JSON, all tables, and the figures as SVG and PNG into
its output directory.

How to read the numbers:

- A largest force is the largest one before the first failure, to 1 N (in the ablations to 5 N).
- The direction psi counts counter-clockwise from forward. The left foot is the stance foot, so psi 90 is
  inward.
- F\\* is the [closed-form limit](../limits.md) of single support. A controller that stops its trunk before
  the trunk's limit cannot do better.
"""
GAP = """## Where the last percent go

`two-stage` has more than the paper's two stages. The table takes that away, one part at a time, and gives
shares of F\\* over all directions. F\\* knows a push from its onset, but a controller knows it only as
the DCM moves.

- *The push estimate*: the push of the last period is found from the motion of DCM and CMP, and is
  expected to last another 0.1 s. It makes no difference for a velocity jump, where knowing early is worth
  nothing.
- *The trunk's debt*: a trunk that swings has to be stopped, and stopping it moves the DCM back. So stage
  1 decides on the DCM less that debt, and stage 2 counts its braking tail in the DCM at touchdown.
  Without this the two stages contradict each other: the DCM looks recovered, stage 1 returns to slow
  steps, and then the braking trunk spends what was gained.
- What is left is the reaction time of one control period. The ablation *control period* shows that 2 ms
  close the gap.
"""


def write_page(content: dict[str, Any], tables: Tables, directory: Path, path: Path) -> list[Path]:
    """Write the page and copy its pictures beside it; returns what was written.

    Args:
        content: result object of all sections.
        tables: by name of the section.
        directory: where the pictures lie.
        path: of the page.
    """
    pictures = path.parent / PICTURES
    pictures.mkdir(parents=True, exist_ok=True)
    written = []
    for name, _ in SHOWN:
        written.append(Path(shutil.copyfile(directory / name, pictures / name)))
    write_text(path, page(content, tables))
    return [path, *written]


def page(content: dict[str, Any], tables: Tables) -> str:
    """The page as Markdown."""
    rows = [tuple(cell.replace("|", "\\|") for cell in claim) for claim in claims(content)]
    parts = [HEAD, markdown_table(("claim", "paper", "ours", "verdict"), rows)]
    parts += [f"![{text}]({PICTURES}/{name})\n" for name, text in SHOWN[:4]]
    text = {name: [markdown(table) for table in section] for name, section in tables.items()}
    parts += ["## Scenario 1\n", *text["scenario-1"]]
    parts += ["## Scenario 2\n", *(f"![{about}]({PICTURES}/{name})\n" for name, about in SHOWN[4:])]
    parts += [*text["scenario-2"], GAP, _worth(content)]
    parts += ["## Ablations\n", *text["ablations"], "## Limits\n", *text["limits"]]
    return "\n".join(parts)


def _worth(content: dict[str, Any]) -> str:
    pushed, jumped = content["scenario_2_overview"], content["jump_overview"]
    rows = [
        (arm, *(f"{entry[arm][field]:.3f}" if arm in entry else "-"
                for entry in (pushed, jumped) for field in ("fraction_mean", "fraction_worst")))
        for arm in pushed
        if arm.startswith("two-stage")
    ]  # fmt: skip
    return markdown_table(("arm", "push, mean", "worst", "velocity jump, mean", "worst"), rows)


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
