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

The paper is F. Nazemi, A. Yousefi-Koma, F. A. Shirazi, M. Khadiv, "A Reactive and Efficient Walking
Pattern Generator for Robust Bipedal Locomotion". This page holds each of its claims against what was
measured here on `PushRecovery/Pendulum-v0`. **A command writes this page**:

    push-recovery reproduce --page docs/reproduction.md

Every number outside the column "paper" was measured by that run, and a second run gives the same numbers
bit for bit. The command also writes every number as JSON, all tables, and the figures as SVG and PNG into
its output directory.

How to read the numbers:

- A largest force is the largest one before the first failure, to 1 N (in the ablations to 5 N).
- The direction psi counts counter-clockwise from forward. The left foot is the stance foot, so psi 90 is
  inward.
- F\\* is the [closed-form limit](limits.md) of single support. A controller that stops its trunk before
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
