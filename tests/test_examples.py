"""What the pages and scripts say holds: the README's code and the quick examples."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import capture_constants
from push_recovery.controllers.model.standing import Feet, margin_on_both_feet, standing_margin
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS

ROOT = Path(__file__).parents[1]


def run(*arguments):
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


PAGES = sorted(ROOT.glob("*.md")) + sorted((ROOT / "docs").rglob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_the_readmes_loop_runs():
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.S)
    loop = next(block for block in blocks if "make_policy" in block)
    assert re.fullmatch(r"52\.8 N s to the right: (recovered|fell) after \d\.\d s.*\n", run("-c", loop))


def test_the_readmes_model_trains_in_a_gate_and_is_scored_on_what_it_was_trained_on():
    pytest.importorskip("stable_baselines3", reason="needs the extra train")
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.S)
    model = next(block for block in blocks if "PPO" in block)
    ask = (
        "from push_recovery import load_policy\n"
        "policy = load_policy(model, gym.make('push_recovery:PushRecovery/Biped-v0')).description\n"
        "print(policy.hold, policy.residual.policy, policy.residual.gate)"
    )
    assert run("-c", model + ask) == "1024 corrections learned from\n2 two-stage (0.03, 0.1)\n"


CODE = {  # page -> what its code prints
    "play": r"True 0\.\d+ m\n",
    "start": r"52\.8 N s to the right: (recovered|fell) after \d\.\d s.*\n",
    "your_own": r"[1-9] 1\d\n2 [0-9a-f]{12}\n",
}


@pytest.mark.parametrize("name", CODE)
def test_the_code_of_a_page_runs(name, monkeypatch, tmp_path):
    page = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert re.fullmatch(
        CODE[name], run("-c", "\n".join(re.findall(r"```python\n(.*?)```", page, flags=re.S)))
    )


ENDING = r"(recovered after|fell after|still up after) \d+\.\d s.*"
SAYS = {  # script -> what each of its lines says, whatever becomes of the pushes
    "gym_loop": [rf"30\.0 N s to the left: {ENDING}; 0\.50 N s/kg", r"reward \d+ over \d+\.\d s"],
    "residual": [
        rf"{name}: 90\.0 N s to the left: {ENDING}; the gate was open for \d\.\d of \d\.\d s"
        for name in ("planner alone", "step sooner")
    ],
    "learned": [
        r"two-stage: 120\.0 N s \(2\.00 N s/kg\) to the left: fell .*; trunk leant \d\.\d\d rad at most",
        r"joint-residual: 120\.0 N s .*: recovered.*; trunk leant \d\.\d\d rad at most",
    ],
    "planner_alone": [  # the worked example of docs/planner.md
        r"undisturbed: 0\.00 m, 0\.20 m, 0\.65 s",
        r"pushed: 0\.50 m, 0\.11 m, 0\.46 s",
    ],
    "many_robots": [r"16 pushes: \d+ recovered, \d+ fell, \d+ otherwise"],
    "your_suite": [
        r"mine: [1-8] of 8 pushes of 60 N s recovered",
        r"stage-1: [1-8] of 8 pushes of 60 N s recovered",
        r"suite and report: .+",
    ],
}


@pytest.mark.parametrize("name", SAYS)
def test_a_script_shows_what_it_says(name, monkeypatch, tmp_path):
    path = ROOT / "examples" / f"{name}.py"
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    lines = run(str(path)).splitlines()
    assert len(lines) == len(SAYS[name])
    for line, words in zip(lines, SAYS[name], strict=True):
        assert re.fullmatch(words, line), line


def test_the_gate_of_the_residual_is_shut_for_most_of_the_walk():
    for line in run(str(ROOT / "examples" / "residual.py")).splitlines():
        opened, whole = map(float, re.findall(r"open for ([\d.]+) of ([\d.]+) s", line)[0])
        assert 0.0 < opened < whole / 2


def test_the_notebook_runs_from_top_to_bottom(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    cells = json.loads((ROOT / "examples" / "one_push.ipynb").read_text(encoding="utf-8"))["cells"]
    out = run("-c", "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"))
    first, *others = out.splitlines()
    assert first.startswith("60.0 N s (1.00 N s/kg) to the left: ")
    farthest = [float(re.findall(r"at most (\d\.\d\d) m", line)[0]) for line in others]
    assert len(farthest) == 3
    assert farthest == sorted(farthest)


def test_the_notebook_shows_what_its_cells_print_and_draw():
    path = ROOT / "examples" / "one_push.ipynb"
    assert path.stat().st_size < 400_000
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    shown = [cell["outputs"] for cell in cells if cell["cell_type"] == "code"]
    assert [[out["output_type"] for out in outputs] for outputs in shown] == [
        ["stream"],
        ["display_data"],
        ["stream"],
    ]
    assert {out["name"] for outputs in (shown[0], shown[2]) for out in outputs} == {"stdout"}
    assert "image/png" in shown[1][0]["data"]
    lines = "".join(shown[0][0]["text"] + shown[2][0]["text"]).splitlines()
    assert lines[0].startswith("60.0 N s (1.00 N s/kg) to the left: ")
    assert [line.partition(":")[0] for line in lines[1:]] == ["20 N s", "40 N s", "60 N s"]


def test_the_regions_of_standing_end_where_nothing_is_left(tmp_path):
    """The kernels of the robot at rest have no margin at the borders; those of the soles follow by hand."""
    lines = run(str(ROOT / "examples" / "explain_standing.py"), str(tmp_path)).splitlines()
    assert (tmp_path / "standing.png").read_bytes()[:4] == b"\x89PNG"
    both = Feet.side_by_side(BIPED)
    constants, rest = capture_constants(BIPED, BIPED_LIMITS), np.zeros(2)
    left_over = {
        "ankle": lambda dcm: standing_margin(BIPED, BIPED_LIMITS, both, dcm, flywheel=False),
        "hip": lambda dcm: standing_margin(BIPED, BIPED_LIMITS, both, dcm),
        "step": lambda dcm: margin_on_both_feet(np.array(both.other), dcm, rest, rest, constants),
    }
    shift = 1.0 / (60.0 * math.sqrt(9.81 / 0.8))  # of the DCM by an impulse of 1 N s [m]
    for line in lines[:3]:
        name, *reach = re.findall(r"[a-z]*(?=:)|\d+\.\d", line)
        reach = [float(number) for number in reach if number]
        if name == "ankle":
            assert reach == pytest.approx([0.1 / shift, 0.1 / shift, 0.15 / shift, 0.15 / shift], abs=0.05)
        for way, impulse in zip(((1, 0), (-1, 0), (0, 1), (0, -1)), reach, strict=True):
            dcm = np.array(both.middle) + shift * impulse * np.array(way)
            assert left_over[name](dcm) == pytest.approx(0.0, abs=0.06 * shift), line


def test_the_picture_of_the_architecture_has_every_part_that_is_there():
    code = (ROOT / "examples" / "explain_architecture.py").read_text(encoding="utf-8")
    drawn = re.findall(r'Room\("([\w/]+)"', code)
    below = re.findall(r"\w+", code[code.index("BELOW = (") : code.index("FLOW = (")])
    parts = {
        f"{package}/{path.stem}"
        for package in ("controllers", "envs", "eval")
        for path in (ROOT / package).iterdir()
        if (path.suffix == ".py" and path.stem != "__init__") or (path / "__init__.py").is_file()
    }
    assert len(drawn) == len(set(drawn))
    assert {*drawn, *(part for part in parts if Path(part).name in below)} == {*parts, "training"}
    assert not [part for part in drawn if Path(part).name in below]
