"""Is it the contract or the policy? Told of a stander that balances by its ankles, whose contract is spoilt.

On stiff legs the biped is an inverted pendulum, m g h = 471 N m/rad, on ankles of 2 x 230 N m/rad: it falls,
unless its ankles are asked to push back as its base leans.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError
from push_recovery.envs.joint.full_body import driven
from push_recovery.envs.scenario.scenario import Command
from push_recovery.eval.cli.main import main
from push_recovery.eval.robot_tools import policy_check
from push_recovery.eval.robot_tools.policy_check import (
    Control,
    Controls,
    Diagnosis,
    Repair,
    find_fault,
    repairs,
    robot_of,
)
from push_recovery.eval.rollout.contract import DAMPING, GROUP, NAMES, SCALE, STIFFNESS, TERMS
from push_recovery.eval.rollout.contract_files import read_contract

onnx = pytest.importorskip("onnx")
pytest.importorskip("gaitkeeper")

LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
JOINTS = [f"{side}_{joint}" for side in ("left", "right") for joint in LEG]
GRAVITY_X, RATE_Y = (
    3,
    1,
)  # places in an observation of base_ang_vel (3), projected_gravity (3), joint_pos (12)
ANKLES = 4, 10
LEAN, TURN = 1.5, 0.1  # of the ankles' targets by lean and its rate [rad/rad], [rad s/rad]


@pytest.fixture
def stander(tmp_path):
    """Writes a network that asks the ankles to push back, and reads its contract."""

    def write(gain=1.0):
        weights = np.zeros((12, 18), np.float32)
        for ankle in ANKLES:  # toes down where the robot leans forward
            weights[ankle, GRAVITY_X], weights[ankle, RATE_Y] = gain * LEAN, gain * TURN
        shapes = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, size])
                  for name, size in (("obs", 18), ("actions", 12))]  # fmt: skip
        node = onnx.helper.make_node("Gemm", ["obs", "W"], ["actions"], transB=1)
        graph = onnx.helper.make_graph(
            [node], "policy", shapes[:1], shapes[1:], [onnx.numpy_helper.from_array(weights, "W")]
        )
        model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
        stiffness = [230.0 if i in ANKLES else 600.0 for i in range(12)]
        texts = {
            "joint_names": JOINTS, "joint_stiffness": stiffness, "joint_damping": [12.0] * 12,
            "default_joint_pos": [0.0, 0.0, -0.2, 0.4, -0.2, 0.0] * 2, "action_scale": [1.0] * 12,
            "observation_names": ["base_ang_vel", "projected_gravity", "joint_pos"],
        }  # fmt: skip
        for key, values in texts.items():
            entry = model.metadata_props.add()
            entry.key, entry.value = key, ",".join(map(str, values))
        path = tmp_path / f"stander-{gain:g}.onnx"
        onnx.save(model, str(path))
        (tmp_path / "deploy.yaml").write_text("step_dt: 0.01\n", encoding="utf-8")
        return read_contract(str(path))

    return write


@pytest.fixture(autouse=True)
def standing(monkeypatch):
    """Controls of one who cannot walk, short."""
    monkeypatch.setattr(policy_check, "CONTROLS", {"stand": Command()})
    monkeypatch.setattr(policy_check, "SECONDS", 4.0)


def with_sign(contract, term):
    other = contract.contract.copy()
    for one in other.get(f"{GROUP}.terms"):
        if one["id"] == term:
            one["scale"] = [-value for value in one["scale"]]
    return replace(contract, contract=other)


def test_a_stander_passes_falls_with_a_wrong_sign_and_that_is_found(stander):
    given, controls = stander(), Controls("biped")
    assert robot_of(given) == "biped"
    assert controls.run(given, Command(), 4.0).passed
    spoilt = with_sign(given, "projected_gravity")
    found = {"stand": controls.run(spoilt, Command(), 4.0)}
    assert found["stand"].fell_at < 2.0
    repair = find_fault(spoilt, controls, found)
    assert (repair.field, repair.what) == (f"{GROUP}.terms.projected_gravity.scale", "with the other sign")


def test_the_command_writes_the_contract_that_it_has_mended(stander, tmp_path, capsys):
    spoilt, mended = tmp_path / "spoilt.yaml", tmp_path / "mended.yaml"
    with_sign(stander(), "projected_gravity").write(spoilt)
    assert main(["policy", "check", str(spoilt), "--robot", "biped", "--out", str(mended)]) == 0
    assert f"contract: {mended}" in capsys.readouterr().out
    assert Controls("biped").run(read_contract(str(mended)), Command(), 4.0).passed
    field = f"{GROUP}.terms.projected_gravity.scale"
    assert Controls("biped").run(read_contract(str(spoilt), {field: 1.0}), Command(), 4.0).passed


def test_a_model_that_is_not_installed_is_named_where_no_other_robot_has_the_joints(stander, monkeypatch):
    given = stander()

    def model_of(name):
        if name == "g1":
            raise MissingExtraError("envpool-assets", "robots")
        return driven(name)

    monkeypatch.setattr(policy_check, "driven", model_of)
    assert robot_of(given) == "biped"
    monkeypatch.setattr(policy_check, "ROBOTS", ("g1",))
    with pytest.raises(MissingExtraError, match="envpool-assets"):
        robot_of(given)


def test_controls_load_a_network_in_torchscript_where_it_is_trusted(stander, tmp_path):
    torch = pytest.importorskip("torch")
    given, script = stander(gain=0.0), tmp_path / "policy.pt"
    torch.jit.save(torch.jit.script(torch.nn.Linear(18, 12, bias=False)), str(script))
    scripted = replace(given, network=script)
    with pytest.raises(InvalidValueError, match="frontier, protocol and policy check take --trust"):
        Controls("biped").run(scripted, Command(), 0.02)
    assert Controls("biped", trusted=True).run(scripted, Command(), 0.02).fell_at is None


def test_no_change_of_the_contract_lets_a_policy_stand_that_does_nothing(stander, monkeypatch):
    given, controls = stander(gain=0.0), Controls("biped")
    monkeypatch.setattr(policy_check, "repairs", lambda given: list(repairs(given))[::12])
    found = {"stand": controls.run(given, Command(), 4.0)}
    assert found["stand"].fell_at is not None
    assert find_fault(given, controls, found) is None


def test_repairs_change_one_thing_and_leave_the_contract_alone(stander):
    given = stander()
    before = given.contract.dump()
    tried = list(repairs(given))
    assert given.contract.dump() == before
    assert len({repair.contract.contract.dump() for repair in tried}) == len(tried)
    exchanged = [repair for repair in tried if repair.field == NAMES]
    assert len(exchanged) == 12 * 11 / 2
    assert all(sorted(one.contract.joints) == sorted(JOINTS) for one in exchanged)
    doubled = next(repair for repair in tried if repair.field == SCALE)
    assert set(doubled.contract.get(SCALE).values()) == {2.0}


@pytest.mark.parametrize(
    ("changes", "passed"),
    [
        ({}, True), ({"fell_at": 3.0}, False), ({"velocity": (0.65, 0.1)}, True),
        ({"velocity": (0.72, 0.0)}, False), ({"turn": 0.25}, False), ({"drift": 9.0}, True),
        ({"command": Command(), "velocity": (0.0, 0.0)}, True),
        ({"command": Command(), "velocity": (0.0, 0.0), "drift": 0.11}, False),
    ],
)  # fmt: skip
def test_a_control_is_passed_by_whoever_does_as_told(changes, passed):
    control = Control(Command(0.5), None, (0.5, 0.0), 0.0, 0.05)
    assert replace(control, **changes).passed == passed


def test_the_command_prints_fields_and_verdicts(stander, capsys, tmp_path):
    given, written = stander(), tmp_path / "contract.yaml"
    assert main(["policy", "inspect", given.name, "--out", str(written)]) == 0
    told = capsys.readouterr().out
    assert "control.actuators.kp" in told
    assert "ONNX metadata" in told
    assert read_contract(str(written)).joints == given.joints
    assert main(["policy", "check", str(written), "--robot", "biped", "--json"]) == 0
    assert '"verdict": "works"' in capsys.readouterr().out
    assert main(["policy", "inspect", given.name, "--set", "timing.policy_dt=0.003"]) == 2
    assert "timing.policy_dt of policy" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("c.txt", "--out must end in .yaml or .yml to be taken as a policy, got"),
        ("folder.yaml", "can't write to"),
        ("file/c.yaml", "its folder is a file"),
    ],
)
def test_a_contract_is_written_only_where_a_policy_can_be(stander, capsys, tmp_path, place, why):
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "file").touch()
    assert main(["policy", "inspect", stander().name, "--out", str(tmp_path / place)]) == 2
    error = capsys.readouterr().err
    assert why in error
    assert error.count("\n") == 1
    assert not (tmp_path / place).is_file()


def test_speeds_are_means_in_the_axes_of_the_heading_from_three_seconds_on(monkeypatch):
    """0.4 m/s on a circle of 0.8 m to the left; the chord of 7 s is 1.6 sin(1.75)."""

    def walked(env, policy, scenario, name, look):
        for t in np.arange(1001) * 0.01:
            a = 0.5 * t
            gait = SimpleNamespace(time=np.array([t]), heading=np.array([np.arctan2(np.sin(a), np.cos(a))]))
            com = np.array([[0.8 * np.sin(a), 0.8 * (1.0 - np.cos(a))]])
            look(SimpleNamespace(episodes=SimpleNamespace(core=SimpleNamespace(gait=gait, com=com))))
        return SimpleNamespace(survived=True, end_time=10.0)

    monkeypatch.setattr(policy_check, "rollout", walked)
    monkeypatch.setattr(policy_check, "Contender", lambda *_: None)
    env = SimpleNamespace(unwrapped=SimpleNamespace(episodes=None))
    monkeypatch.setattr(Controls, "_env", lambda *_: env)
    found = Controls("biped").run(None, Command(0.4, turn=0.5), 10.0)
    assert found.velocity == pytest.approx((0.4, 0.0), abs=2e-3)
    assert (found.turn, found.drift) == pytest.approx((0.5, 1.6 * np.sin(1.75)), abs=1e-6)


def test_a_repair_outlasts_the_first_look_and_passes_every_control(monkeypatch):
    monkeypatch.setattr(policy_check, "CONTROLS", {"stand": Command(), "forward": Command(0.5)})
    names = "falls", "strays", "works", "late"
    monkeypatch.setattr(policy_check, "repairs", lambda given: [Repair(name, "", name) for name in names])
    asked = []

    def run(contract, command, seconds):
        asked.append((contract, command.vx, seconds))
        off = 0.4 if contract == "strays" and command.vx else 0.0
        fell = 1.0 if contract == "falls" else None
        return Control(command, fell, (command.vx - off, 0.0), 0.0, 0.0)

    found = {"stand": Control(Command(), None, (0.0, 0.0), 0.0, 0.0),
             "forward": Control(Command(0.5), 2.0, (0.0, 0.0), 0.0, 0.0)}  # fmt: skip
    assert find_fault(None, SimpleNamespace(run=run), found).contract == "works"
    assert asked == [
        ("falls", 0.5, 3.0), ("strays", 0.5, 3.0), ("strays", 0.0, 4.0), ("strays", 0.5, 4.0),
        ("works", 0.5, 3.0), ("works", 0.0, 4.0), ("works", 0.5, 4.0),
    ]  # fmt: skip


def test_one_control_that_is_not_passed_is_the_contracts_or_the_policys_fault():
    good = Control(Command(), None, (0.0, 0.0), 0.0, 0.0)
    bad, mend = replace(good, fell_at=1.0), Repair("field", "what", None)
    cases = (good, None), (bad, mend), (bad, None)
    found = [Diagnosis({"stand": good, "forward": one}, repair).verdict for one, repair in cases]
    assert found[:2] == ["works", "contract at fault"]
    assert found[2].startswith("weak policy")


class Fields(dict):
    """What `repairs` asks of a contract's fields."""

    def set(self, key, value):
        self[key] = value


