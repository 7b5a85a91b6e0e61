"""The page of an evaluation as text: complete, escaped, without anything that is asked for elsewhere."""

import re

import pytest
from push_recovery.controllers.errors import MissingExtraError
from push_recovery.eval.cli.options import page_lines
from push_recovery.eval.report import page
from push_recovery.eval.report.evaluation import write_evaluation_page
from push_recovery.eval.report.page import Command

pytest.importorskip("jinja2", reason="needs the extra report")
COMMAND = Command(("evaluate",), (("--suite", ("quick",)),))
PARTS = {"measured", "rates", "impulse", "direction", "pairs", "effort", "losses", "pushes", "manifest"}
NAUGHTY = '<script>alert("x")</script>&'


@pytest.fixture
def written(evaluation, tmp_path):
    found = evaluation({"p": "rrfsff", NAUGHTY: "rfrrff"})
    return write_evaluation_page({"exact": found, "hardware": found}, COMMAND, tmp_path), found


def test_the_page_has_every_part(written):
    path, found = written
    text = path.read_text()
    assert path.name == "report.html"
    for part in PARTS:
        assert f'id="{part}"' in text
    assert found.suite.sha256 in text
    assert COMMAND.text in text
    assert all(scenario.id in text for scenario in found.suite.scenarios)
    assert path.stat().st_size < 3e6


def test_what_it_took_stands_in_a_table_and_behind_every_sign(written):
    text = written[0].read_text()
    cells = ("7", "25.1", "28.6", "123", "45.6", "7.89")  # 0.251 m, 0.5 rad, 7890 J
    assert all(f'class="num">{cell}</td>' in text for cell in cells)
    assert "1 of 6 pushes" in text  # that both recover from
    assert 'title="margin 25 cm, lean 29 deg, 7.9 kJ"' in text
    falls = "falls 3.2 s into the walk (sank too low, first limit met: CoP)"
    assert f'title="{falls}; margin 25 cm, lean 29 deg, 7.9 kJ"' in text


def test_nothing_is_asked_for_elsewhere(written):
    text = written[0].read_text()
    names = re.findall(r'(?:href|src)="([^"]*)"', text) + re.findall(r"url\(([^)]*)\)", text)
    assert names
    assert {name for name in names if not name.startswith(("#", "data:,"))} == set()
    assert set(re.findall(r'https?://[^"\s<]*', text)) <= {
        "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
    }  # fmt: skip
    assert "<script>alert" not in text  # names are text and no code
    assert "&lt;script&gt;alert" in text


def test_references_of_all_figures_end_in_themselves(written):
    text = written[0].read_text()
    ids = re.findall(r'\bid="([^"]*)"', text)
    wanted = set(re.findall(r'href="#([^"]*)"', text)) | set(re.findall(r"url\(#([^)]*)\)", text))
    assert wanted <= set(ids)


def test_a_profile_that_stands_alone_is_named_and_one_policy_has_no_pairs(evaluation, tmp_path):
    for profile, title in (("hardware", "Pendulum-v0, profile hardware</h1>"), ("exact", "Pendulum-v0</h1>")):
        text = write_evaluation_page({profile: evaluation({"p": "rrfs"})}, COMMAND, tmp_path).read_text()
        assert f"PushRecovery/{title}" in text
        assert not any(words in text for words in ('id="pairs"', "#pairs"))


@pytest.mark.parametrize(
    ("worse", "words"),
    [("rffs", "1 push, only the second from 0"), ("fffr", "2 pushes, only the second from 1")],
)
def test_one_push_is_a_push_and_two_are_pushes(worse, words, evaluation, tmp_path):
    found = evaluation({"better": "rrfs", "worse": worse})
    text = write_evaluation_page({"exact": found}, COMMAND, tmp_path).read_text()
    assert f"better and worse: only the first recovers from {words}</summary>" in text


def test_without_the_extra_one_line_says_how_to_get_it(monkeypatch, evaluation, tmp_path, capsys):
    monkeypatch.setattr(page, "find_spec", lambda _: None)
    found = evaluation({"p": "rrfs"})
    with pytest.raises(MissingExtraError):
        write_evaluation_page({"exact": found}, COMMAND, tmp_path)
    assert page_lines(lambda: write_evaluation_page({"exact": found}, COMMAND, tmp_path)) == []
    out, err = capsys.readouterr()
    assert out == ""
    assert err == (
        "no report.html: jinja2 is not installed; install it with: pip install 'push-recovery[report]'\n"
    )
    assert not (tmp_path / "report.html").exists()
