"""Tables on terminals of any width: no word and no number is broken, and no column is lost."""

import pytest
from push_recovery.eval.output import tables
from push_recovery.eval.output.tables import Table

NUMBERS = ["97.4 % (997)", "96.2-98.2", "12345.678", "[5, 80)"]
TABLE = Table(
    "Limits [N s]",
    ["policy", "recovered", "95 % interval [%]", "flywheel velocity frozen", "impulse", "found by"],
    [
        ["joint-residual-hardware", *NUMBERS, "12.0 M actions, quick, hard"],
        ["two-stage", *"1234", "188 trials"],
    ],
)


@pytest.mark.parametrize("width", [50, 60, 80, 100, 120, 160])
def test_a_table_fits_into_a_terminal_without_breaking_words(monkeypatch, capsys, width):
    terminal = tables.Console(width=width, force_terminal=True, color_system=None, legacy_windows=False)
    monkeypatch.setattr(tables, "Console", lambda: terminal)
    TABLE.print()
    text = capsys.readouterr().out
    lines = [line.rstrip() for line in text.splitlines()]
    assert max(map(len, lines)) <= width + 8  # the title's own escape codes
    for whole in (
        "joint-residual-hardware",
        *NUMBERS,
        "policy",
        "flywheel",
        "velocity",
        "frozen",
        "actions,",
    ):
        assert whole in text
    parts = [line for line in lines if line.startswith("│ two-stage")]
    assert all(len(part.split("│")) > 3 for part in parts)  # the name again, and something beside it
    assert (len(parts) == 1) == (width >= 100)
    assert "".join(parts).count(" 1 ") == "".join(parts).count(" 4 ") == 1


def test_a_table_that_fits_keeps_its_headings_on_one_line(capsys):
    TABLE.print()  # no terminal: 160 columns
    assert "95 % interval [%] ┃ flywheel velocity frozen ┃" in capsys.readouterr().out


def test_a_stem_is_the_words_while_they_are_short_and_then_their_hash():
    assert [len(tables.stem_or_hash([word], "w")) for word in ("a" * 80, "a" * 81, "")] == [80, 8, 8]
