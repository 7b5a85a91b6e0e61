import itertools
import json
import math
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.model.robot import REFERENCE
from push_recovery.controllers.model.standing import max_standing_force
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent
from push_recovery.envs.scenario.scenario import EXACT, HARDWARE, Command, Scenario
from push_recovery.envs.scenario.terrain import Stairs
from push_recovery.eval.cli.main import main
from push_recovery.eval.score import draw, suites
from push_recovery.eval.score.suites import Suite, get_suite, with_errors

from push_recovery import evaluate

HASHES = {
    "quick": "097b1e7d0b180278e672a3c5b3188e772308763da713606b1a12dd05fbb2e286",
    "quick-1": "0088057972021e47bd61342cf850bf3d0120eb358a48d8450db6ab9a44c53994",
    "standard": "15074367172a91ada16f65e76634f228adf0d7db2f417e0482291f9f040a6dd2",
    "hard": "cdd2b5f0e7baec44f5df1fdc96da7b6a40507fb5584f449e17b36901d1b3bbb6",
    "varied": "89867e965aa664744a43e0acb9f16414dfe600ff59da6e5de770c083abe93507",
    "hardware": "cec4de3e3c0294d718f5bcded98e7bce4d58c06e51979a4a1c40589ba54cf50c",
    "standing": "6027ef5f93e141ad1b8ef673cdd5b33244a2c325f63a4f81e0b5bb5195e90bed",
    "disturbances": "eae7a295e2df2cc9367ec1f4f0863ccdb792b42680ee57f8505a3a17d9113b09",
    "terrain": "d77c60be64adf7a0f5175cfc958cf317c3f7a7edee0c7ba6ad33870cc39050d5",
    "terrain-blind": "faba633bef3648600a02c5bd8799d65b2fad0b1eb18f5780ba7aed08f9934ba6",
}


def test_content_hash_is_that_of_the_version():
    assert {name: get_suite(name).sha256 for name in HASHES} == HASHES
    versions = {name: get_suite(name).version for name in suites.SUITES if not name.endswith("sealed")}
    assert versions == {**dict.fromkeys(versions, "1"), "quick": "2"}


def test_quick_has_pushes_of_every_kind_up_to_harder_ones_and_was_the_head_of_standard():
    assert len(get_suite("standard").scenarios) == 1024
    assert get_suite("quick-1").scenarios == get_suite("standard").scenarios[:256]
    scenarios = get_suite("quick").scenarios
    assert len(scenarios) == 256
    assert Counter(map(draw.count_of, scenarios)) == {"single": 128, "double": 64, "repeated": 64}
    assert set(map(draw.walk_of, scenarios)) == {"in place", "forward", "backward", "sideways", "turning"}
    for body, least, most in (("pelvis", 50.0, 200.0), ("trunk", 30.0, 140.0)):
        single = [s.pushes[0] for s in scenarios if s.pushes[0].body == body and len(s.pushes) == 1]
        impulse = [push.impulse_magnitude for push in single]
        assert least <= min(impulse) < least + 10.0
        assert most - 10.0 < max(impulse) <= most
    others = {s.pushes for s in get_suite("varied").scenarios}
    assert not others & {s.pushes for s in scenarios}


def test_standing_reaches_from_the_no_step_region_to_twice_its_limit():
    """On the pendulum that suites are made for; half of the robots stand astride."""
    scenarios = get_suite("standing").scenarios
    assert len(scenarios) == 1024
    assert {s.command for s in scenarios} == {Command(stand=True)}
    assert Counter(s.stride != 0.0 for s in scenarios) == {True: 512, False: 512}
    single = [s for s in scenarios if len(s.pushes) == 1 and s.pushes[0].body == "pelvis" and not s.stride]
    shares = []
    for s in single:
        push = s.pushes[0]
        limit = max_standing_force(REFERENCE, push.direction, push.duration)
        shares.append(math.hypot(*push.force) / limit)
    assert 0.4 <= min(shares) < 0.45
    assert 1.95 < max(shares) <= 2.0 + 1e-4
    assert np.mean(np.array(shares) < 1.0) == pytest.approx(0.6 / 1.6, abs=0.05)


