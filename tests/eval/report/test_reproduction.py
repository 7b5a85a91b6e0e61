import base64
import re

import pytest
from push_recovery.eval.cli.main import main
from push_recovery.eval.report.reproduction import pictures, verdict
from push_recovery.eval.reproduction.page import DIFFERS, REPRODUCED, UNSTATED, Claim

pytest.importorskip("jinja2", reason="needs the extra report")


def test_the_headline_counts_the_verdicts():
    words = REPRODUCED, f"{REPRODUCED}: but", DIFFERS, f"{UNSTATED}: as"
    told = [Claim("c", "p", "o", word) for word in words]
    assert verdict(told) == ("Of 4 claims 2 are reproduced, 1 differ, and 1 cannot be told from the text.")


def test_pictures_are_inside_the_page_in_the_papers_order(tmp_path):
    for name in ("fig7_limits.png", "fig3_paths.png", "fig5_motion.gif", "fig7_limits.svg", "other.png"):
        (tmp_path / name).write_bytes(name.encode())
    (tmp_path / "scaled-weights").mkdir()
    (tmp_path / "scaled-weights" / "fig3_paths.png").write_bytes(b"of other weights")
    found = pictures(sorted(tmp_path.rglob("*.*")), tmp_path)
    content = [re.fullmatch(r"data:image/(png|gif);base64,(.*)", data) for _, data in found]
    assert [base64.b64decode(match[2]).decode() for match in content if match] == [
        "fig3_paths.png", "fig5_motion.gif", "fig7_limits.png"
    ]  # fmt: skip
    assert not any("`" in caption for caption, _ in found)


def test_the_command_writes_it(tmp_path, capsys):
    assert main(["reproduce", "limits", "--workers", "1", "--out", str(tmp_path)]) == 0
    assert f"page: {tmp_path / 'report.html'}" in capsys.readouterr().out
    text = (tmp_path / "report.html").read_text()
    assert "push-recovery reproduce limits" in text
    assert "its claims are told where all parts run" in text
    assert text.count("<table") > 1
    names = re.findall(r'(?:href|src)="([^"]*)"', text)
    assert all(name.startswith(("#", "data:")) for name in names)
