"""Tables of figures say what made them, and are stale where that has changed.

Before such a table stands <!-- figures: COMMAND; commit HASH; suite NAME HASH; preset NAME HASH -->, where a
command without a suite has none. What the outcomes hang on is the pushes and the planner's settings; a
refactoring leaves both as they are.
"""

import hashlib
import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest
from push_recovery.controllers import settings as presets
from push_recovery.eval.cli.main import parse
from push_recovery.eval.score.suites import get_suite

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FOUND = [
    (page.relative_to(ROOT), figures)
    for page in PAGES
    for figures in re.findall(r"<!-- figures: (.*?) -->", page.read_text(encoding="utf-8"))
]


def preset_hash(name):
    path = Path(presets.__file__).parent / "presets" / f"{name}.json"
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(("page", "figures"), FOUND, ids=[f"{page}-{i}" for i, (page, _) in enumerate(FOUND)])
def test_figures_are_of_todays_pushes_and_settings(page, figures):
    command, commit, *others = figures.split("; ")
    program, name, *words = shlex.split(command)
    assert program == "push-recovery"
    options = parse(name, words)
    assert re.fullmatch(r"commit [0-9a-f]{7,40}", commit)
    stated = [part.split() for part in others]
    suites = {name: digest for kind, name, digest in stated if kind == "suite"}
    presets = {name: digest for kind, name, digest in stated if kind == "preset"}
    assert len(suites) + len(presets) == len(stated)
    assert presets, page
    asked = getattr(options, "suite", None) or ()
    assert list(suites) == ([asked] if isinstance(asked, str) else list(asked)), page
    for suite, digest in suites.items():
        assert get_suite(suite).sha256.startswith(digest), f"{page}: suite {suite} has changed: {command}"
    for preset, digest in presets.items():
        assert preset_hash(preset).startswith(digest), f"{page}: preset {preset} has changed: {command}"


def test_every_table_of_figures_of_the_readme_says_what_made_it():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    tables = re.split(r"\n\n(?=\|)", text)
    for before, table in pairwise(tables):
        rows = table.split("\n\n")[0].splitlines()[2:]
        if any(len(re.findall(r"\d+", row)) > 3 for row in rows):
            assert before.rstrip().endswith("-->"), rows[0]
            assert "<!-- figures: " in before.rstrip().splitlines()[-1]


@pytest.mark.parametrize("place", [0, 1])
def test_the_rows_of_the_headlines_are_the_policies_of_their_commands(place):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    figures, table = re.findall(r"<!-- figures: (.*?) -->\n\n(.*?)\n\n<!-- end -->", text, flags=re.S)[place]
    named = figures.split("; ")[0].partition("--policies ")[2].split()
    assert re.findall(r"^\| `(.+?)` ", table, flags=re.M) == named
    for row in table.splitlines()[2:]:
        cells = [cell.strip(" *") for cell in row.split("|")[1:-1]]
        assert float(cells[3].split()[0]) == pytest.approx(int(cells[2]) / 1024, abs=6e-4)
        assert int(cells[2]) <= int(cells[4]) <= 1024


def cells_of(page, figures):
    """First cell of a row -> the others, of the table that a command made on a page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.findall(r"<!-- figures: (.*?) -->\n\n(.*?)\n\n<!-- end -->", text, flags=re.S)
    (table,) = [table for made, table in found if made.startswith(figures)]
    rows = [[cell.strip(" *`") for cell in line.strip("|").split("|")] for line in table.splitlines()]
    return rows[0], {cells[0]: cells[1:] for cells in rows[2:]}


def test_pages_that_tell_of_the_same_run_tell_the_same():
    _, headline = cells_of("README.md", "push-recovery evaluate --suite hard quick --policies raibert")
    _, biped = cells_of("docs/biped.md", "push-recovery evaluate --suite hard ")
    for policy, (recovered, survived, *_) in biped.items():
        assert [recovered, survived] == [headline[policy][1], headline[policy][3]]
    _, profiles = cells_of("README.md", "push-recovery evaluate --suite varied ")
    for column, figures in enumerate(("--suite varied;", "--suite varied --profile exact hardware;")):
        head, kinds = cells_of("docs/generated/losses.md", f"push-recovery evaluate {figures}")
        told = dict(zip(head[2:], kinds["all"][1:], strict=True))
        assert told == {policy: profiles[policy][column] for policy in told}