def test_a_registered_suite_is_found_by_its_name(monkeypatch, tmp_path):
    monkeypatch.setattr(suites, "SUITES", dict(suites.SUITES))
    made = []

    def mine() -> suites.Suite:
        made.append(1)
        return Suite("head", "1", get_suite("standard").scenarios[:2])

    suites.register_suite("mine", mine)
    assert not made
    found = evaluate("stage-1", suite="mine", env="PushRecovery/Pendulum-v0", out=tmp_path)
    assert found.suite == suites.get_suite("mine", "PushRecovery/Pendulum-v0") == mine()
    assert found.score("stage-1").episodes == 2
    assert len(made) == 2  # once by its name
    with pytest.raises(InvalidValueError, match="there is a suite 'mine' already"):
        suites.register_suite("mine", mine)
    with pytest.raises(InvalidValueError, match="a suite's name must be"):
        suites.register_suite("", mine)


@pytest.mark.parametrize(
    ("env", "name"),
    [("Biped-v0", "quick"), ("my_module:My-v0@file.json", "quick"), ("Pendulum-v0@paper", "quick-1")],
)
def test_what_is_run_where_no_suite_is_named(env, name):
    assert suites.default_suite(env if ":" in env else f"PushRecovery/{env}") == name


def test_hardware_has_the_pushes_of_varied_on_other_robots():
    """By the same ids and noise seeds, so that rows of either profile pair; the sealed two alike."""
    for name, real in (("varied", "hardware"), ("varied-sealed", "hardware-sealed")):
        pairs = zip(suites.get_suite(name).scenarios, suites.get_suite(real).scenarios, strict=True)
        assert all(HARDWARE.applied(a) == b for a, b in pairs)
        assert get_suite(real).name == real
        assert suites.with_profile(get_suite(name), HARDWARE) == get_suite(real)
    assert {s.sensing for s in get_suite("hardware").scenarios} == {"onboard"}


@pytest.mark.parametrize("kind", ["quick", "varied", "hard", "standing"])
def test_the_sealed_pushes_are_those_of_the_code(monkeypatch, kind):
    """And of the shipped policies: no push of one state of these two is met by another."""
    drawn, name, like = [], f"{kind}-sealed", suites.get_suite(kind)
    make: Any = suites.SUITES[name]
    for code, policies in (("1", "1"), ("2", "1"), ("1", "1"), ("1", "2")):
        monkeypatch.setattr(suites, "code_digest", lambda digest=code: digest)
        monkeypatch.setattr(suites, "shipped_digest", lambda digest=policies: digest)
        make.cache_clear()
        drawn.append(suites.get_suite(name))
    make.cache_clear()
    assert drawn[0] == drawn[2]
    assert len(drawn[0].scenarios) == 1024
    assert len(like.scenarios) == (256 if kind == "quick" else 1024)
    pushes = [{s.pushes for s in suite.scenarios} for suite in (drawn[0], drawn[1], drawn[3], like)]
    for i, j in itertools.combinations(range(4), 2):
        assert not pushes[i] & pushes[j]
    assert drawn[0].scenarios[0].id == f"{name}-0000"
    for of in (min, max):
        ends = [
            of(max(push.impulse_magnitude for push in s.pushes) for s in suite.scenarios)
            for suite in (drawn[0], like)
        ]
        assert ends[0] == pytest.approx(ends[1], abs=3.0)


def test_field_of_16_elements():
    for a in range(1, 16):
        assert sorted(draw.gf16_multiply(a, b) for b in range(16)) == list(range(16))
        for b, c in itertools.product(range(16), repeat=2):
            assert draw.gf16_multiply(a, b ^ c) == draw.gf16_multiply(a, b) ^ draw.gf16_multiply(a, c)


def test_orthogonal_array_has_every_pair_once():
    array = draw.orthogonal_array(8)
    for i, j in itertools.combinations(range(8), 2):
        assert len(set(zip(array[:, i], array[:, j], strict=True))) == 256


def test_stratified_points_fill_every_interval():
    points = draw.stratified_uniforms(blocks=4, factors=5, seed=3)
    assert points.shape == (1024, 5)
    for factor in range(5):
        assert len(set((points[:, factor] * 1024).astype(int))) == 1024
    for block in points.reshape(4, 256, 5):
        for factor in range(5):
            assert len(set((block[:, factor] * 256).astype(int))) == 256
        for i, j in itertools.combinations(range(5), 2):
            assert len({tuple(cell) for cell in (block[:, [i, j]] * 16).astype(int)}) == 256


