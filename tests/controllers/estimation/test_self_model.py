"""Friction and rotors of the legs' joints: least squares on made-up motion, the biped's rows, its walk.

What the biped learns of its mass, a steady force and its floor; nothing where nothing is to be learned.

Rules of what a robot learns of itself, on numbers written by hand.
"""

import math

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.estimation import self_model as rules
from push_recovery.controllers.model.observation import COM, COM_HEIGHT_ERROR, DCM, PUSH_ESTIMATE
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import LEG_DOF
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_GAINS, BIPED_GAIT, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.biped import biped_model
from push_recovery.envs.scenario.model_errors import STEEPEST_SLOPE, ModelErrors
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, Scenario
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.tuning.pushes import preset_episodes
from scipy.signal import lfilter

DT, RATE, MEMORY = 0.002, 100.0, 2.0
MODEL = biped_model()


def motion(seconds: float = 0.6, seed: int = 3):
    """Rates and accelerations of a joint that never rests."""
    t, phase = np.arange(0.0, seconds, DT), np.random.default_rng(seed).uniform(0.0, 6.0)
    rate = 2.0 * np.sin(9.0 * t + phase) + 0.7 * np.sin(31.0 * t)
    return np.where(np.abs(rate) < 0.03, 0.03, rate), np.gradient(rate, DT)


def told(rate, acceleration, lost) -> np.ndarray:
    """Row of a joint that has moved so."""
    joint = np.zeros(rules.LOSS_SIZE)
    for v, a, r in zip(rate, acceleration, lost, strict=True):
        rules.take_in(joint, r, v, a, DT)
    return joint


@pytest.mark.parametrize(("friction", "rotor"), [(1.0, 0.0), (0.0, 0.03), (0.7, 0.05), (4.0, 0.01)])
def test_the_least_squares_are_those_of_scipys_filter_and_numpys_solution(friction, rotor):
    rate, acceleration = motion()
    sign = np.clip(rate / 0.1, -1.0, 1.0)
    noise = np.random.default_rng(1).normal(0.0, 0.5, len(rate))
    lost = friction * sign + rotor * acceleration + noise
    joint = told(rate, acceleration, lost)
    rules.conclude(joint)

    share = 1.0 - np.exp(-RATE * DT)
    r, s, a = (lfilter([share], [1.0, share - 1.0], x) for x in (lost, sign, acceleration))
    weight = np.sqrt(DT * np.exp(-DT / MEMORY * np.arange(len(rate))[::-1]))
    rows = np.vstack([np.column_stack([s, a]) * weight[:, None], np.diag(np.sqrt([0.02, 2.0]))])
    expected = np.linalg.lstsq(rows, np.append(r * weight, [0.0, 0.0]), rcond=None)[0]
    expected = np.where(expected < [0.2, 0.005], 0.0, expected)
    np.testing.assert_allclose(joint[[rules.FRICTION, rules.ROTOR]], expected, rtol=1e-9)
    np.testing.assert_allclose(joint[[rules.FRICTION, rules.ROTOR]], [friction, rotor], rtol=0.08, atol=0.002)
    assert not joint[:3].any()  # the next swing's filters begin anew


@pytest.mark.parametrize(
    ("friction", "rotor", "believed"),
    [(0.15, 0.004, (0.0, 0.0)), (-1.0, -0.05, (0.0, 0.0)), (7.0, 0.0, (5.0, 0.0)), (0.0, 0.4, (0.0, 0.2))],
)
def test_too_little_and_less_than_nothing_count_as_none_and_too_much_as_the_most(friction, rotor, believed):
    rate, acceleration = motion()
    acceleration = np.clip(acceleration, -20.0, 20.0)  # below the torque of a blow
    joint = told(rate, acceleration, friction * np.sign(rate) + rotor * acceleration)
    rules.conclude(joint)
    assert (joint[rules.FRICTION], joint[rules.ROTOR]) == pytest.approx(believed, abs=1e-12)