@dataclass(frozen=True)
class Given:
    contract: Fields
    joints: tuple = ()

    def get(self, key):
        return self.contract[key]


def test_a_clock_is_tried_with_other_periods_and_with_the_other_sign():
    terms = [{"id": "gait_phase", "scale": [1.0, 1.0], "dim": 2},
             {"id": "base_ang_vel", "scale": [0.25], "dim": 3}]  # fmt: skip
    name = f"{GROUP}.terms"
    tried = list(repairs(Given(Fields({name: terms, SCALE: {}, STIFFNESS: {}, DAMPING: {}}))))
    clocks = [one for one in tried if one.field.endswith("period")]
    periods = [(one.what, one.contract.get(name)[0]["params"]) for one in clocks]
    wanted = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2)
    assert periods == [(f"{period:g} s", {"period": period}) for period in wanted]
    (turned,) = [one for one in tried if one.field.endswith("gait_phase.scale")]
    assert (turned.what, turned.contract.get(name)[0]["scale"]) == ("with the other sign", [-1.0, -1.0])
    doubled = next(one for one in tried if one.field.endswith("base_ang_vel.scale"))
    assert (doubled.what, doubled.contract.get(name)[1]["scale"]) == ("times 2", [0.5, 0.5, 0.5])
    assert terms[0] == {"id": "gait_phase", "scale": [1.0, 1.0], "dim": 2}