@pytest.mark.parametrize(
    ("name", "least", "most"), [("quick-1", 5, 80), ("standard", 5, 80), ("hard", 80, 200)]
)
def test_suite_covers_its_ranges_evenly(name, least, most):
    scenarios = suites.get_suite(name).scenarios
    pushes = [s.pushes[0] for s in scenarios]
    assert all(
        len(s.pushes) == 1 and p.duration == 0.1 and p.body == "pelvis"
        for s, p in zip(scenarios, pushes, strict=True)
    )
    impulse = np.array([p.impulse_magnitude for p in pushes])
    assert least - 1e-3 <= impulse.min() < least + 0.5
    assert most - 0.5 < impulse.max() <= most + 1e-3
    counts = np.histogram(impulse, bins=16, range=(least, most))[0]
    assert np.ptp(counts) <= 2
    sectors = np.histogram([p.direction for p in pushes], bins=16, range=(-math.pi, math.pi))[0]
    assert np.ptp(sectors) <= 2
    fractions = np.array([p.start.fraction for p in pushes])
    assert np.ptp(np.histogram(fractions, bins=9, range=(0, 0.9))[0]) <= 2
    assert all(s.pushes[0].start.step_index(s.stance_side) >= 4 for s in scenarios)
    sides = [(s.stance_side, s.pushes[0].start.side) for s in scenarios]
    assert {sides.count(pair) for pair in set(sides)} == {len(scenarios) // 4}
    vx, vy = (np.array([getattr(s.command, axis) for s in scenarios]) for axis in ("vx", "vy"))
    quarter = len(scenarios) // 4
    assert np.sum((vx == 0) & (vy == 0)) == pytest.approx(quarter, abs=2)
    assert np.sum(vx > 0) == pytest.approx(quarter, abs=1)
    assert np.sum(vx < 0) == pytest.approx(quarter, abs=1)
    assert np.sum(vy > 0) == pytest.approx(quarter / 2, abs=2)
    assert (vx.max(), vx.min()) == pytest.approx((0.5, -0.25), abs=0.02)
    assert np.abs(vy).max() == pytest.approx(0.2, abs=0.01)


def test_file_round_trip_and_tampering(tmp_path):
    off = suites.with_errors(get_suite("quick"), ModelErrors(friction=0.6, delay=0.01))
    suite = Suite("mine", "3", off.scenarios[:4])
    path = tmp_path / "mine.json"
    suite.save(path)
    assert suites.load_suite(path) == suite
    assert get_suite(str(path)).sha256 == suite.sha256

    content = json.loads(path.read_text())
    content["scenarios"][2]["pushes"][0]["force"][0] += 1.0
    path.write_text(json.dumps(content))
    with pytest.raises(InvalidValueError, match=suite.sha256):
        suites.load_suite(path)
    del content["sha256"]
    path.write_text(json.dumps(content))
    assert suites.load_suite(path).sha256 != suite.sha256


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"name": "a", "version": "1", "scenarios": []}', '{"name": 1}']
)
def test_bad_files_are_errors_of_this_package(tmp_path, text):
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(PushRecoveryError):
        suites.get_suite(str(path))


PUSHED = {"id": "b", "pushes": [{"force": [50, 0, 0], "duration": 0.1, "start": 0.5}]}
NAMED = "must be 1 to 1000 letters, digits, spaces and ._+=,@- that begin with a letter or digit, got"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": None}, f"a suite's name {NAMED} None"),
        ({"name": True}, f"a suite's name {NAMED} True"),
        ({"version": 1.5}, f"a suite's version {NAMED} 1.5"),
        ({"scenarios": [{"id": "a"}, {**PUSHED, "settle_time": -1.0}]},
         "suite file {path!r}, scenario 2 ('b'): Scenario.settle_time [s] must be in (0, 1e+06], got -1"),
        ({"scenarios": [{"id": "a"}, {"speed": 1}]}, "suite file {path!r}, scenario 2: scenario lacks id"),
        ({"scenarios": [{"id": "\ud800"}]}, "suite file {path!r}, scenario 1 ('\\ud800'): "
         "Scenario.id must be 1 to 1000 printable characters, got '\\ud800'"),
        ({"scenarios": [{**PUSHED, "duration": 0.2}]},
         "Scenario.duration [s] of 'b' must be more than the start of its first push at 0.5, got 0.2"),
    ],
)  # fmt: skip
def test_a_bad_entry_is_named_with_its_place(tmp_path, change, message):
    path = tmp_path / "bad.json"
    path.write_text(json.dumps({"name": "a", "version": "1", "scenarios": [PUSHED], **change}))
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message.format(path=str(path)))}$"):
        suites.load_suite(path)