def test_a_blow_and_a_joint_at_rest_tell_nothing():
    joint = told([1.0] * 20, [5.0] * 20, [1.0] * 20)
    before = joint.copy()
    rules.take_in(joint, 2.0, 0.019, 50.0, DT)
    np.testing.assert_array_equal(joint[3:], before[3:])  # but the filters go on
    assert joint[rules.LOST] > before[rules.LOST]
    rules.take_in(joint, 1e3, 1.0, 5.0, DT)
    np.testing.assert_array_equal(joint[3:], before[3:])
    assert not joint[:3].any()


def test_the_direction_of_a_rate_is_its_sign_but_for_slow_ones():
    assert [rules.direction(v) for v in (-3.0, -0.1, -0.05, 0.0, 0.02, 0.1, 5.0)] == pytest.approx(
        [-1.0, -1.0, -0.5, 0.0, 0.2, 1.0, 1.0]
    )


@pytest.mark.parametrize("leg", [0, 1])
def test_what_a_leg_loses_is_what_its_motors_give_beyond_mujocos_m_and_h(random_state, robot_in, leg):
    rng = np.random.default_rng(8 + leg)
    core, data = robot_in(*random_state(rng))
    physics, qdd, lost = core.physics, rng.normal(0.0, 20.0, 20), rng.uniform(-3.0, 3.0, 6)
    needed, joints, before = np.empty(20), np.zeros((1, 14, rules.LOSS_SIZE)), np.zeros((1, rules.BEFORE))
    mujoco.mj_mulM(MODEL, data, needed, qdd)
    needed += data.qfrc_bias
    rows = slice(LEG_DOF[leg] - 6, LEG_DOF[leg])
    rules.keep_leg(before, physics, 0, leg)
    physics.ctrl[0] = needed[6:]
    physics.ctrl[0, rows] += lost
    physics.qvel[0] += DT * qdd
    rules.feel_swing(joints, before, physics, 0, leg, DT)
    share = 1.0 - np.exp(-RATE * DT)
    np.testing.assert_allclose(joints[0, rows, rules.LOST], share * lost, atol=1e-8)
    np.testing.assert_allclose(joints[0, rows, 2], share * qdd[LEG_DOF[leg] : LEG_DOF[leg] + 6], rtol=1e-9)
    assert np.count_nonzero(joints.any(axis=2)) == 6


def test_losses_are_added_to_mass_matrix_and_bias(random_state, robot_in):
    core, data = robot_in(*random_state(np.random.default_rng(5)))
    physics, joints = core.physics, np.zeros((1, 14, rules.LOSS_SIZE))
    joints[0, :, rules.FRICTION], joints[0, :, rules.ROTOR] = np.arange(14.0), 0.01 * np.arange(14.0)
    rules.add_losses(joints, physics, 0)
    mass, full = np.empty((20, 20)), np.empty((20, 20))
    mujoco.mj_fullM(MODEL, data, mass)
    data.M[:] = physics.mass_matrix[0]
    mujoco.mj_fullM(MODEL, data, full)
    legs = np.r_[np.zeros(8), np.arange(2.0, 14.0)]  # the waist's are left out
    np.testing.assert_allclose(full - mass, np.diag(0.01 * legs), atol=1e-12)
    sign = np.clip(data.qvel / 0.1, -1.0, 1.0)
    np.testing.assert_allclose(physics.bias[0] - data.qfrc_bias, legs * sign, atol=1e-9)


def test_a_leg_tells_only_in_the_air_and_concludes_as_it_has_landed(random_state, robot_in):
    core, _ = robot_in(*random_state(np.random.default_rng(6)), stance=1)
    physics, gait = core.physics, core.gait
    joints, before = np.zeros((1, 14, rules.LOSS_SIZE)), np.zeros((1, rules.BEFORE))
    gait.elapsed[0], physics.load[0] = 0.1, (30.0, 500.0)
    rules.feel_joints(joints, before, physics, gait, 0, DT)
    assert not joints.any()
    physics.load[0, 0] = 0.0
    rules.feel_joints(joints, before, physics, gait, 0, DT)
    assert joints[0, 2:8, :3].any(axis=1).all()
    assert not joints[0, 8:].any()
    joints[0, :, 0] = 1.0
    gait.stance[0], gait.elapsed[0] = 0, DT
    rules.feel_joints(joints, before, physics, gait, 0, DT)
    assert joints[0, :, 0].tolist() == [1.0] * 2 + [0.0] * 6 + [1.0] * 6