@pytest.mark.parametrize("field", [STIFFNESS, DAMPING])
def test_gains_of_all_joints_are_tried_off_by_a_factor(field):
    gains = {STIFFNESS: {"hip": 40.0, "knee": 60.0}, DAMPING: {"hip": 2.0, "knee": 4.0}}
    tried = list(repairs(Given(Fields({TERMS: [], SCALE: {}, **gains}))))
    found = {one.what: one.contract for one in tried if one.field == field}
    assert list(found) == [f"times {factor}" for factor in ("2", "0.5", "4", "0.25", "10", "0.1")]
    other = DAMPING if field == STIFFNESS else STIFFNESS
    assert found["times 0.25"].get(field) == {name: 0.25 * value for name, value in gains[field].items()}
    assert found["times 0.25"].get(other) == gains[other]


def test_a_search_for_the_fault_says_what_it_tries_and_how_long_that_takes(monkeypatch, capsys):
    monkeypatch.setattr(policy_check, "repairs", lambda given: [Repair(name, "", name) for name in "ab"])
    found = {"stand": Control(Command(), 1.0, (0.0, 0.0), 0.0, 0.0)}
    falls = SimpleNamespace(run=lambda contract, command, seconds: found["stand"])
    assert find_fault(None, falls, found) is None
    said = capsys.readouterr().err
    assert said.startswith("it does not pass 'stand': 2 contracts that differ in one thing: a few seconds\n")


@pytest.mark.parametrize(("left", "passed"), [(0.3, True), (-0.3, False)])
def test_who_is_to_walk_left_walks_left(left, passed):
    assert Control(Command(0.0, 0.3), None, (0.0, left), 0.0, 1.0).passed is passed


@pytest.mark.parametrize(("turn", "passed"), [(0.5, True), (0.0, False), (-0.5, False), (0.8, False)])
def test_who_is_to_turn_turns_as_fast_and_that_way(turn, passed):
    assert Control(Command(turn=0.5), None, (0.0, 0.0), turn, 0.0).passed is passed