def test_a_push_may_come_at_a_gait_event_or_just_before_the_end(tmp_path):
    path, event = tmp_path / "good.json", GaitEvent(4, "left").to_dict()
    late = {**PUSHED, "id": "c", "duration": 0.1, "pushes": [{**PUSHED["pushes"][0], "start": event}]}
    scenarios = [{"id": "a", "duration": 0.1}, {**PUSHED, "duration": 0.51}, late]
    path.write_text(json.dumps({"name": "a", "version": "1", "scenarios": scenarios}))
    assert [scenario.id for scenario in suites.load_suite(path).scenarios] == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Suite("a", "1", (3,)), "Suite.scenarios must hold Scenario objects, got 3"),  # type: ignore[arg-type]
        (lambda: Suite("a", "1", 3), "Suite.scenarios must be a sequence of Scenario, got 3"),  # type: ignore[arg-type]
        (lambda: suites.register_suite("mine", 5),  # type: ignore[arg-type]
         "maker must be a function that gives a Suite, got 5"),
        (lambda: suites.register_suite("a.json", lambda: Suite("a", "1", ())),
         "a suite's name must not end in .json, as that of a file does, got 'a.json'"),
        (lambda: suites.new_suite("hard", 1, 4, None, [1]), "pushes must be a Mapping, got [1]"),  # type: ignore[arg-type]
        (lambda: suites.new_suite("hard", 1, 4, ""), f"a suite's name {NAMED} ''"),
    ],
)  # fmt: skip
def test_what_is_no_part_of_a_suite_is_refused(make, message):
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}$"):
        make()


def test_unknown_names_list_the_valid_ones(tmp_path):
    with pytest.raises(UnknownNameError, match="quick, standard"):
        suites.get_suite("quik")
    with pytest.raises(InvalidValueError, match=r"absent\.json"):
        suites.get_suite(str(tmp_path / "absent.json"))
    with pytest.raises(InvalidValueError, match="more than once"):
        suites.Suite("twice", "1", suites.get_suite("quick").scenarios[:1] * 2)


def test_a_suite_with_errors_has_its_own_name_and_hash_and_the_same_pushes():
    errors = ModelErrors(mass=0.1, trunk_com=(0.0, 0.01, 0.0))
    off = suites.with_errors(get_suite("quick"), errors)
    assert off.name == "quick+mass=0.1+trunk_com=0.0,0.01,0.0"
    heavier = suites.with_errors(get_suite("quick"), ModelErrors(mass=0.2))
    assert off.sha256 not in {HASHES["quick"], heavier.sha256}
    for before, after in zip(get_suite("quick").scenarios, off.scenarios, strict=True):
        assert after == replace(before, errors=errors)
        assert before.errors == ModelErrors()
    assert suites.with_errors(get_suite("quick"), ModelErrors()) is get_suite("quick")
    with pytest.raises(InvalidValueError, match="has model errors already: scenario 'quick-0000' has"):
        suites.with_errors(off, errors)


@pytest.mark.parametrize(
    "name", ["../../../x", "/x", "a/b", "a\\b", "", ".hidden", "a\0b", "\x1b[31mred", "x" * 1001, 3, "\udce9"]
)
def test_a_suites_name_is_no_path_and_holds_no_control_characters(name):
    with pytest.raises(InvalidValueError, match="a suite's name must be"):
        suites.Suite(name, "1", suites.get_suite("quick").scenarios[:1])
    with pytest.raises(InvalidValueError, match="a suite's version must be"):
        suites.Suite("mine", name, suites.get_suite("quick").scenarios[:1])


def test_a_suite_of_a_profile_keeps_ids_and_has_a_hash_of_its_own():
    suite = Suite("few", "1", get_suite("quick").scenarios[:3])
    assert suites.with_profile(suite, EXACT) is suite
    real = suites.with_profile(suite, HARDWARE)
    assert real.name == "few+hardware"
    assert real.sha256 != suite.sha256
    assert [s.id for s in real.scenarios] == [s.id for s in suite.scenarios]
    assert [s.pushes for s in real.scenarios] == [s.pushes for s in suite.scenarios]
    assert {s.errors.joint_friction for s in real.scenarios} == {1.0}
    heavy = suites.with_profile(suites.with_errors(suite, ModelErrors(mass=0.1)), HARDWARE)
    assert heavy.name == "few+mass=0.1+hardware"
    assert {(s.errors.mass, s.errors.armature) for s in heavy.scenarios} == {(0.1, 0.03)}