def walk(errors: ModelErrors, seconds: float = 6.0):
    """What a walk at 0.3 m/s finds, (14,) frictions and rotors, and its speed over the second half [m/s]."""
    episodes = preset_episodes("PushRecovery/Biped-v0", 1, "biped", "two-stage")
    policy, places = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped"), []
    episodes.core.after_physics_step = lambda: places.append(float(episodes.core.judged.qpos[0, 0]))
    scenario = Scenario("walk", command=Command(0.3), duration=seconds, errors=errors)
    (outcome,) = rollout_batch(episodes, policy, [scenario], "two-stage")
    assert outcome.survived
    half = len(places) // 2
    known = episodes.core.known.joints[0]
    return (
        known[:, rules.FRICTION],
        known[:, rules.ROTOR],
        (places[-1] - places[half]) / (DT * (len(places) - 1 - half)),
    )


def test_an_exact_robot_finds_nothing():
    friction, rotor, speed = walk(ModelErrors())
    assert not friction.any()
    assert not rotor.any()
    assert speed == pytest.approx(0.3, abs=0.03)


def test_a_walk_finds_the_friction_of_hip_knee_and_ankle_and_keeps_its_speed():
    friction, _, speed = walk(ModelErrors(joint_friction=1.0))
    for first in (2, 8):
        np.testing.assert_allclose(friction[first + 1 : first + 5], 1.0, atol=0.1)
    assert not friction[:2].any()
    assert speed == pytest.approx(0.3, abs=0.05)  # 0.15 m/s where nothing is found


def test_a_walk_finds_a_heavier_rotor():
    _, rotor, speed = walk(ModelErrors(armature=0.03))
    for first in (2, 8):
        np.testing.assert_allclose(rotor[first + 2 : first + 5], 0.03, atol=0.003)
    assert speed == pytest.approx(0.3, abs=0.03)


def test_on_the_hardware_profile_it_walks_within_what_recovered_allows():
    friction, _, speed = walk(HARDWARE.applied(Scenario("x")).errors)
    np.testing.assert_allclose(friction[[3, 5, 6, 9, 11, 12]], 1.0, atol=0.15)
    assert speed == pytest.approx(0.3, abs=0.06)


POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
PERIOD = 0.01  # [s]


def self_model_walk(core, begin, seconds: float, *pushes: Push, command=(0.0, 0.0), **errors):
    """Walk for so long; returns the mean velocity in the world over the second half [m/s] (2,)."""
    begin(core, 0, Scenario("a", pushes, Command(*command), errors=ModelErrors(**errors)))
    places = []
    for _ in range(round(seconds / PERIOD)):
        action = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))
        places.append(core.simulations.data[0].subtree_com[0].copy())
    assert core.gait.failure[0] == 0
    half = len(places) // 2
    return (places[-1] - places[half])[:2] / ((len(places) - 1 - half) * PERIOD)


@pytest.mark.parametrize("mass", [-0.3, -0.1, 0.1, 0.3])
def test_a_walking_robot_weighs_itself(biped_core, begin, mass):
    core = biped_core()
    self_model_walk(core, begin, 4.0)
    height = core.truth[0, COM_HEIGHT_ERROR]
    self_model_walk(core, begin, 4.0, mass=mass)
    assert core.known.mass[0] == pytest.approx(1.0 + mass, abs=2e-3)
    sag = GRAVITY * abs(mass) / BIPED_GAINS.height_kp  # of the CoM, were it carried with the model's mass
    assert abs(core.truth[0, COM_HEIGHT_ERROR] - height) < 0.2 * sag


def test_a_payload_counts_as_mass(biped_core, begin):
    core = biped_core()
    self_model_walk(core, begin, 4.0, payload=5.0)
    assert core.known.mass[0] == pytest.approx(65.0 / 60.0, abs=2e-3)


