"""The paper's claims against the numbers of a run, and the page that holds them (docs/generated)."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...controllers.files import write_text
from ..output.tables import Table, markdown_table

Content = dict[str, Any]
Tables = Mapping[str, Sequence[Table]]  # by name of the section

REPRODUCED, DIFFERS, UNSTATED = "reproduced", "differs", "cannot be told from the text"


class Claim(NamedTuple):
    """One row of the page's first table."""

    claim: str
    paper: str
    ours: str
    verdict: str  # one of the three, and why


def table_text(table: Table) -> str:
    """A table in Markdown under a line in bold."""
    return f"**{table.title}**\n\n{markdown_table(table.columns, table.rows)}"


def verdict(holds: bool, why: str = "") -> str:
    """Reproduced where it holds, otherwise differs; with a reason."""
    return (REPRODUCED if holds else DIFFERS) + (f": {why}" if why else "")


def claims(content: Content) -> Iterator[Claim]:
    """All claims in the paper's order, of a result object with scenarios 1 and 2."""
    yield from _forces(content)
    yield from _motion(content["scenario_1_cases"], content["scenario_1_sway"])
    yield from _scenario_2(content["scenario_2"], content["scenario_2_overview"]["two-stage"])
    yield Claim(
        "The matrices of stage 2 change with every cycle, as the horizon does",
        "recomputed at each control cycle",
        "They depend on the number of intervals alone, so there is one table for each, built once",
        f"{DIFFERS}: nothing has to be recomputed",
    )
    yield Claim(
        "Double support",
        "the hull of both feet, 0.55 s + 0.1 s; how it enters stage 1 is not said",
        "`two-stage+double-support` has a linear transfer of the CoP inside stage 1, and the hull inside "
        "stage 2",
        UNSTATED,
    )
    yield Claim(
        "Foot size, l_p, control period and sampling time of stage 2",
        "not given",
        "They are 0.20 x 0.10 m, 0.20 m, 10 ms and 50 ms here. What other values give is in the tables below",
        UNSTATED,
    )


def _forces(content: Content) -> Iterator[Claim]:
    """Largest forces of scenario 1, and what decides them."""
    variants, intervals = content["scenario_1"], content["scenario_1_interval"]
    together, point = content["scenario_1_together"], content["scenario_1_limits_N"]["point foot"]
    a, b, scaled = variants["stage-1-paper"], variants["two-stage-paper"], variants["stage-1"]
    word_a, word_b = ("recovers" if one["recovers_315_N"] else "does not recover" for one in (a, b))
    low, high = intervals["stage-1-paper"]["max_force_N"]
    group = together["stage-1-paper"]["none"]
    yield Claim(
        "(a) Step place and time alone do not recover from 315 N (Figs. 3a, 4a)",
        "falls",
        f"It {word_a}. The largest force is {a['max_force_N']:.0f} N, and {low:.0f}-{high:.0f} N over the "
        f"open parameters. {group['recovered']} of {group['combinations']} combinations recover",
        verdict(
            not a["recovers_315_N"],
            "but it is the weights that fail. With a large enough alpha_3, stage 1 survives "
            f"{scaled['max_force_N']:.0f} N, and the limit of any point foot is {point:.1f} N",
        ),
    )
    low, high = intervals["two-stage-paper"]["max_force_N"]
    group = together["two-stage-paper"]["repaired"]
    yield Claim(
        "(b) CoP and angular momentum recover from 315 N (Figs. 3b, 4b)",
        "recovers",
        f"It {word_b}. The largest force is {b['max_force_N']:.0f} N, and {low:.0f}-{high:.0f} N with one "
        f"open parameter at another value. {group['survived']} of {group['combinations']} combinations "
        f"survive, and {group['recovered']} recover",
        verdict(b["recovers_315_N"], "with the cost taken about the free motion"),
    )
    literal = together["two-stage-paper"]["literal"]
    yield Claim(
        "With the cost of eq. 20 the robot walks",
        "the DCM acceleration itself is penalised (beta_2)",
        f"{literal['recovered']} of {literal['combinations']} combinations recover from 315 N, "
        f"and {literal['survived']} survive",
        verdict(
            literal["recovered"] > 0.5 * literal["combinations"],
            "the acceleration of the free motion is not zero, so a penalty on it pulls the CoP off its "
            "reference and the gait off its speed. We penalise the deviation from it (`jerk_cost` repaired)",
        ),
    )


