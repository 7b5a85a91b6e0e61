"""The site is whole: every page is in its contents, and a build has no warning and asks no other server."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"


def test_every_page_is_in_the_contents_once():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = re.findall(
        r"^[a-z][\w/-]*$", "\n".join(re.findall(r"```{toctree}(.*?)```", index, flags=re.S)), re.M
    )
    there = {str(page.relative_to(DOCS).with_suffix("")) for page in DOCS.rglob("*.md")} - {"index", "README"}
    assert sorted(listed) == sorted(there)


def test_the_public_names_are_all_documented():
    import push_recovery

    page = (DOCS / "api.md").read_text(encoding="utf-8")
    named = re.findall(r"\.\. auto\w+:: push_recovery\.[\w.]+\.(\w+)$", page, flags=re.M)
    assert sorted(named) == sorted(set(push_recovery.__all__) - {"__version__"})


def test_a_build_has_no_warning_and_asks_no_other_server(tmp_path):
    for package in ("sphinx", "furo", "myst_parser"):
        pytest.importorskip(package, reason="needs the extra docs")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        str(DOCS),
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stderr
    loads = re.compile(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(https?:)?//[^"]*"[^>]*>')
    for page in tmp_path.rglob("*.html"):
        assert not loads.search(page.read_text(encoding="utf-8")), page
    assert list(tmp_path.glob("_static/mathjax/*.js"))