@pytest.mark.parametrize("mass", [-0.1, 0.1])
def test_with_its_mass_found_it_walks_at_the_speed_of_the_nominal_robot(biped_core, begin, mass):
    core, command = biped_core(), (0.4, 0.1)
    nominal = self_model_walk(core, begin, 5.0, command=command)
    np.testing.assert_allclose(
        self_model_walk(core, begin, 5.0, command=command, mass=mass), nominal, atol=0.02
    )


@pytest.mark.parametrize("slopes", [(0.05, 0.0), (0.0, -0.05), (0.03, 0.04)])
def test_it_walks_in_place_on_a_slope(biped_core, begin, slopes):
    """The steady force is m g tan(slope) downhill, -h tan(slope) over m omega^2."""
    core = biped_core()
    velocity = self_model_walk(core, begin, 8.0, slope_forward=slopes[0], slope_left=slopes[1])
    np.testing.assert_allclose(velocity, 0.0, atol=0.03)  # 0.3 where nothing is learned
    np.testing.assert_allclose(core.known.drift[0], -BIPED.com_height * np.tan(slopes), atol=3e-3)


@pytest.mark.parametrize("command", [Command(), Command(0.3, 0.1), Command(0.3, turn=0.1)], ids=str)
@pytest.mark.parametrize("slopes", [(STEEPEST_SLOPE, 0.0), (0.0, STEEPEST_SLOPE)])
def test_an_undisturbed_walk_on_the_steepest_slope_counts_as_recovered(slopes, command):
    """The DCM is 7 cm from the level's nominal gait: beyond the tolerance of 5 cm."""
    episodes = BipedEpisodes(1)
    errors = ModelErrors(slope_forward=slopes[0], slope_left=slopes[1])
    episodes.begin(0, Scenario("a", (), command, duration=6.0, errors=errors))
    while not (period := episodes.step(POLICY.predict(episodes.core.observation)[0])).truncated[0]:
        assert not period.failed[0]
    assert episodes.monitor.recovered_at(0) is not None
    assert episodes.monitor.recovered_at(0) < 4.0
    assert episodes.monitor.state.error[0].max() < (0.02 if command.turn else 0.003)


def test_what_is_seen_is_moved_by_the_drift(biped_core, begin):
    core = biped_core()
    self_model_walk(core, begin, 5.0, slope_forward=0.05, slope_left=0.02)
    x, y = core.known.drift[0]
    drift = np.array([x, y if core.gait.stance[0] == 1 else -y])
    assert math.hypot(x, y) > 0.03
    off = core.observation[0] - core.truth[0]
    for part in (DCM, COM):
        np.testing.assert_allclose(off[part], drift, atol=1e-14)
    np.testing.assert_allclose(off[PUSH_ESTIMATE], -drift, atol=1e-14)
    assert not np.delete(off, [1, 2, 3, 4, 34, 35]).any()


def test_late_torques_do_not_make_it_faster(biped_core, begin):
    core = biped_core()
    velocity = self_model_walk(core, begin, 6.0, command=(0.4, 0.0), delay=0.01)
    assert velocity[0] == pytest.approx(0.4, abs=0.03)  # 0.46 where nothing is learned


@pytest.mark.parametrize("force", [60.0, 400.0])
def test_a_robot_that_is_as_its_model_learns_nothing_not_even_from_a_push(biped_core, begin, force):
    core = biped_core()
    push = Push((force, 0.4 * force, 0.0), 0.1, 1.0)
    begin(core, 0, Scenario("a", (push,), Command(0.3, 0.1)))
    for _ in range(500):
        action = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))
        assert core.known.mass[0] == 1.0
        assert np.linalg.norm(core.known.drift[0]) < rules.DRIFT_KNOWN
        assert core.observation.tobytes() == core.truth.tobytes()
    assert core.gait.failure[0] == 0


