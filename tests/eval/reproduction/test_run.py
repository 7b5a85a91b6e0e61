import base64
import copy
import re
from pathlib import Path

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.cli.main import main
from push_recovery.eval.reproduction.jobs import Table
from push_recovery.eval.reproduction.page import (
    DIFFERS,
    REPRODUCED,
    SHOWN,
    UNSTATED,
    Claim,
    claims,
    page,
    write_page,
)
from push_recovery.eval.reproduction.run import Reproduction, claims_table, pictures, reproduce, verdict

CASE = {
    "step_error_before": 0.0,
    "duration_error_before": 0.0,
    "cop_to_inner_edge": 0.05,
    "final_speed": 0.5,
    "pushed_step": {"length": 0.1, "width": 0.4, "duration": 0.3},
    "peak_lean_within_1_s": 0.6,
    "final_lean": 0.1,
}
GROUP = {"combinations": 10, "survived": 9, "recovered": 8}
VARIANTS = ("stage-1-paper", "two-stage-paper", "two-stage")


def entries(forward, outward, inward):
    forces = ((0.0, forward), (90.0, inward), (270.0, outward))
    return [{"psi_deg": psi, "max_force_N": force} for psi, force in forces]


CONTENT = {
    "scenario_1": {
        "stage-1-paper": {"recovers_315_N": False, "max_force_N": 60},
        "stage-1": {"recovers_315_N": True, "max_force_N": 315},
        "two-stage-paper": {"recovers_315_N": True, "max_force_N": 397},
    },
    "scenario_1_limits_N": {"point foot": 315.9},
    "scenario_1_interval": {name: {"max_force_N": [50, 500]} for name in VARIANTS},
    "scenario_1_together": {
        "stage-1-paper": {"none": GROUP},
        "two-stage-paper": {"repaired": GROUP, "literal": {**GROUP, "recovered": 2}},
    },
    "scenario_1_cases": dict.fromkeys(VARIANTS, CASE),
    "scenario_1_sway": [{"beta_3": 0.01, **CASE}],
    "scenario_2": {
        "stage-1-paper": entries(400, 60, 30),
        "two-stage-paper": entries(900, 390, 120),
        "two-stage": entries(1108, 633, 402),
    },
    "scenario_2_overview": {
        "two-stage": {
            "ratio_to_stage_1_min": 1.65,
            "ratio_to_stage_1_min_inward": 4.69,
            "fraction_mean": 0.98,
            "fraction_worst": 0.97,
        },
        "stage-1": {"fraction_mean": 0.39, "fraction_worst": 0.21},
    },
    "jump_overview": {"two-stage": {"fraction_mean": 0.98, "fraction_worst": 0.97}},
}
TABLES = {
    name: [Table(f"table of {name}", ("a",), [("1",)])]
    for name in ("scenario-1", "scenario-2", "ablations", "limits")
}


def verdicts(content):
    return {claim.claim: claim.verdict for claim in claims(content)}


def test_verdicts_follow_the_numbers():
    before = verdicts(CONTENT)
    changed = copy.deepcopy(CONTENT)
    changed["scenario_1"]["stage-1-paper"]["recovers_315_N"] = True
    changed["scenario_1"]["two-stage-paper"]["recovers_315_N"] = False
    changed["scenario_1_cases"]["two-stage-paper"] = {**CASE, "cop_to_inner_edge": 0.0, "final_speed": 0.3}
    changed["scenario_2"]["two-stage-paper"] = entries(300, 390, 120)
    after = verdicts(changed)
    flipped = {name for name in before if before[name] != after[name]}
    assert len(flipped) == 5
    assert all(before[name].startswith(REPRODUCED) and after[name].startswith(DIFFERS) for name in flipped)


def test_most_numbers_say_reproduced_and_the_worst_direction_is_named():
    found = {claim.claim: claim for claim in claims(CONTENT)}
    speed = found["(b) It resumes the commanded speed"]
    assert speed.verdict == REPRODUCED
    literal = found["With the cost of eq. 20 the robot walks"]
    assert literal.verdict.startswith(DIFFERS)
    # 900 / 400, 120 / 30 and 390 / 60: least to the front
    ratio = next(claim for name, claim in found.items() if name.startswith("Two stages recover from larger"))
    assert "the least ratio is 2.25 (psi 0 deg)" in ratio.ours
    assert "With scaled weights it is 1.65, and 4.69 inward" in ratio.ours
    assert ratio.verdict == REPRODUCED


def test_the_page_holds_claims_numbers_tables_and_pictures():
    text = page(CONTENT, TABLES)
    assert "The largest force is 397 N, and 50-500 N with one open parameter" in text
    assert "1108 N forward, 633 N outward and 402 N inward" in text
    assert "| two-stage | 0.980 | 0.970 | 0.980 | 0.970 |" in text
    assert all(f"(pictures/{name})" in text for name, _ in SHOWN)
    assert all(f"**table of {name}**" in text for name in TABLES)


def test_the_page_brings_its_pictures(tmp_path):
    for name, _ in SHOWN:
        (tmp_path / name).write_bytes(name.encode())
    written = write_page(CONTENT, TABLES, tmp_path, tmp_path / "docs" / "page.md")
    assert {path.name for path in written} == {"page.md", *(name for name, _ in SHOWN)}
    assert all((tmp_path / "docs" / "pictures" / name).read_bytes() == name.encode() for name, _ in SHOWN)


