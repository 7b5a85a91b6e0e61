import os
import re
import subprocess
import sys
from dataclasses import fields

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.cli.main import COMMANDS, one_line, parse
from push_recovery.eval.cli.options import VelocityOptions
from push_recovery.eval.cli.studies import Frontier
from push_recovery.eval.cli.tools import Tune
from push_recovery.eval.tuning.study import TuningSettings


def test_options_are_the_fields_of_a_dataclass():
    options = parse(
        "frontier", ["--policy", "a", "b", "--vx", "-0.5", "--grid", "5", "--body", "trunk", "--json"]
    )
    assert options == Frontier(policies=("a", "b"), vx=-0.5, grid=5.0, body="trunk", json=True)
    assert parse("frontier", ["--policies", "a", "b"]) == Frontier(policies=("a", "b"))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -2.01, 2.01])
def test_bounds_hold_for_options_made_in_python_too(value):
    assert VelocityOptions(vx=-2.0, vy=2.0).vy == 2.0
    with pytest.raises(InvalidValueError, match=r"--vy must be a number in \[-2, 2\]"):
        VelocityOptions(vy=value)


def test_tune_has_the_defaults_of_its_settings():
    tune, settings = Tune().settings, TuningSettings(Tune().env, *Tune().policies)
    for field in fields(TuningSettings):
        assert getattr(tune, field.name) == getattr(settings, field.name)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_a_text(name, capsys):
    with pytest.raises(SystemExit) as leave:
        parse(name, ["--help"])
    assert leave.value.code == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for option in re.sub(r" -{3,}", "", text).split(" --")[2:]:  # without the line below a group's title
        assert len(option.partition("(default")[0].split()) > 1, option
    assert not [form for form in ("{None}", "{[", "[INT", "[FLOAT") if form in text]


FRAMED = """\
╭─ Value error ─────────────────────────────╮
│ Error parsing --seed: invalid literal for │
│ int() with base 10: 'two'                 │
│ ───────────────────────────────────────── │
│ For full helptext, see x --help           │
╰───────────────────────────────────────────╯
"""
BARE = """ Value error
 -----------------------------------------
  Error parsing --seed: invalid literal for
  int() with base 10: 'two'
  -----------------------------------------
  For full helptext, see x --help

"""


@pytest.mark.parametrize("box", [FRAMED, BARE])
def test_a_frame_becomes_one_line(box):
    assert one_line(box) == "--seed must be an integer, got 'two'"


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_errors_are_the_same_on_every_terminal(encoding):
    done = subprocess.run(
        [sys.executable, "-m", "push_recovery", "evaluate", "--sute", "quick"],
        capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        "push-recovery: error: Unrecognized options: --sute, quick; did you mean --suite?\n"
    )