def _motion(cases: Content, sway: list[Content]) -> Iterator[Claim]:
    """Gait, CoP, trunk and speed about the push of scenario 1."""
    a, b = cases["stage-1-paper"], cases["two-stage-paper"]
    soft = next(entry for entry in sway if entry["beta_3"] == 0.01)
    steps = " and ".join(
        f"{step['duration']:.2f} s and is {step['width']:.2f} m wide in ({name})"
        for name, step in (("a", a["pushed_step"]), ("b", b["pushed_step"]))
    )
    yield Claim(
        "Before the push all nominal values are realised",
        "four nominal steps",
        f"In (b) the steps are within {1e3 * b['step_error_before']:.1f} mm and "
        f"{1e3 * b['duration_error_before']:.1f} ms",
        verdict(
            b["step_error_before"] < 0.01,
            "the sampled cost moves the steps by these millimetres, and with `two-stage` there are none",
        ),
    )
    yield Claim(
        "Both cases adapt step time and place after the push",
        "yes",
        f"The pushed step takes {steps} (nominal: 0.65 s, 0.20 m)",
        verdict(max(a["pushed_step"]["duration"], b["pushed_step"]["duration"]) < 0.6),
    )
    yield Claim(
        "(b) The CoP leans to the inner edge of the sole",
        "yes",
        f"The CoP goes {1e3 * b['cop_to_inner_edge']:.0f} mm of 50 mm towards it",
        verdict(b["cop_to_inner_edge"] > 0.04),
    )
    yield Claim(
        "(b) The trunk sways (Fig. 4b)",
        "clearly visible",
        f"It leans by {b['peak_lean_within_1_s']:.2f} rad within 1 s with beta_3 = 1, and by "
        f"{soft['peak_lean_within_1_s']:.2f} rad with beta_3 = 0.01",
        f"{UNSTATED}: the unit or the square of beta_3 is not given",
    )
    yield Claim(
        "(b) It resumes the commanded speed",
        "0.5 m/s",
        f"It walks at {b['final_speed']:.2f} m/s over the last two steps",
        verdict(abs(b["final_speed"] - 0.5) < 0.05),
    )
    yield Claim(
        "(b) It does so with the upper body upright",
        "yes",
        f"It leans by {b['final_lean']:.2f} rad 4 s after the push (with beta_3 = 0.01 by "
        f"{soft['final_lean']:.2f} rad, and `two-stage` by {cases['two-stage']['final_lean']:.2f} rad)",
        verdict(
            b["final_lean"] < 0.2,
            "eq. 20 has no term that brings the trunk back, and in SI units its rate term is weak",
        ),
    )


def _scenario_2(section: Content, overview: Content) -> Iterator[Claim]:
    """Largest forces by direction; `overview` is that of `two-stage`."""
    forces = {
        name: {entry["psi_deg"]: entry["max_force_N"] for entry in entries}
        for name, entries in section.items()
    }
    paper, alone = forces["two-stage-paper"], forces["stage-1-paper"]
    ratio = {psi: paper[psi] / alone[psi] for psi in paper if alone[psi] > 0}
    psi = min(ratio, key=lambda angle: ratio[angle])
    yield Claim(
        "Two stages recover from larger pushes than stage 1 in every direction (Fig. 7)",
        "yes, as a polar map without numbers",
        f"With the paper's weights the least ratio is {ratio[psi]:.2f} (psi {psi:g} deg). With scaled "
        f"weights it is {overview['ratio_to_stage_1_min']:.2f}, and "
        f"{overview['ratio_to_stage_1_min_inward']:.2f} inward",
        verdict(ratio[psi] > 1.0 and overview["ratio_to_stage_1_min"] > 1.0),
    )
    best = forces["two-stage"]
    if {0.0, 90.0, 270.0} <= best.keys():
        yield Claim(
            "Sideways the robot recovers from less than otherwise, since the feet must not collide",
            "yes",
            f"`two-stage` reaches {best[0.0]:.0f} N forward, {best[270.0]:.0f} N outward and "
            f"{best[90.0]:.0f} N inward",
            verdict(best[0.0] > best[270.0] > best[90.0], "the closed form says the same"),
        )


PICTURES = "pictures"  # folder beside the page
SHOWN = (
    ("fig3_paths.png", "Top view of cases (a) and (b): soles, CoP, CoM and DCM (the paper's Fig. 3)"),
    ("fig4_histories.png", "Lateral DCM, CoM, feet, trunk angle and torque over time (Fig. 4)"),
    ("fig5_cartoon.png", "The motion from behind at some instants (Fig. 5)"),
    ("fig5_motion.gif", "The same as a film at half speed"),
    ("fig7_limits.png", "Largest push by direction, every variant and the closed-form limits (Fig. 7)"),
    ("fig7_variants.png", "What belongs to `two-stage` taken away"),
    ("fig7_jump.png", "Largest velocity jump by direction"),
)
HEAD = """# Reproduction: every claim, table and figure

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
    """Write the page and copy its pictures, which lie in `directory`, beside it; returns what was written."""
    pictures = path.parent / PICTURES
    pictures.mkdir(parents=True, exist_ok=True)
    written = [Path(shutil.copyfile(directory / name, pictures / name)) for name, _ in SHOWN]
    write_text(path, page(content, tables))
    return [path, *written]


def page(content: dict[str, Any], tables: Tables) -> str:
    """The page as Markdown."""
    rows = [tuple(cell.replace("|", "\\|") for cell in claim) for claim in claims(content)]
    parts = [HEAD, markdown_table(("claim", "paper", "ours", "verdict"), rows)]
    parts += [f"![{text}]({PICTURES}/{name})\n" for name, text in SHOWN[:4]]
    text = {name: [table_text(table) for table in section] for name, section in tables.items()}
    parts += ["## Scenario 1\n", *text["scenario-1"]]
    parts += ["## Scenario 2\n", *(f"![{about}]({PICTURES}/{name})\n" for name, about in SHOWN[4:])]
    pushed, jumped = content["scenario_2_overview"], content["jump_overview"]
    rows = [
        (name, *(f"{entry[name][field]:.3f}" if name in entry else "-"
                 for entry in (pushed, jumped) for field in ("fraction_mean", "fraction_worst")))
        for name in pushed
        if name.startswith("two-stage")
    ]  # fmt: skip
    columns = ("variant", "push, mean", "worst", "velocity jump, mean", "worst")
    parts += [*text["scenario-2"], GAP, markdown_table(columns, rows)]
    parts += ["## Ablations\n", *text["ablations"], "## Limits\n", *text["limits"]]
    return "\n".join(parts)