@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_a_push_below_its_own_noise_is_not_shown(biped_core, begin, noise):
    """White noise s of the DCM is sqrt(2) s / (sqrt(2) omega dt) of the push estimate, each axis."""
    core, shown, felt = biped_core(), [], []
    push = Push((0.0, 400.0, 0.0), 0.1, 2.5)
    begin(core, 0, Scenario("a", (push,), errors=ModelErrors(dcm_noise=noise)))
    for _ in range(270):
        action = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))
        shown.append(np.linalg.norm(core.observation[0, PUSH_ESTIMATE]))
        felt.append(core.known.felt[0].copy())
    felt = np.array(felt)
    assert felt[100:250, :2].std() == pytest.approx(noise / (BIPED.omega * PERIOD), rel=0.15)
    # jumps are second differences of white noise: sqrt(3) as large, in the median of two axes sqrt(2 ln 2)
    median = np.median(felt[100:250, 2])
    assert median == pytest.approx(math.sqrt(6.0 * math.log(2.0)) * noise / (BIPED.omega * PERIOD), rel=0.2)
    assert np.mean(np.array(shown[100:250]) == 0.0) > 0.98
    rises = np.linalg.norm(felt[252:259, :2], axis=1) > 2.0 * felt[252:259, 2]
    assert (np.array(shown[252:259]) > 0.0).tolist() == rises.tolist()
    assert rises.all() == (noise < 0.005)


@pytest.mark.parametrize("friction", [0.45, 0.6])
def test_a_robot_that_slides_knows_the_friction(biped_core, begin, friction):
    """The contacts' pyramid |f_x| + |f_y| <= mu f_z gives between mu / sqrt(2) and mu."""
    core, push = biped_core(), Push((400.0, 400.0, 0.0), 0.1, 0.1)
    self_model_walk(core, begin, 3.0, push)
    assert core.known.grip[0] == BIPED_BOUNDS.friction
    self_model_walk(core, begin, 3.0, push, friction=friction)
    assert 0.99 * friction / math.sqrt(2.0) < core.known.grip[0] < 1.01 * friction


def test_a_sole_may_slide_from_its_landing(biped_core, begin):
    core = biped_core()
    self_model_walk(core, begin, 0.3)
    most = core.known.grip[0]
    core.gait.elapsed[0] = rules.STANDING

    def slide(periods: int) -> float:
        for _ in range(periods):
            core.contacts.time[0], core.contacts.impulse[0] = PERIOD, (3.6, 4.8, 12.0)
            core.known.stood[0, rules.PLACE] -= PERIOD  # 1 m/s
            core.known.stood[0, rules.START] -= PERIOD
            rules.learn_grip(core.known, 0, core.physics, core.gait, core.contacts)
        return core.known.grip[0]

    assert slide(20) == most
    core.gait.elapsed[0] = 1.01 * rules.STANDING
    assert slide(2) == most
    assert slide(1) == 0.5


@pytest.mark.parametrize("sensing", ["exact", "onboard"])
def test_joint_noise_is_taken_for_no_slide(sensing):
    """On a floor of 0.9: 0.4 after 0.3 s where single differences of noisy places counted."""
    episodes, errors = BipedEpisodes(4, sensing=sensing), ModelErrors(friction=0.9, joint_noise=0.002)
    for k in range(4):
        episodes.begin(
            k, Scenario("a", (), Command(0.3, 0.0, 0.1 * k), duration=6.0, noise_seed=k, errors=errors)
        )
    for _ in range(500):
        episodes.step(POLICY.predict(episodes.core.observation)[0])
        assert (episodes.core.known.grip == BIPED_BOUNDS.friction).all()
    assert not episodes.failure().any()


LEFT, RIGHT = -1.0, 1.0  # sign of the canonical y on a stance foot


def fresh(n: int = 2):
    """Robots that know nothing yet; robot 1 is the one that learns."""
    known = rules.empty_self_model(n)
    for k in range(n):
        rules.forget(known, k, BIPED_GAIT, 0.8)
    return known


def walk_step(known, x: float, y: float, weight: float = 0.25) -> list[float]:
    """A step whose mean drift is (x, y) is over; returns the drift that is known then."""
    known.step[1, :2], known.step[1, rules.WEIGHT] = (weight * x, weight * y), weight
    rules.end_step(known, 1)
    assert not known.step[1, : rules.WEIGHT + 1].any()
    return known.drift[1].tolist()


