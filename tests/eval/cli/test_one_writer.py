"""Every command that writes a directory leaves one alone that another run is writing to."""

import pytest
import toy_gait_env as toy
from push_recovery.eval.cli.main import main
from push_recovery.eval.output.rows import LOCK, Writer
from push_recovery.eval.score.suites import Suite, standard_suite

TOY = ("--env", toy.ENV_ID, "--suite", "SUITE", "--workers", "1")
PENDULUM = ("--env", "PushRecovery/Pendulum-v0", "--policies", "stage-1")
COMMANDS = {
    "evaluate": ("evaluate", *TOY, "--policies", "POLICY"),
    "profiles": ("evaluate", *TOY, "--policies", "POLICY", "--profile", "hardware", "exact"),
    "compare": ("compare", "POLICY", "random", *TOY),
    "sensitivity": ("sensitivity", *TOY, "--sample", "2", "--policies", "POLICY"),
    "frontier": ("frontier", *PENDULUM, "--directions", "1", "--workers", "1"),
    "reproduce": ("reproduce", "limits", "--workers", "1"),
    "tune": ("tune", *PENDULUM, "--trials", "1", "--workers", "1"),
}


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_second_writer_is_refused(tmp_path, capsys, name, overwrite):
    Suite("head", "1", standard_suite().scenarios[:2]).save(tmp_path / "suite.json")
    stands_for = {"SUITE": str(tmp_path / "suite.json")}
    stands_for["POLICY"] = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    words = [stands_for.get(word, word) for word in COMMANDS[name]]
    out = tmp_path / "out"
    place = out / "hardware" if name == "profiles" else out
    with Writer(place):
        assert main([*words, "--out", str(out), *(["--overwrite"] if overwrite else [])]) == 2
        assert [path.name for path in place.iterdir()] == [LOCK]
    (line,) = capsys.readouterr().err.splitlines()  # nothing is announced that will not be done
    assert line.startswith("push-recovery: error: another run (process ")
