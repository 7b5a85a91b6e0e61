"""The page that holds the paper's claims against this run: docs/reproduction.md."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ....controllers.files import write_text
from ...output.tables import markdown_table
from ..tables import Table, markdown
from .claims import claims

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

F. Nazemi, A. Yousefi-Koma, F. A. Shirazi, M. Khadiv, "A Reactive and Efficient Walking Pattern Generator
for Robust Bipedal Locomotion", on `PushRecovery/Pendulum-v0`. **This page is written by a command**; every
number that is not in a column "paper" was measured by its run, and a second run gives the same ones bit for
bit:

    push-recovery reproduce --page docs/reproduction.md

It also writes every number as JSON, all tables and the figures as SVG and PNG into its output directory.
Largest forces are those before the first failure, to 1 N (ablations: 5 N); psi counts counter-clockwise
from forward, the stance foot is the left one, so psi 90 is inward. F\\* is the [closed-form
limit](limits.md) of single support; no controller can do better that stops its trunk before its limit.
"""
GAP = """## Where the last percent go

What `two-stage` has beyond the paper's two stages, taken away one at a time; shares of F\\* over all
directions. F\\* knows a push from its onset, a controller only as the DCM moves.

- *The push estimate*: the push of the last period, found from the motion of DCM and CMP, is expected to
  last another 0.1 s. For a velocity jump, where knowing early is worth nothing, it makes no difference.
- *The trunk's debt*: a trunk that swings has to be stopped, which moves the DCM back. Stage 1 decides on
  the DCM less that debt, and stage 2 counts its braking tail in the DCM at touchdown. Without it the two
  stages contradict each other: the DCM looks recovered, stage 1 returns to slow steps, and then the braking
  trunk spends what was gained.
- What is left is the reaction time of one control period; see *control period* in the ablations, where 2 ms
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