def test_the_mean_of_two_steps_is_taken_over_by_halves():
    known = fresh()
    assert walk_step(known, 0.01, -0.03) == [0.0, 0.0]  # one step alone may be one-sided
    assert known.step[1, rules.LAST : rules.LAST + 2].tolist() == [0.01, -0.03]
    assert walk_step(known, 0.03, 0.01) == pytest.approx([0.5 * 0.02, 0.5 * -0.01])
    assert walk_step(known, 0.03, 0.01) == pytest.approx([0.01 + 0.5 * 0.02, -0.005 + 0.5 * 0.015])
    assert not known.drift[0].any()


def test_a_step_with_a_push_and_the_one_after_it_teach_nothing():
    known = fresh()
    walk_step(known, 0.02, 0.0)
    walk_step(known, 0.02, 0.0)
    before = known.drift[1].tolist()
    known.step[1, rules.QUIET] = -1.0  # pushed
    assert walk_step(known, 0.09, 0.09) == before
    assert walk_step(known, 0.09, 0.09) == before  # it still recovers
    assert walk_step(known, 0.04, 0.02) == before  # the first of two
    assert walk_step(known, 0.04, 0.02) == pytest.approx([before[0] + 0.5 * (0.04 - before[0]), 0.01])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_drift_changes_slowly_and_has_a_bound(sign):
    known, drifts = fresh(), []
    for _ in range(12):
        drifts.append(walk_step(known, sign * 0.3, -sign * 0.3)[0])
    np.testing.assert_allclose(np.diff(drifts)[:4], sign * 0.02, atol=1e-15)  # half of at most 4 cm
    assert drifts[-1] == sign * 0.1
    assert known.drift[1, 1] == -sign * 0.1


def test_a_model_counts_for_half_a_second_of_weighing():
    """A tenth of a second 20 % heavier: (0.5 e^-0.2 m g + 0.1 x 1.2 m g) over (0.5 e^-0.2 + 0.1) m g."""
    known, weight = fresh(), BIPED_GAIT.mass * GRAVITY
    rules.weigh(known, 1, BIPED_GAIT, 0.1 * 1.2 * weight, 0.0, 0.1)
    past = 0.5 * math.exp(-0.2)
    assert known.mass[1] == pytest.approx((past + 0.12) / (past + 0.1))
    assert known.mass[0] == 1.0
    rules.weigh(known, 1, BIPED_GAIT, 1e6, 0.0, 0.1)
    assert known.mass[1] == 2.0  # no more is believed
    rules.weigh(known, 1, BIPED_GAIT, -1e6, 0.0, 0.1)
    assert known.mass[1] == 0.5  # and no less
    known = fresh()
    rules.weigh(known, 1, BIPED_GAIT, 0.1 * 1.02 * weight, 0.0, 0.1)
    assert known.mass[1] == 1.0  # within a percent, by its 0.4 %


def test_a_climbing_robot_is_not_a_heavier_one():
    known, mass = fresh(), BIPED_GAIT.mass
    rules.weigh(known, 1, BIPED_GAIT, mass * (0.1 * GRAVITY + 0.5), 0.5, 0.1)
    assert known.mass[1] == 1.0


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_jumps_are_those_in_the_heading_frame(stance):
    """A steady push is seen with the other sign after a touchdown, and has not jumped."""
    known, seen = fresh(), np.zeros(36)
    known.felt[1] = 0.1, 0.2, 0.05
    seen[34:36] = 0.1, stance * 0.2
    rules.show_push(known, 1, stance, 0.01, seen)
    assert known.felt[1] == pytest.approx([0.1, 0.2, 0.04])  # less noise than was believed
    assert seen[34:36].tolist() == [0.1, stance * 0.2]  # above twice 0.04 m
    seen[34:36] = 0.1, stance * 0.3
    rules.show_push(known, 1, stance, 0.01, seen)
    assert known.felt[1] == pytest.approx([0.1, 0.3, 0.05])


