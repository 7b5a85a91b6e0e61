"""What the pages and scripts say holds: the README's code and the quick examples."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def run(*arguments):
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=120, check=False
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


def test_the_code_of_the_page_on_play_runs():
    page = (ROOT / "docs" / "play.md").read_text(encoding="utf-8")
    out = run("-c", "\n".join(re.findall(r"```python\n(.*?)```", page, flags=re.S)))
    assert re.fullmatch(r"True 0\.\d+ m\n", out)


def test_the_gym_loop_recovers_from_its_push():
    out = run(str(ROOT / "examples" / "gym_loop.py"))
    assert "0.50 N s/kg" in out
    assert "walks as commanded again" in out


def test_the_picture_of_the_architecture_has_every_room_that_is_there():
    code = (ROOT / "examples" / "explain_architecture.py").read_text(encoding="utf-8")
    drawn = re.findall(r'Room\("([\w/]+)"', code)
    below = re.findall(r"\w+", code[code.index("BELOW = (") : code.index("FLOW = (")])
    rooms = {
        str(found.parent.relative_to(ROOT))
        for package in ("controllers", "envs", "eval")
        for found in ROOT.glob(f"{package}/*/__init__.py")
    }
    assert len(drawn) == len(set(drawn))
    assert {*drawn, *(room for room in rooms if Path(room).name in below)} == {*rooms, "training"}
    assert not [room for room in drawn if Path(room).name in below]
