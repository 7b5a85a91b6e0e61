"""Make the README's table on `hard` and `quick` again, with the shipped learned policies there are.

Rows that are in runs/ already are kept; the others are evaluated, 1280 pushes for each policy.
"""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path

from push_recovery.controllers import settings as presets
from push_recovery.eval.output.tables import markdown_table
from push_recovery.eval.rollout import default_workers
from push_recovery.eval.rollout.load_policy import shipped_names
from push_recovery.eval.score.evaluate import Evaluation
from push_recovery.eval.score.report import rate_cells

from push_recovery import evaluate

PAGE = Path(__file__).parents[1] / "README.md"
SUITE, EVERY_KIND = "hard", "quick"
ADAPTS = {
    "raibert": "step place, by the capture-point rule",
    "fixed-time": "step place",
    "herdt": "step place, by linear MPC",
    "stage-1": "step place and step time",
    "stage-1+cop": "step place, step time and CoP",
    "stage-1+momentum": "step place, step time and trunk",
    "two-stage": "step place, step time, CoP and trunk",
    "residual": "the same, corrected by a network",
    "residual-hardware": "the same; the network has learned under `hardware`",
    "joint-residual": "as `two-stage`; a network corrects the joint torques",
    "joint-residual-hardware": "the same; the network has learned under `hardware`",
    "scratch": "as `two-stage`, but a network decides alone",
    "joint": "joint targets, without a planner",
}
LEARNED = ("residual", "residual-hardware", "scratch", "joint", "joint-residual", "joint-residual-hardware")
COLUMNS = (
    "policy", "what it may adapt", "recovered", "share (95 % interval)", "survived", "recovered of `quick`"
)  # fmt: skip


def main() -> None:
    """Evaluate, and write the table between its marks."""
    policies = compared()
    found, of_every_kind = (
        evaluate(policies, suite, workers=default_workers()) for suite in (SUITE, EVERY_KIND)
    )
    text = PAGE.read_text(encoding="utf-8")
    mark = f"<!-- figures: push-recovery evaluate --suite {SUITE} {EVERY_KIND} --policies raibert"
    begin = text.index(mark)
    end = text.index("<!-- end -->", begin)
    content = f"{figures(policies, found, of_every_kind)}\n\n{table(found, of_every_kind)}\n"
    PAGE.write_text(text[:begin] + content + text[end:], encoding="utf-8")
    print(f"table: {PAGE}")


def compared() -> list[str]:
    """The variants, and the learned policies that are there."""
    return [name for name in ADAPTS if name not in LEARNED or name in shipped_names()]


def figures(policies: list[str], *found: Evaluation) -> str:
    """What made the figures, and what they hang on: tests/test_figures.py finds those that are stale."""
    git = ["git", "-C", str(PAGE.parent), "rev-parse", "--short=7", "HEAD"]
    commit = subprocess.run(git, check=True, capture_output=True, text=True).stdout.strip()  # noqa: S603
    preset = Path(presets.__file__).parent / "presets" / "biped.json"
    digest = hashlib.sha256(preset.read_bytes()).hexdigest()[:12]
    command = f"push-recovery evaluate --suite {SUITE} {EVERY_KIND} --policies {' '.join(policies)}"
    suites = "; ".join(f"suite {one.suite.name} {one.suite.sha256[:12]}" for one in found)
    return f"<!-- figures: {command}; commit {commit}; {suites}; preset biped {digest} -->"


def table(found: Evaluation, of_every_kind: Evaluation) -> str:
    """A row for each policy; the most recoveries are set in bold."""
    most, best = (max(one.score(name).recovered for name in one.rows) for one in (found, of_every_kind))
    rows = []
    for name in found.rows:
        score = found.score(name)
        rate, interval = rate_cells(score)
        cells = [str(score.recovered), f"{rate} ({interval})", str(score.survived)]
        told = [f"**{cell}**" for cell in cells] if score.recovered == most else cells
        quick = str(of_every_kind.score(name).recovered)
        told.append(f"**{quick}**" if int(quick) == best else quick)
        rows.append((f"`{name}`", ADAPTS[name], *told))
    return markdown_table(COLUMNS, rows)


if __name__ == "__main__":
    main()