@pytest.mark.parametrize(
    ("noise", "size", "shown"), [(0.05, 0.06, False), (0.05, 0.11, True), (0.02, 0.01, True)]
)
def test_a_push_is_shown_above_twice_its_noise_or_where_there_is_hardly_any(noise, size, shown):
    known, seen = fresh(), np.zeros(36)
    known.felt[1] = 0.6 * size, 0.8 * size, noise
    seen[34:36] = 0.6 * size, 0.8 * size
    rules.show_push(known, 1, RIGHT, 0.0, seen)  # no time has passed: nothing is learned
    assert known.felt[1].tolist() == [0.6 * size, 0.8 * size, noise]
    assert bool(seen[34:36].any()) == shown


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_what_is_planned_on_is_moved_by_a_drift_that_counts(stance):
    known, seen = fresh(), np.zeros(36)
    known.drift[1] = 0.9 * rules.DRIFT_KNOWN, 0.0
    rules.show_drift(known, 1, stance, seen)
    assert not seen.any()
    known.drift[1] = 0.03, 0.02
    rules.show_drift(known, 1, stance, seen)
    expected = np.zeros(36)
    expected[[1, 3]], expected[[2, 4]] = 0.03, stance * 0.02
    expected[34], expected[35] = -0.03, -stance * 0.02
    np.testing.assert_array_equal(seen, expected)


FIRST = 0.8  # friction believed in at first


class Sole:
    """A stance sole, and what its robot believes of the floor."""

    def __init__(self, noise: float = 0.0, seed: int = 0):
        self.place, self.grip, self.step = np.zeros(2), FIRST, 0
        self.landed = True
        self.noise, self.rng = noise, np.random.default_rng(seed)
        self.stood = np.zeros(rules.STOOD_SIZE)
        self.stood[rules.GRIP_AT_FIRST] = FIRST

    def move(self, speed: float, share: float, periods: int = 1, towards: float = 0.7) -> float:
        for _ in range(periods):
            self.place += speed * PERIOD * np.array([math.cos(towards), math.sin(towards)])
            x, y = self.place + self.noise * self.rng.normal(size=2)
            self.grip = rules.feel_grip(self.stood, self.grip, x, y, self.step, self.landed, share, PERIOD)
        return self.grip


def grip_standing(noise: float = 0.0, seed: int = 0) -> Sole:
    sole = Sole(noise, seed)
    sole.move(0.0, 0.1, 30)
    return sole


@pytest.mark.parametrize("share", [0.1, 0.5, 2.0])
def test_a_slide_of_three_periods_tells_the_friction(share):
    sole = grip_standing()
    assert sole.move(0.9 * rules.SLIDES, share, 2 * rules.SLIDING) == FIRST
    assert sole.move(1.1 * rules.SLIDES, share, rules.SLIDING - 1) == FIRST
    assert sole.move(1.1 * rules.SLIDES, share) == min(max(share, rules.GRIP_MIN), FIRST)


def test_the_largest_share_of_a_slide_counts_and_a_blow_does_not():
    sole = grip_standing()
    sole.move(1.0, 0.6)
    sole.move(1.0, 0.5, rules.SLIDING - 1)
    assert sole.grip == 0.6
    sole = grip_standing()
    for _ in range(5):
        assert sole.move(5.0, 0.5, rules.SLIDING - 1) == FIRST
        assert sole.move(0.0, 0.5) == FIRST


@pytest.mark.parametrize("what", ["landed", "no force", "another step"])
def test_a_slide_counts_only_under_load_and_within_a_step(what):
    sole = grip_standing()
    sole.move(1.0, 0.5, rules.SLIDING - 1)
    if what == "another step":
        sole.step = 1
        assert sole.move(1.0, 0.5) == FIRST
    elif what == "landed":
        sole.landed = False
        assert sole.move(1.0, 0.5, 20) == FIRST
        sole.landed = True
    else:
        assert sole.move(1.0, -1.0) == FIRST
    assert sole.move(1.0, 0.5, rules.SLIDING - 1) == FIRST
    assert sole.move(1.0, 0.5) == 0.5


