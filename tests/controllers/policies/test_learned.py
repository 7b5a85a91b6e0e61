import dataclasses
import hashlib
import io
import json
import os
import pickle
import re
import struct
import sys
import tracemalloc
import zipfile

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription, ResidualBase
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.controllers.policies.residual import compose, default_residual_scale
from push_recovery.controllers.policies.two_stage import TwoStagePolicy
from push_recovery.controllers.settings import PlannerConfig


@dataclasses.dataclass
class Planted:
    """A pickle that makes a folder when it is loaded."""

    place: str

    def __reduce__(self):
        return os.mkdir, (self.place,)


SCALE = default_residual_scale(GaitLimits())


class SlopePolicy:
    """A planner's stand-in: a fixed function of the observation."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.tanh(np.asarray(observation)[..., :7]).astype(np.float32), None


def network(sizes=(36, 16, 16, 7), seed=0):
    rng = np.random.default_rng(seed)
    shapes = list(zip(sizes[1:], sizes[:-1], strict=True))
    weights = tuple(rng.normal(0, 1 / np.sqrt(i), (o, i)).astype(np.float32) for o, i in shapes)
    return Mlp(weights, tuple(rng.normal(0, 0.1, o).astype(np.float32) for o, _ in shapes))


def policy(hold=1, residual=True, sizes=(36, 16, 16, 7)):
    rng = np.random.default_rng(1)
    normalisation = Normalisation(rng.normal(size=sizes[0]), rng.uniform(0.1, 2.0, sizes[0]))
    base = ResidualBase("two-stage", "default", tuple(SCALE.tolist())) if residual else None
    about = PolicyDescription("PushRecovery/Pendulum-v0", RobotModel(), GaitLimits(), base, hold)
    return NetworkPolicy(network(sizes), normalisation, about, SlopePolicy() if residual else None)


OBSERVATIONS = np.random.default_rng(2).normal(size=(40, 36))


def test_batch_and_single_have_equal_bits():
    p = policy()
    batch, _ = p.predict(OBSERVATIONS)
    assert batch.shape == (40, 7)
    assert batch.dtype == np.float32
    for row, observation in zip(batch, OBSERVATIONS, strict=True):
        single, _ = p.predict(observation)
        assert single.tobytes() == row.tobytes()


def test_residual_composes_as_the_wrapper_does():
    p = policy()
    base, _ = SlopePolicy().predict(OBSERVATIONS)
    expected = compose(base, p.learned_action(OBSERVATIONS), SCALE)
    assert p.predict(OBSERVATIONS)[0].tobytes() == expected.tobytes()


def test_zero_network_is_the_base_bit_for_bit():
    p = policy()
    zero = Mlp(
        (*p.network.weights[:-1], 0 * p.network.weights[-1]),
        (*p.network.biases[:-1], np.zeros(7, np.float32)),
    )
    q = NetworkPolicy(zero, p.normalisation, p.description, SlopePolicy())
    assert q.predict(OBSERVATIONS)[0].tobytes() == SlopePolicy().predict(OBSERVATIONS)[0].tobytes()


def test_without_residual_the_network_acts_alone():
    p = policy(residual=False)
    action, _ = p.predict(10 * OBSERVATIONS)
    np.testing.assert_array_equal(action, p.learned_action(10 * OBSERVATIONS))
    assert np.all(np.abs(action) <= 1)


def test_hold_renews_the_learned_action_every_other_call_and_the_base_in_each():
    p = policy(hold=2)
    state, actions = None, []
    for observation in OBSERVATIONS[:6]:
        action, state = p.predict(observation, state)
        actions.append(action)
    base = SlopePolicy().predict(OBSERVATIONS[:6])[0]
    learned = p.learned_action(OBSERVATIONS[[0, 0, 2, 2, 4, 4]])
    np.testing.assert_array_equal(actions, compose(base, learned, SCALE))


def test_episode_start_renews_the_held_action_of_that_row_only():
    p = policy(hold=3)
    _, state = p.predict(OBSERVATIONS[:2])
    action, state = p.predict(OBSERVATIONS[2:4], state, episode_start=np.array([True, False]))
    learned = p.learned_action(OBSERVATIONS[[2, 1]])
    np.testing.assert_array_equal(
        action, compose(SlopePolicy().predict(OBSERVATIONS[2:4])[0], learned, SCALE)
    )
    with pytest.raises(InvalidValueError, match="state is of 2 episodes"):
        p.predict(OBSERVATIONS[:3], state)


def test_a_state_that_is_handed_in_stays_as_it_was():
    """So that an episode may go on from it more than once."""
    p = policy(hold=2)
    _, state = p.predict(OBSERVATIONS[:2])
    kept = [part.copy() for part in state]
    first, _ = p.predict(OBSERVATIONS[2:4], state, episode_start=np.array([True, False]))
    assert all((part == before).all() for part, before in zip(state, kept, strict=True))
    again, _ = p.predict(OBSERVATIONS[2:4], state, episode_start=np.array([True, False]))
    assert again.tobytes() == first.tobytes()


def test_the_learned_action_of_one_observation_is_a_row():
    learned = policy().learned_action(OBSERVATIONS[0])
    assert learned.shape == (7,)
    assert learned.tobytes() == policy().learned_action(OBSERVATIONS[:2])[0].tobytes()


def test_a_residuals_gate_is_a_band_of_two_rising_numbers():
    about = "two-stage", "default", tuple(SCALE.tolist())
    assert ResidualBase(*about, gate=[0, 1]).gate == (0.0, 1.0)
    for gate in ((0.2, 0.1), (0.1,), (-0.1, 0.1)):
        with pytest.raises(InvalidValueError, match="a residual gate is two numbers"):
            ResidualBase(*about, gate=gate)


def test_a_residual_is_renewed_with_its_own_rows_of_the_base_also_from_its_file(tmp_path):
    """Row 1 alone begins anew: its network sees its own base, and not that of row 0."""
    base = ResidualBase("two-stage", "default", tuple(SCALE.tolist()))
    about = PolicyDescription(
        "PushRecovery/Pendulum-v0", RobotModel(), GaitLimits(), base, 3, inputs=("observation", "base")
    )
    seen = Normalisation(np.zeros(43), np.ones(43))
    p = NetworkPolicy(network((43, 8, 7)), seen, about, SlopePolicy())
    _, state = p.predict(OBSERVATIONS[:2])
    action, _ = p.predict(OBSERVATIONS[2:4], state, episode_start=np.array([False, True]))
    np.testing.assert_array_equal(action[1], p.predict(OBSERVATIONS[3])[0])
    read = NetworkPolicy.load(p.save(tmp_path / "p"), SlopePolicy())
    assert read.predict(OBSERVATIONS)[0].tobytes() == p.predict(OBSERVATIONS)[0].tobytes()


def test_normalisation_clips():
    n = Normalisation(np.zeros(2), np.array([4.0, 0.0]), clip=3.0)
    np.testing.assert_allclose(n.apply(np.array([1.0, 1.0])), [0.5, 3.0], atol=1e-6)


@pytest.mark.parametrize("name", ["policy", "policy.json", "policy.safetensors", "a.b"])
def test_file_round_trip_keeps_every_bit(tmp_path, name):
    p = policy(hold=2)
    path = p.save(tmp_path / name, {"timesteps": 5})
    q = NetworkPolicy.load(tmp_path / name, base=SlopePolicy())
    assert q.description == p.description
    assert json.loads(path.with_suffix(".json").read_text())["training"] == {"timesteps": 5}
    assert q.predict(OBSERVATIONS)[0].tobytes() == p.predict(OBSERVATIONS)[0].tobytes()
    assert {f.name for f in tmp_path.iterdir()} == {path.name, path.with_suffix(".json").name}


def test_saving_again_replaces_the_pair(tmp_path):
    policy().save(tmp_path / "p")
    other = policy(residual=False)
    other.save(tmp_path / "p")
    assert NetworkPolicy.load(tmp_path / "p").description.residual is None


@pytest.mark.parametrize(
    "observation",
    [np.zeros(shape) for shape in (33, (2, 35), (1, 1, 36))]
    + [np.full(36, np.nan), np.float64(1.0), np.zeros(36, dtype=complex), [10**400] * 36],
)
def test_bad_observations_are_refused(observation):
    with pytest.raises(InvalidValueError, match="observation"):
        policy().predict(observation)


def test_another_robot_or_limits_are_refused():
    p = policy()
    p.check_made_for(RobotModel(), GaitLimits())
    with pytest.raises(InvalidValueError, match=r"made for another robot .*: mass 60 there and 70 here$"):
        p.check_made_for(RobotModel(mass=70.0), GaitLimits())
    with pytest.raises(
        InvalidValueError, match=r"made for other limits .*: length_max 0\.5 there and 0\.35 here$"
    ):
        p.check_made_for(RobotModel(), GaitLimits(length_max=0.35))


@pytest.mark.parametrize("hold", [0, -2, 1.5, True, "2"])
def test_impossible_holds_are_refused(hold):
    with pytest.raises(InvalidValueError, match="hold"):
        PolicyDescription("x", RobotModel(), GaitLimits(), hold=hold)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InvalidValueError, match=r"can't read the policy description .*nowhere.json"):
        NetworkPolicy.load(tmp_path / "nowhere.safetensors")
    path = policy().save(tmp_path / "p")
    path.unlink()
    with pytest.raises(InvalidValueError, match=r"can't read the policy weights .*p.safetensors"):
        NetworkPolicy.load(tmp_path / "p.json")


def edit(tmp_path, **changes):
    policy().save(tmp_path / "p")
    path = tmp_path / "p.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {"format": "other"},
        {"format_version": 99},
        {"format_version": [1]},
        {"activation": "gelu"},
        {"activation": ["tanh"]},
        {"output": "softmax"},
        {"hidden_sizes": [16, 17]},
        {"hidden_sizes": "wide"},
        {"observation_size": 33},
        {"action_size": True},
        {"observation_mean": [0.0] * 33},
        {"observation_mean": [float("nan")] * 36},
        {"observation_mean": "zero"},
        {"observation_variance": [-1.0] * 36},
        {"observation_clip": 0},
        {"hold": 0},
        {"env_id": 7},
        {"residual": {"policy": "two-stage"}},
        {"residual": {"policy": "two-stage", "preset": "default", "scale": [1, 2], "config": None}},
        {"residual": {"policy": 3, "preset": "default", "scale": [1] * 7, "config": None}},
        {"residual": {"policy": "two-stage", "preset": "default", "scale": [1] * 7, "config": {"alpha": 1}}},
        {"robot": {"mass": 60}},
        {"robot": dataclasses.asdict(RobotModel()) | {"mass": "heavy"}},
        {"limits": dataclasses.asdict(GaitLimits()) | {"duration_min": 2.0}},
        {"weights_sha256": "0"},
    ],
)
def test_a_damaged_description_is_refused(tmp_path, changes):
    path = edit(tmp_path, **changes)
    with pytest.raises(PushRecoveryError, match=r"p\.(json|safetensors)|policy"):
        NetworkPolicy.load(path, base=SlopePolicy())


HUGE = 10**400  # as JSON may have it; no float is so large
TOO_LARGE = f"1{'0' * 199}... (401 characters): no float is so large"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"observation_mean": [HUGE] * 36}, f"observation_mean[0] must be finite, got {TOO_LARGE}"),
        ({"observation_mean": ["0.1"] * 36}, "observation_mean[0] must be a number, got '0.1'"),
        ({"observation_variance": 1.0}, "observation_variance must be a list, got 1.0"),
        ({"observation_clip": HUGE}, f"observation_clip must be finite, got {TOO_LARGE}"),
        ({"observation_clip": True}, "observation_clip must be a number, got True"),
        ({"hold": 10**30}, f"hold [planning periods] must be an integer in [1, 10000], got {10**30}"),
        ({"training": [1]}, "training must be a dict, got [1]"),
        ({"inputs": "observation"}, "inputs must be a list, got 'observation'"),
        ({"inputs": ["observation", "foo"]},
         "unknown input of a network 'foo' (valid: observation, base, gate, margin)"),
        ({"observation_size": "36"}, "observation_size must be an integer >= 1, got '36'"),
        ({"hidden_sizes": 128}, "hidden_sizes must be a list, got 128"),
        ({"hidden_sizes": [16, True]}, "hidden_sizes[1] must be an integer >= 1, got True"),
    ],
)  # fmt: skip
def test_a_value_of_the_wrong_kind_is_named_by_its_key(tmp_path, changes, said):
    path = edit(tmp_path, **changes)
    with pytest.raises(InvalidValueError, match=f"^{re.escape(f'policy description {path}: {said}')}$"):
        NetworkPolicy.load(path, base=SlopePolicy())


def test_text_that_is_no_json_and_json_that_is_no_object(tmp_path):
    path = edit(tmp_path)
    for text in ("{", "[]", "", "\x00"):
        path.write_text(text)
        with pytest.raises(InvalidValueError, match=r"p\.json"):
            NetworkPolicy.load(path)


def test_a_base_policy_is_a_variant_by_name_and_never_a_module(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "foreign_code.py").write_text("raise SystemExit('imported')\n")
    for name in ("three-stage", "foreign_code:Policy"):
        residual = {"policy": name, "preset": "default", "scale": [1.0] * 7, "config": None, "gate": None}
        path = edit(tmp_path, residual=residual)
        with pytest.raises(UnknownNameError, match=f"unknown policy '{name}'"):
            NetworkPolicy.load(path)
    assert "foreign_code" not in sys.modules


def test_the_base_keeps_the_weights_of_its_training(tmp_path):
    config = PlannerConfig(beta_dcm=123.0, adapt_duration=False)
    p = policy()
    base = dataclasses.replace(p.description.residual, config=config)
    about = dataclasses.replace(p.description, residual=base)
    path = NetworkPolicy(p.network, p.normalisation, about).save(tmp_path / "p")
    loaded = NetworkPolicy.load(path)
    assert loaded.description.residual.config == config
    observations = OBSERVATIONS * 0.05
    expected = compose(
        TwoStagePolicy(RobotModel(), GaitLimits(), config).predict(observations)[0],
        loaded.learned_action(observations),
        SCALE,
    )
    assert loaded.predict(observations)[0].tobytes() == expected.tobytes()


def test_truncated_or_swapped_weights_are_refused(tmp_path):
    p = policy()
    path = p.save(tmp_path / "p")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InvalidValueError, match="SHA-256"):
        NetworkPolicy.load(path)
    garbage = b"\xff" * 64
    path.write_bytes(garbage)
    edited = json.loads(path.with_suffix(".json").read_text()) | {
        "weights_sha256": hashlib.sha256(garbage).hexdigest()
    }
    path.with_suffix(".json").write_text(json.dumps(edited))
    with pytest.raises(InvalidValueError, match="damaged"):
        NetworkPolicy.load(path)


@pytest.mark.parametrize("kind", ["pickle", "archive", "header beyond the file", "shape beyond the file"])
def test_weights_of_another_kind_run_nothing_and_take_no_memory(tmp_path, kind):
    path = policy().save(tmp_path / "p")
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("data", bytes(10**7))
    header = json.dumps(
        {"layers.0.weight": {"dtype": "F32", "shape": [2**31, 2**31], "data_offsets": [0, 4]}}
    ).encode()
    content = {
        "pickle": pickle.dumps(Planted(str(tmp_path / "ran"))),
        "archive": archive.getvalue(),
        "header beyond the file": struct.pack("<Q", 2**62) + b"{}",
        "shape beyond the file": struct.pack("<Q", len(header)) + header + bytes(4),
    }[kind]
    path.write_bytes(content)
    about = path.with_suffix(".json")
    edited = json.loads(about.read_text()) | {"weights_sha256": hashlib.sha256(content).hexdigest()}
    about.write_text(json.dumps(edited))
    tracemalloc.start()
    with pytest.raises(InvalidValueError, match=r"p\.safetensors are damaged"):
        NetworkPolicy.load(path)
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()
    assert not (tmp_path / "ran").exists()


def test_weights_that_are_not_finite_are_refused(tmp_path):
    net = network()
    with pytest.raises(InvalidValueError, match="layer 1"):
        Mlp((net.weights[0], np.full_like(net.weights[1], np.nan), net.weights[2]), net.biases)


def test_a_failed_save_leaves_the_old_policy(tmp_path):
    policy().save(tmp_path / "p")
    before = {f.name: f.read_bytes() for f in tmp_path.iterdir()}
    with pytest.raises(TypeError):
        policy(residual=False, sizes=(36, 8, 7)).save(tmp_path / "p", {"note": object()})
    assert {f.name: f.read_bytes() for f in tmp_path.iterdir()} == before


@pytest.mark.parametrize("reach", [0.0, 0.64])
def test_a_setting_that_is_gone_may_be_off_in_a_file(tmp_path, reach):
    config = dataclasses.asdict(PlannerConfig(beta_dcm=123.0)) | {"standing_reach": reach}
    scale = SCALE.tolist()
    residual = {"policy": "two-stage", "preset": "default", "scale": scale, "config": config, "gate": None}
    path = edit(tmp_path, residual=residual)
    if reach == 0.0:
        assert NetworkPolicy.load(path).description.residual.config == PlannerConfig(beta_dcm=123.0)
    else:
        with pytest.raises(InvalidValueError, match="planner config must be an object with the keys"):
            NetworkPolicy.load(path)


def test_standing_of_a_file_from_before_it_has_the_values_of_its_time(tmp_path):
    config = dataclasses.asdict(PlannerConfig(beta_dcm=123.0))
    del config["standing_horizon"], config["standing_carry"]
    scale = SCALE.tolist()
    residual = {"policy": "two-stage", "preset": "default", "scale": scale, "config": config, "gate": None}
    found = NetworkPolicy.load(edit(tmp_path, residual=residual)).description.residual.config
    assert (found.standing_horizon, found.standing_carry, found.beta_dcm) == (0.6, 0.1, 123.0)
