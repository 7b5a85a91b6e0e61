"""What the biped learns of its mass, a steady force and its floor; nothing where nothing is to be learned."""

import math

import numpy as np
import pytest
from push_recovery.controllers.estimation.base_estimate import PLACE, START
from push_recovery.controllers.estimation.self_model import DRIFT_KNOWN, STANDING, learn_grip
from push_recovery.controllers.model.observation import COM, COM_HEIGHT_ERROR, DCM, PUSH_ESTIMATE
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_GAINS, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.model_errors import STEEPEST_SLOPE, ModelErrors
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
PERIOD = 0.01  # [s]


def walk(core, begin, seconds: float, *pushes: Push, command=(0.0, 0.0), **errors):
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
    walk(core, begin, 4.0)
    height = core.truth[0, COM_HEIGHT_ERROR]
    walk(core, begin, 4.0, mass=mass)
    assert core.known.mass[0] == pytest.approx(1.0 + mass, abs=2e-3)
    sag = GRAVITY * abs(mass) / BIPED_GAINS.height_kp  # of the CoM, were it carried with the model's mass
    assert abs(core.truth[0, COM_HEIGHT_ERROR] - height) < 0.2 * sag


def test_a_payload_counts_as_mass(biped_core, begin):
    core = biped_core()
    walk(core, begin, 4.0, payload=5.0)
    assert core.known.mass[0] == pytest.approx(65.0 / 60.0, abs=2e-3)


@pytest.mark.parametrize("mass", [-0.1, 0.1])
def test_with_its_mass_found_it_walks_at_the_speed_of_the_nominal_robot(biped_core, begin, mass):
    core, command = biped_core(), (0.4, 0.1)
    nominal = walk(core, begin, 5.0, command=command)
    np.testing.assert_allclose(walk(core, begin, 5.0, command=command, mass=mass), nominal, atol=0.02)


@pytest.mark.parametrize("slopes", [(0.05, 0.0), (0.0, -0.05), (0.03, 0.04)])
def test_it_walks_in_place_on_a_slope(biped_core, begin, slopes):
    """The steady force is m g tan(slope) downhill, -h tan(slope) over m omega^2."""
    core = biped_core()
    velocity = walk(core, begin, 8.0, slope_forward=slopes[0], slope_left=slopes[1])
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
    walk(core, begin, 5.0, slope_forward=0.05, slope_left=0.02)
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
    velocity = walk(core, begin, 6.0, command=(0.4, 0.0), delay=0.01)
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
        assert np.linalg.norm(core.known.drift[0]) < DRIFT_KNOWN
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
    walk(core, begin, 3.0, push)
    assert core.known.grip[0] == BIPED_BOUNDS.friction
    walk(core, begin, 3.0, push, friction=friction)
    assert 0.99 * friction / math.sqrt(2.0) < core.known.grip[0] < 1.01 * friction


def test_a_sole_may_slide_from_its_landing(biped_core, begin):
    core = biped_core()
    walk(core, begin, 0.3)
    most = core.known.grip[0]
    core.gait.elapsed[0] = STANDING

    def slide(periods: int) -> float:
        for _ in range(periods):
            core.contacts.time[0], core.contacts.impulse[0] = PERIOD, (3.6, 4.8, 12.0)
            core.known.stood[0, PLACE] -= PERIOD  # 1 m/s
            core.known.stood[0, START] -= PERIOD
            learn_grip(core.known, 0, core.physics, core.gait, core.contacts)
        return core.known.grip[0]

    assert slide(20) == most
    core.gait.elapsed[0] = 1.01 * STANDING
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