def test_a_page_needs_all_sections_and_a_markdown_name(tmp_path, capsys):
    with pytest.raises(InvalidValueError, match="a page needs all sections, got 'limits'"):
        reproduce("limits", directory=tmp_path, page=tmp_path / "page.md")
    assert main(["reproduce", "--page", "page.txt"]) == 2
    assert "must name a .md file, got 'page.txt'" in capsys.readouterr().err


def test_the_headline_counts_the_verdicts():
    words = REPRODUCED, f"{REPRODUCED}: but", DIFFERS, f"{UNSTATED}: as"
    told = [Claim("c", "p", "o", word) for word in words]
    assert verdict(told) == ("Of 4 claims 2 are reproduced, 1 differ, and 1 cannot be told from the text.")


def test_the_terminal_has_every_claim_behind_its_verdict():
    known = Reproduction({}, CONTENT, [], [], Path()).claims
    table = claims_table(known)
    assert table.columns == ("verdict", "claim")
    assert len(table.rows) == len(known) == 14
    assert {word for word, _ in table.rows} <= {REPRODUCED, DIFFERS, UNSTATED}
    assert table.rows[0][1].startswith("(a) Step place and time alone do not recover from 315 N")
    assert not any("`" in cell for row in table.rows for cell in row)
    assert Reproduction({}, {"scenario_1": CONTENT["scenario_1"]}, [], [], Path()).claims == []


def test_pictures_are_inside_the_page_in_the_papers_order(tmp_path):
    for name in ("fig7_limits.png", "fig3_paths.png", "fig5_motion.gif", "fig7_limits.svg", "other.png"):
        (tmp_path / name).write_bytes(name.encode())
    (tmp_path / "scaled-weights").mkdir()
    (tmp_path / "scaled-weights" / "fig3_paths.png").write_bytes(b"of other weights")
    found = pictures(tmp_path)
    content = [re.fullmatch(r"data:image/(png|gif);base64,(.*)", data) for _, data in found]
    assert [base64.b64decode(match[2]).decode() for match in content if match] == [
        "fig3_paths.png", "fig5_motion.gif", "fig7_limits.png"
    ]  # fmt: skip
    assert not any("`" in caption for caption, _ in found)


def test_the_command_writes_its_report(tmp_path, capsys):
    pytest.importorskip("jinja2", reason="needs the extra report")
    assert main(["reproduce", "limits", "--workers", "1", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert f"page: {tmp_path / 'report.html'}" in printed
    assert "One part of the paper; its claims are told where all parts run" in printed
    text = (tmp_path / "report.html").read_text()
    assert "push-recovery reproduce limits" in text.replace("<span>", "").replace("</span>", "")
    assert "its claims are told where all parts run" in text
    assert text.count("<table") > 1
    names = re.findall(r'(?:href|src)="([^"]*)"', text)
    assert all(name.startswith(("#", "data:")) for name in names)


def test_pushes_come_before_jumps():
    changed = {**CONTENT, "jump_overview": {"two-stage": {"fraction_mean": 0.9, "fraction_worst": 0.8}}}
    assert "| two-stage | 0.980 | 0.970 | 0.900 | 0.800 |" in page(changed, TABLES)


LONG = {"pushed_step": {**CASE["pushed_step"], "duration": 0.65}}


@pytest.mark.parametrize(
    ("case", "change", "claim"),
    [
        ("two-stage-paper", {"step_error_before": 0.011}, "Before the push all nominal values are realised"),
        ("stage-1-paper", LONG, "Both cases adapt step time and place after the push"),
        ("two-stage-paper", LONG, "Both cases adapt step time and place after the push"),
        ("two-stage-paper", {"final_lean": 0.21}, "(b) It does so with the upper body upright"),
    ],
)
def test_a_claim_about_the_motion_differs_where_its_number_is_off(case, change, claim):
    changed = copy.deepcopy(CONTENT)
    changed["scenario_1_cases"][case] = {**CASE, **change}
    assert verdicts(CONTENT)[claim].startswith(REPRODUCED)
    assert verdicts(changed)[claim].startswith(DIFFERS)


@pytest.mark.parametrize(
    ("forces", "word"),
    [((1108, 633, 402), REPRODUCED), ((1108, 402, 633), DIFFERS), ((600, 633, 402), DIFFERS)],
)
def test_sideways_is_less_than_forward_and_least_inward(forces, word):
    changed = copy.deepcopy(CONTENT)
    changed["scenario_2"]["two-stage"] = entries(*forces)
    claim = "Sideways the robot recovers from less than otherwise, since the feet must not collide"
    assert verdicts(changed)[claim].startswith(word)


def test_two_stages_are_ahead_with_the_scaled_weights_too():
    changed = copy.deepcopy(CONTENT)
    changed["scenario_2_overview"]["two-stage"]["ratio_to_stage_1_min"] = 0.9
    claim = "Two stages recover from larger pushes than stage 1 in every direction (Fig. 7)"
    assert (verdicts(CONTENT)[claim], verdicts(changed)[claim]) == (REPRODUCED, DIFFERS)


@pytest.mark.parametrize(
    ("change", "claim"),
    [
        ({"final_speed": 0.56}, "(b) It resumes the commanded speed"),
        ({"final_speed": 0.44}, "(b) It resumes the commanded speed"),
        ({"cop_to_inner_edge": 0.03}, "(b) The CoP leans to the inner edge of the sole"),
    ],
)
def test_a_number_a_little_off_is_no_reproduction(change, claim):
    changed = copy.deepcopy(CONTENT)
    changed["scenario_1_cases"]["two-stage-paper"] = {**CASE, **change}
    assert (verdicts(CONTENT)[claim], verdicts(changed)[claim]) == (REPRODUCED, DIFFERS)