def test_a_floor_that_holds_what_is_believed_is_believed_more_of():
    sole = grip_standing(0.002)
    sole.move(2.0, 0.5, 8)
    assert sole.grip == 0.5
    sole.step += 1
    sole.move(0.0, 0.4, 20)
    assert sole.move(0.0, 0.4, 100) == 0.5  # less than is believed tells nothing
    assert 0.5 + 5 * rules.RISE * PERIOD < sole.move(0.0, 0.5, 100) <= 0.5 + 101 * rules.RISE * PERIOD
    assert sole.move(0.0, 1.0, 1000) == FIRST
    assert sole.move(2.0, 0.6, 8) == 0.6  # and less again once it slides


def test_without_noise_a_slide_is_sure_and_nothing_is_tried_again():
    sole = grip_standing()
    sole.move(1.0, 0.5, rules.SLIDING)
    assert sole.move(0.0, 1.0, 100) == 0.5


@pytest.mark.parametrize("noise", [5e-4, 2.5e-3, 0.01])
def test_noise_is_found_and_taken_for_no_slide(noise):
    """Sixty robots for 50 s: 3e5 periods, in each of which a difference of two places may be 6 deviations."""
    for seed in range(60):
        sole = Sole(noise, seed)
        for _ in range(100):  # steps of half a second
            sole.step += 1
            assert sole.move(0.0, 0.5, 50) == FIRST
    assert math.sqrt(sole.stood[rules.NOISE]) == pytest.approx(noise, rel=0.3)


@pytest.mark.parametrize(("noise", "speed", "within"), [(2.5e-3, 1.0, 5), (2.5e-3, 0.6, 12), (0.01, 1.0, 20)])
def test_a_slide_is_found_in_noise(noise, speed, within):
    """After t it has gone (speed - SLIDES) t further than a sole that rests may: DOUBT noise is enough."""
    for seed in range(20):
        sole = grip_standing(noise, seed)
        sole.move(0.0, 0.5, 100)
        assert sole.grip == FIRST
        assert sole.move(speed, 0.5, within) == 0.5


def test_noise_that_begins_later_is_found_in_time_and_shaking_is_none():
    """A period counts 3 times the variance at most, a fiftieth of it: 1.04^n, 1e4 times in 235 periods."""
    for seed in range(20):
        sole = grip_standing(1e-5, seed)
        sole.move(0.0, 0.5, 50)
        sole.noise = 2.5e-3
        sole.move(0.0, 0.5, 30)  # as long as a fall takes
        assert sole.stood[rules.NOISE] < rules.NO_NOISE
        sole.move(0.0, 0.5, 370)
        assert math.sqrt(sole.stood[rules.NOISE]) == pytest.approx(2.5e-3, rel=0.4)
        sole.move(0.0, 0.9, 200)
        assert sole.grip == FIRST  # what the first periods were taken for is tried again


def test_the_belief_does_not_hang_on_place_or_direction():
    found = []
    for heading in np.linspace(0.0, 2.0 * math.pi, 9):
        sole = grip_standing()
        sole.place += 1000.0 * np.array([math.cos(heading), -math.sin(heading)])
        sole.step = 1
        sole.move(0.0, 0.1, 20)
        found.append([sole.move(s, 0.55, 1, heading) for s in (0.0, 0.5, 0.5, 0.5)])
    np.testing.assert_array_equal(found, [[FIRST, FIRST, FIRST, 0.55]] * 9)


def test_a_stander_learns_the_friction_that_its_sole_slides_with(biped_core, begin):
    """Sideways 6 of 12 N s, while the sole moves at 1 m/s."""
    core = biped_core()
    begin(core, 0, Scenario("a", command=Command(stand=True)))
    core.gait.elapsed[0] = -1.0
    for _ in range(3 + rules.SLIDING):
        core.contacts.time[0], core.contacts.impulse[0] = PERIOD, (3.6, 4.8, 12.0)
        for place in (rules.PLACE, rules.START):
            core.known.stood[0, place] -= PERIOD
        rules.learn_grip(core.known, 0, core.physics, core.gait, core.contacts)
    assert core.known.grip[0] == 0.5


def test_it_slides_from_0_3_m_s_on_and_no_friction_below_0_4_is_believed():
    sole = grip_standing()
    assert sole.move(0.29, 0.1, 10) == FIRST
    assert sole.move(0.31, 0.1, 2) == FIRST
    assert sole.move(0.31, 0.1) == 0.4