@pytest.mark.parametrize("like", suites.KINDS)
def test_a_suite_follows_from_its_seed(like):
    first, again, other = (suites.new_suite(like, seed, 20) for seed in (1, 1, 2))
    assert first == again
    assert (first.name, len(first.scenarios)) == (f"{like}-1", 20)
    drawn, others = ({(s.forces, s.errors) for s in suite.scenarios} for suite in (first, other))
    assert not drawn & others


@pytest.mark.parametrize(
    ("like", "seed"),
    [
        ("quick", suites.QUICK_SEED), ("standard", suites.SEED), ("hard", suites.HARD_SEED),
        ("varied", suites.VARIED_SEED), ("standing", suites.STANDING_SEED), ("shift-floor", 20261207),
        ("disturbances", suites.DISTURBANCES_SEED), ("terrain", suites.TERRAIN_SEED),
    ],
)  # fmt: skip
def test_the_draw_is_that_of_the_named_suite(like, seed):
    named = get_suite(like).scenarios
    assert suites.new_suite(like, seed, len(named), like).scenarios == named


def test_other_ranges():
    ranges = {"impulse_min": 150.0, "impulse_max": 180.0, "push_duration": 0.2}
    pushes = [s.pushes[0] for s in suites.new_suite("hard", 3, 256, pushes=ranges).scenarios]
    assert {push.duration for push in pushes} == {0.2}
    assert min(push.impulse_magnitude for push in pushes) == pytest.approx(150.0, abs=0.2)
    assert max(push.impulse_magnitude for push in pushes) == pytest.approx(180.0, abs=0.2)


@pytest.mark.parametrize(
    "pushes",
    [
        {"direction_min": 0.0}, {"errors": {}}, {"impuls": 1.0}, {"turn": 0.1}, {"bodies": ["trunk"]},
        {"push_duration_ratio": 2.0}, {"pushes_max": 2},
    ],
)  # fmt: skip
def test_ranges_that_would_do_nothing_are_refused(pushes):
    with pytest.raises((InvalidValueError, UnknownNameError)):
        suites.new_suite("hard", 3, pushes=pushes)


@pytest.mark.parametrize(
    ("like", "asked", "words"),
    [
        ("shift-boddy", {}, "shift-body"),
        ("varied", {"pushes": {"impulse_min": 10.0}}, "'varied'"),
        ("varied", {"scenarios": 0}, "scenarios"),
        ("hard", {"pushes": {"impulse_min": 300.0}}, "impulse_max"),
    ],
)
def test_what_cannot_be_drawn(like, asked, words):
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        suites.new_suite(like, **asked)


def test_the_command_writes_what_evaluate_reads(tmp_path, capsys):
    path = tmp_path / "mine.json"
    argv = ["suite", "new", "--seed", "5", "--like", "shift-model", "--scenarios", "8", "--out", str(path)]
    assert main([*argv, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {**suites.load_suite(path).summary(), "out": str(path)}
    assert get_suite(str(path)) == suites.new_suite("shift-model", 5, 8)
    assert main(["suite", "new", "--seed", "5", "--pushes", "[1]", "--out", str(path)]) == 2
    assert "JSON object" in capsys.readouterr().err


def test_a_suite_on_stairs_is_named_after_them():
    suite = Suite("few", "1", (Scenario("a"),))
    names = []
    for rise in (0.1, 0.05):
        on_stairs = with_errors(suite, ModelErrors(terrain=Stairs(rise=rise, steps=3, tread=0.35)))
        assert on_stairs.scenarios[0].errors.terrain == Stairs(rise=rise, steps=3, tread=0.35)
        names.append(on_stairs.name)
    assert all(name.startswith("few+terrain=stairs-") for name in names)
    assert len(set(names)) == 2


def test_the_page_of_hashes_tells_those_of_todays_suites():
    page = (Path(__file__).parents[3] / "docs/generated/suites.md").read_text(encoding="utf-8")
    stated = re.findall(r"^\| `([\w-]+)` \| (\d+) \| (\d+) \| `([0-9a-f]{64})` \|$", page, flags=re.M)
    assert {name for name, *_ in stated} == {name for name in suites.SUITES if not name.endswith("sealed")}
    for name, *told in stated:
        if name in HASHES:
            assert told[2] == HASHES[name], name
            continue
        suite = get_suite(name)
        assert told == [str(len(suite.scenarios)), suite.version, suite.sha256], name
