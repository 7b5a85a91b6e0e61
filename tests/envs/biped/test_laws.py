"""Pushes that follow a law: closed forms of their contacts, balances on the robot, and bit-identical repeats.

Contacts are first held against bodies of one degree of freedom, whose motion is written down here; then the
same balances hold on the biped as MuJoCo moves it.
"""

import itertools
import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped import laws
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEnv, BipedEpisodes
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.episode.vector_env import GaitVectorEnv
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.robots.biped import PLAN, ROBOT, biped, biped_model, spec
from push_recovery.envs.scenario.arrays import NUMBERS, assign_pushes, empty_pushes
from push_recovery.envs.scenario.disturbances import (
    Impactor,
    Payload,
    Platform,
    Slip,
    SteadyForce,
    TiltingPlatform,
    Trip,
    WaistPull,
    WeightPull,
)
from push_recovery.envs.scenario.model_errors import ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import COUPLED, GaitEvent, Push
from push_recovery.envs.scenario.scenario import HARDWARE, Command, Scenario

STEP = 0.002
POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")


class Bench:
    """A body that moves as it is told, under the law of one push; its place is all that the law knows."""

    def __init__(self, disturbance):
        scenario = Scenario("bench", disturbances=(disturbance,))
        (push,) = scenario.forces
        self.pushes = assign_pushes(empty_pushes(1, 1), 0, scenario)
        self.place, self.axes, self.force = np.zeros(3), np.eye(3).reshape(-1).copy(), np.zeros(3)
        self.pushes.places[0, 0, :2] = self.place.ctypes.data, self.axes.ctypes.data
        assert self.pushes.law[0, 0] == COUPLED
        assert self.pushes.body[0, 0] == NUMBERS[push.body]
        self.step = round(push.start / STEP) if not isinstance(push.start, GaitEvent) else 0

    @property
    def speed(self) -> float:
        """Of what meets the body [m/s]."""
        return self.pushes.progress[0, 0, laws.SPEED]

    def __call__(self) -> np.ndarray:
        """The force of the next step [N]."""
        acts = laws.couple(self.pushes, 0, 0, self.step * STEP, STEP, self.force)
        self.step += 1
        return self.force.copy() if acts else np.zeros(3)


def hit_free_mass(impactor: Impactor, mass: float) -> tuple[Bench, float, float, list[float]]:
    """Bench, velocity and energy of a free mass after a hit, and the energy in the contact of each step."""
    bench, velocity, work, inside = Bench(impactor), 0.0, 0.0, []
    for _ in range(round(2.2 * impactor.contact_time / STEP)):
        force = bench()[0]
        velocity += force / mass * STEP
        bench.place[0] += velocity * STEP
        work += force * velocity * STEP
        inside.append(0.5 * impactor.mass * (impactor.speed**2 - bench.speed**2) - work)
    return bench, velocity, work, inside


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9])
@pytest.mark.parametrize(("mass", "other"), [(5.0, 60.0), (20.0, 16.0), (10.0, 1e9)])
def test_an_impactor_collides_as_newton_says(mass, other, restitution):
    """v' = v - (1 + e) M v / (m + M), and J = (1 + e) v m M / (m + M): 1 % of it at a contact of 15 steps."""
    impactor = Impactor(mass, 3.0, 0.1, stiffness=2000.0 * mass, restitution=restitution)
    bench, velocity, _, _ = hit_free_mass(impactor, other)
    impulse = (1.0 + restitution) * impactor.speed * mass * other / (mass + other)
    assert other * velocity == pytest.approx(impulse, rel=0.01)
    assert mass * (impactor.speed - bench.speed) == pytest.approx(other * velocity, rel=1e-6)  # momentum


@pytest.mark.parametrize("phase", np.linspace(0.0, 0.9, 4))
@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9])
def test_a_contact_never_gains_energy(restitution, phase):
    """Not even the stiffest, at any phase of the step; what is lost at the end is (1 - e^2) of what met."""
    mass, other, speed = 10.0, 40.0, 3.0
    stiffest = mass * (0.5 * restitution / STEP) ** 2
    impactor = Impactor(
        mass, speed, 0.1, stiffness=min(stiffest, 1e5) * (1.0 - 1e-9), restitution=restitution
    )
    bench = Bench(impactor)
    velocity, work, inside = 0.0, 0.0, []
    bench.place[0] = 0.0
    for i in range(round(2.2 * impactor.contact_time / STEP)):
        if i == 1:
            bench.place[0] += phase * speed * STEP  # contact at another phase of the step
        force = bench()[0]
        velocity += force / other * STEP
        bench.place[0] += velocity * STEP
        work += force * velocity * STEP
        inside.append(0.5 * mass * (speed**2 - bench.speed**2) - work)
    met = 0.5 * mass * other / (mass + other) * speed**2
    assert min(inside) >= -1e-9 * met
    assert inside[-1] == pytest.approx((1.0 - restitution**2) * met, abs=0.12 * met)


def test_against_a_wall_a_contact_lasts_as_long_as_is_said():
    impactor = Impactor(10.0, 2.0, 0.0, stiffness=4000.0, restitution=0.5)
    bench = Bench(impactor)
    forces = [bench()[0] for _ in range(200)]
    assert np.count_nonzero(forces) * STEP == pytest.approx(impactor.contact_time, abs=2.0 * STEP)
    assert impactor.contact_time == pytest.approx(0.5 * math.pi * 0.05 * 1.5)
    assert max(forces) == pytest.approx(2.0 * math.sqrt(4000.0 * 10.0), rel=0.01)  # v sqrt(k m)
    assert bench.speed == pytest.approx(-1.0, rel=0.02)  # - e v


def test_an_impactor_hits_along_its_direction_and_at_its_point():
    bench = Bench(Impactor(10.0, 2.0, 0.0, direction=2.0, offset=(0.1, 0.2, 0.3)))
    bench.axes[:] = 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0  # turned by 90 degrees
    assert np.array_equal(laws.point_of(bench.pushes, 0, 0), [-0.2, 0.1, 0.3])
    forces = np.sum([bench() for _ in range(20)], axis=0)
    assert forces[:2] / math.hypot(*forces[:2]) == pytest.approx([math.cos(2.0), math.sin(2.0)])
    assert forces[2] == 0.0


def test_a_pendulum_hits_with_the_speed_of_its_height():
    hit = Impactor.pendulum(4.0, 2.0, 1.2, 1.0, direction=0.5, body="trunk")
    assert replace(hit, speed=1.0) == Impactor(4.0, 1.0, 1.0, 0.5, "trunk")
    assert hit.speed == pytest.approx(math.sqrt(2.0 * GRAVITY * 0.4))  # 2 - 1.6 m
    assert hit.momentum == pytest.approx(4.0 * 2.801, rel=1e-3)


def test_a_weight_pulls_with_its_weight_in_the_end_and_with_more_where_it_falls_first():
    forces = {}
    for drop in (0.0, 0.2):
        bench = Bench(WeightPull(8.0, 0.0, 100.0, direction=1.0, drop=drop, damping=60.0))
        forces[drop] = np.array([bench() for _ in range(5000)])
        assert forces[drop][-1] == pytest.approx(
            8.0 * GRAVITY * np.array([math.cos(1.0), math.sin(1.0), 0.0]), abs=1e-3
        )
    peaks = [np.linalg.norm(forces[drop], axis=1).max() for drop in (0.0, 0.2)]
    assert 8.0 * GRAVITY < peaks[0] < 16.0 * GRAVITY  # at most twice the weight of one that does not fall
    assert peaks[1] > 3.0 * peaks[0]
    free = math.sqrt(2.0 * 0.2 / GRAVITY)
    assert np.flatnonzero(forces[0.2][:, 0])[0] * STEP == pytest.approx(free, abs=2.0 * STEP)


def test_a_cable_pulls_towards_its_pulley_and_never_pushes():
    bench = Bench(WeightPull(8.0, 0.0, 100.0, reach=2.0, damping=500.0))
    for _ in range(2000):
        bench()
    bench.place[1] = 0.5
    force = bench()
    assert force[1] / force[0] == pytest.approx(-0.5 / 2.0)
    assert force[0] > 0.0
    bench.place[0] = 0.5  # towards the pulley, faster than the weight falls
    assert not bench().any()


def test_a_waist_pull_goes_its_way_and_is_let_go():
    pull = WaistPull(0.12, 0.4, 0.1, acceleration=8.0, hold=0.2, reach=100.0, damping=0.0)
    duration = 0.12 / 0.4 + 0.4 / 8.0
    assert pull.forces[0].duration == pytest.approx(duration + 0.2)
    bench = Bench(pull)
    forces = np.array([bench()[0] for _ in range(300)])
    assert forces[round(duration / STEP) + 1] == pytest.approx(5000.0 * 0.12, rel=1e-9)  # k D
    assert np.diff(forces[30:140]) == pytest.approx(5000.0 * 0.4 * STEP)  # at full speed k v
    assert forces[round((duration + 0.2) / STEP) - 1] > 0.0
    assert not forces[round((duration + 0.2) / STEP) + 1 :].any()
    short = WaistPull(0.01, 0.4, 0.1, acceleration=4.0, hold=0.0)  # which never gets so fast
    assert short.forces[0].duration == pytest.approx(2.0 * math.sqrt(0.01 / 4.0))


def test_a_block_holds_a_foot_up_to_its_force_and_one_that_is_higher_passes():
    trip = Trip(GaitEvent(0, "left"), gap=0.02, height=0.05, force=120.0, duration=1.0)
    for height, most in ((0.04, 120.0), (0.06, 0.0)):
        bench = Bench(trip)
        bench.pushes.start[0, 0] = 0.0
        forces = []
        for i in range(100):
            bench.place[:] = 0.001 * i, 0.0, height
            forces.append(bench()[0])
        assert not np.any(forces[:20])
        assert min(forces) == -most
        assert max(forces) == 0.0
        bench.place[2] = 0.0
        assert bench()[0] == -most  # who has passed it, has passed it


def test_a_payload_lands_with_its_momentum_and_then_weighs():
    drop = Payload(6.0, 0.4, 0.0, stiffness=3000.0)
    bench = Bench(drop)
    forces = np.array([bench() for _ in range(2000)])
    assert not forces[:, :2].any()
    assert forces[-1, 2] == pytest.approx(-6.0 * GRAVITY, abs=1e-6)
    momentum = 6.0 * math.sqrt(2.0 * GRAVITY * 0.4)
    total = -forces[:, 2].sum() * STEP
    assert total == pytest.approx(momentum + 6.0 * GRAVITY * 2000 * STEP, rel=1e-6)
    assert math.hypot(*drop.forces[0].impulse) == pytest.approx(momentum)


def test_a_payload_has_inertia_aside_while_it_lies_there():
    """A body that is accelerated aside evenly feels - m a, after the load has settled."""
    bench = Bench(Payload(6.0, 0.0, 0.0, stiffness=3000.0))
    forces = []
    for i in range(1500):
        t = max(i - 1000, 0) * STEP
        bench.place[1] = 0.5 * 3.0 * t * t
        forces.append(bench()[1])
    assert not np.any(forces[:1000])
    assert np.mean(forces[-100:]) == pytest.approx(-6.0 * 3.0, rel=1e-3)


def test_a_ramp_gives_the_same_impulse_in_any_partition_of_time():
    force = SteadyForce(80.0, 0.1, 1.3, direction=0.3, rise=0.35)
    assert math.hypot(*force.impulse) == pytest.approx(80.0 * 0.95)
    pushes = assign_pushes(empty_pushes(1, 1), 0, Scenario("a", disturbances=(force,)))
    out, rng = np.zeros(3), np.random.default_rng(0)
    times = np.sort(rng.uniform(0.0, 2.0, 40))
    total = np.zeros(3)
    for t0, t1 in itertools.pairwise([0.0, *times, 2.0]):
        if laws.mean_of_ramp(pushes, 0, 0, t0, t1, out):
            total += out * (t1 - t0)
    assert total == pytest.approx(force.impulse, abs=1e-9)
    at = [(0.1 + 0.175, 0.5), (0.1 + 0.6, 1.0), (1.4 - 0.0875, 0.25)]
    for time, share in at:
        laws.mean_of_ramp(pushes, 0, 0, time - 1e-6, time + 1e-6, out)
        assert math.hypot(*out) == pytest.approx(80.0 * share, rel=1e-6)


# On the biped


def walk(episodes: BipedEpisodes, periods: int) -> None:
    for _ in range(periods):
        episodes.step(POLICY.predict(episodes.core.observation)[0])


def momentum(core, k: int) -> np.ndarray:
    """Linear momentum as MuJoCo finds it (3,) [N s]."""
    model, data = core.simulations.models[k], core.simulations.data[k]
    mujoco.mj_subtreeVel(model, data)
    return model.body_subtreemass[0] * data.subtree_linvel[0]


FINE = PhysicsOptions(time_step=1e-4)  # at which MuJoCo keeps the momentum of what flies
HITS = (
    Impactor(10.0, 4.0, 0.0, direction=0.4, stiffness=1e4),
    Impactor(10.0, 0.8, 0.0, direction=2.5, body="trunk", offset=(0.0, 0.05, 0.1), restitution=0.9),
)


@pytest.mark.parametrize("hit", HITS)
def test_what_the_robot_gains_is_what_the_impactor_loses(hit):
    """In free flight, where nothing else but gravity acts: momentum to 1 %, and energy is never gained."""
    episodes = BipedEpisodes(2)
    for k, parts in enumerate(((hit,), ())):
        episodes.begin(k, Scenario(str(k), disturbances=parts, duration=10.0, physics=FINE))
    core = episodes.core
    for k in range(2):
        data = core.simulations.data[k]
        qpos = data.qpos.copy()
        qpos[2] += 5.0
        core.put(k, qpos, np.zeros_like(data.qvel))
    body = core.simulations.data[0].body(hit.body).id
    row, work, point, inside = core.pushes.progress[0, 0], 0.0, [], []
    offset = np.array(hit.offset)

    def look() -> None:
        nonlocal work
        data = core.simulations.data[0]
        place = data.xipos[body] + data.xmat[body].reshape(3, 3) @ offset
        if point:
            work += data.xfrc_applied[body, :3] @ (place - point[-1])
        point.append(place)
        inside.append(0.5 * hit.mass * (hit.speed**2 - row[laws.SPEED] ** 2) - work)

    look()
    inside.clear()
    core.after_physics_step = look
    for _ in range(math.ceil(2.0 * hit.contact_time / 0.01)):
        episodes.step(np.zeros((2, 7), np.float32))
    assert not episodes.failure().any()
    lost = hit.mass * (hit.speed - row[laws.SPEED])
    line = np.array([math.cos(hit.direction), math.sin(hit.direction), 0.0])
    assert core.pushes.delivered[0, 0] == pytest.approx(lost * line, abs=1e-9)
    assert 0.5 * hit.momentum < lost < 1.9 * hit.momentum
    gained = momentum(core, 0) - momentum(core, 1)
    assert gained == pytest.approx(lost * line, abs=0.01 * lost)
    assert min(inside) >= -1e-3 * 0.5 * hit.mass * hit.speed**2
    assert inside[-1] > 0.0


def test_a_floor_that_moves_leaves_what_flies_behind():
    """Seen from the floor a robot in flight moves by - D, and at its velocity against it in between."""
    episodes = BipedEpisodes(2)
    move = Platform(0.02, 0.5, 0.02, direction=2.0, acceleration=20.0)
    parts = (move,), ()
    for k in range(2):
        scenario = Scenario(str(k), disturbances=parts[k], duration=10.0, physics=FINE)
        episodes.begin(k, replace(scenario, errors=ModelErrors(slope_left=0.05)))
    core = episodes.core
    for k in range(2):
        data = core.simulations.data[k]
        qpos = data.qpos.copy()
        qpos[2] += 5.0
        core.put(k, qpos, np.zeros_like(data.qvel))
    way, speeds = [], []
    for _ in range(10):
        episodes.step(np.zeros((2, 7), np.float32))
        coms = [core.simulations.data[k].subtree_com[0].copy() for k in range(2)]
        way.append(coms[0] - coms[1])
        speeds.append((momentum(core, 0) - momentum(core, 1)) / BIPED.mass)
    line = np.array([math.cos(2.0), math.sin(2.0), 0.0])
    assert not episodes.failure().any()
    assert move.forces[0].duration == pytest.approx(0.065)
    assert np.max(np.abs(way[0])) < 1e-9
    assert speeds[4] == pytest.approx(-0.5 * line, abs=2e-3)  # 0.03 s after the start
    assert way[-1] == pytest.approx(-0.02 * line, abs=2e-4)
    assert speeds[-1] == pytest.approx(0.0, abs=2e-3)
    assert np.array_equal(core.simulations.models[0].opt.gravity, core.simulations.models[1].opt.gravity)


def at_rest(core, turn: np.ndarray, omega: np.ndarray, pivot: np.ndarray) -> tuple[np.ndarray, ...]:
    """CoM, velocity and spin about the CoM of a robot in axes at rest, those of a floor turned by `turn`."""
    model, data = core.simulations.models[0], core.simulations.data[0]
    mujoco.mj_subtreeVel(model, data)
    com, velocity, spin = (getattr(data, f"subtree_{name}")[0] for name in ("com", "linvel", "angmom"))
    inertia = np.zeros((3, 3))
    for body in range(1, model.nbody):
        axes, away = data.ximat[body].reshape(3, 3), data.xipos[body] - com
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += model.body_mass[body] * (away @ away * np.eye(3) - np.outer(away, away))
    carried = np.cross(omega, com - pivot)
    return pivot + turn @ (com - pivot), turn @ (velocity + carried), turn @ (spin + inertia @ omega)


def rotation(vector: np.ndarray) -> np.ndarray:
    """Matrix of a turn about a vector by its length [rad]."""
    quaternion, matrix, angle = np.zeros(4), np.zeros(9), float(np.linalg.norm(vector))
    mujoco.mju_axisAngle2Quat(quaternion, vector / angle if angle else np.eye(3)[0], angle)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


@pytest.mark.parametrize("slope", [0.0, 0.06])
def test_what_flies_over_a_floor_that_tilts_moves_as_newton_says(slope):
    """In axes at rest its CoM flies a parabola, and its spin about the CoM stays, whatever its joints do.

    The floor goes down towards 0.5 rad, at 2 rad/s once it has been accelerated for 0.1 s.
    """
    fastest, acceleration, start, towards = 2.0, 20.0, 0.02, 0.5
    tilt = TiltingPlatform(0.3, fastest, start, towards, acceleration=acceleration)
    episodes = BipedEpisodes(1)
    errors = ModelErrors(slope_forward=slope)
    episodes.begin(0, Scenario("tilt", disturbances=(tilt,), duration=10.0, physics=FINE, errors=errors))
    core = episodes.core
    data = core.simulations.data[0]
    qpos, qvel = data.qpos.copy(), np.random.default_rng(3).normal(scale=0.7, size=data.qvel.shape)
    qpos[2] += 0.5
    qvel[6:] *= 0.1
    core.put(0, qpos, qvel)
    axis = np.array([-math.sin(towards), math.cos(towards), 0.0])
    gravity, seen = core.simulations.models[0].opt.gravity.copy(), []
    for period in range(1, 16):
        pivot = core.pushes.progress[0, 0, laws.PIVOT :][:3]
        if period >= 3:
            since = 0.01 * (period - 1) - start
            up = min(since, 0.1)
            turned = 0.5 * acceleration * up**2 + fastest * (since - up)
            if period == 3:
                pivot = data.subtree_com[0] * [1.0, 1.0, 0.0]
            seen.append(at_rest(core, rotation(turned * axis), acceleration * up * axis, pivot))
        episodes.step(np.zeros((1, 7), np.float32))
    assert not episodes.failure().any()
    (com, velocity, spin), *rest = seen
    assert np.linalg.norm(spin) > 1.0
    for t, (com_then, velocity_then, spin_then) in zip(0.01 * np.arange(1, 13), rest, strict=True):
        assert com_then == pytest.approx(com + velocity * t + 0.5 * gravity * t**2, abs=5e-4)
        assert velocity_then == pytest.approx(velocity + gravity * t, abs=8e-3)
        assert spin_then == pytest.approx(spin, abs=0.03)


def test_a_floor_has_one_way_to_go():
    both = TiltingPlatform(0.1, 1.0, 0.02), Platform(0.1, 0.3, 1.0)
    with pytest.raises(InvalidValueError, match=r"a floor has one shift at most, got several.*'two'"):
        BipedEpisodes(1).begin(0, Scenario("two", disturbances=both))


@pytest.mark.parametrize("sensing", ["exact", "onboard"])
def test_a_robot_that_begins_anew_is_on_a_floor_at_rest(sensing):
    """Whatever its last episode was cut off in."""
    tilt = TiltingPlatform(0.1, 1.0, 0.02)
    seen = []
    for first in ((), (tilt,)):
        episodes = BipedEpisodes(1)
        episodes.begin(0, Scenario("first", disturbances=first, sensing=sensing))
        for _ in range(8):
            episodes.step(POLICY.predict(episodes.core.observation)[0])
        episodes.begin(0, Scenario("second", sensing=sensing))
        for _ in range(30):
            episodes.step(POLICY.predict(episodes.core.observation)[0])
        seen.append(episodes.core.truth.tobytes())
    assert seen[0] == seen[1]


def test_an_inertial_unit_feels_a_floor_that_tilts_and_afterwards_none():
    """It reads the acceleration of the base in axes at rest, less gravity, and the floor's rate."""
    tilt = TiltingPlatform(0.1, 1.0, 0.02, -0.7, hold=0.02, acceleration=20.0)
    episodes = BipedEpisodes(1)
    episodes.begin(0, Scenario("tilt", disturbances=(tilt,), duration=10.0, sensing="onboard"))
    core, seen = episodes.core, []
    sensors, row = core.senses.last.sensors, core.pushes.progress[0, 0]

    def look() -> None:
        qpos, qvel = core.simulations.data[0].qpos, core.simulations.data[0].qvel
        seen.append([*qpos[:3], *qvel[:3], *sensors.gravity[0], *sensors.turn[0]])

    core.after_physics_step = look
    for _ in range(40):
        episodes.step(POLICY.predict(core.observation)[0])
    place, velocity, felt, turn = np.split(np.array(seen), 4, axis=1)
    axis, pivot = np.array([math.sin(0.7), math.cos(0.7), 0.0]), row[laws.PIVOT :][:3]
    assert row[laws.AXIS :][:3] == pytest.approx(axis)
    times = STEP * np.arange(1, len(seen) + 1)
    rates = np.clip(np.minimum(20.0 * (times - 0.02), 20.0 * (0.17 - times)), 0.0, 1.0)
    rates -= np.clip(np.minimum(20.0 * (times - 0.19), 20.0 * (0.34 - times)), 0.0, 1.0)
    between = 0.5 * (np.append(0.0, rates[:-1]) + rates)
    np.testing.assert_allclose(turn, between[:, None] * axis, atol=1e-9)
    angles = np.cumsum(STEP * between)
    absolute = [
        rotation(angle * axis) @ (v + np.cross(rate * axis, r - pivot))
        for angle, rate, v, r in zip(angles, rates, velocity, place, strict=True)
    ]
    for i in range(1, len(seen)):
        proper = (absolute[i] - absolute[i - 1]) / STEP - [0.0, 0.0, -GRAVITY]
        told = (velocity[i] - velocity[i - 1]) / STEP - felt[i]
        turned = rotation((angles[i] - 0.5 * STEP * between[i]) * axis)
        assert turned @ told == pytest.approx(proper, abs=0.12)
    assert np.array_equal(felt[-1], [0.0, 0.0, -GRAVITY])
    assert not core.simulations.data[0].xfrc_applied.any()


@pytest.mark.parametrize("errors", [ModelErrors(), ModelErrors(floor_step=0.005)])
def test_one_sole_slips_for_a_time_and_no_other_robot_does(errors):
    """Contacts of that sole have the low friction from the start to the end, as MuJoCo has them."""
    slip = Slip("left", 0.07, 0.05, 0.2)
    episodes = BipedEpisodes(2)
    for k, parts in enumerate(((slip,), ())):
        episodes.begin(k, Scenario(str(k), disturbances=parts, errors=errors, duration=10.0))
    core, seen = episodes.core, []

    def look() -> None:
        model, data = core.simulations.models[0], core.simulations.data[0]
        left, right = (model.geom(name).id for name in core.body.plan.sole_boxes)
        found = {left: set(), right: set()}
        for contact in data.contact[: data.ncon]:
            for sole, frictions in found.items():
                if sole in contact.geom and not {left, right} <= set(contact.geom):
                    frictions.add(tuple(contact.friction[:2]))
        seen.append((data.time, found[left], found[right]))

    core.after_physics_step = look
    walk(episodes, 40)
    both = {(0.9, 0.9)}
    for time, left, right in seen:
        low = 0.05 - 1e-9 <= time < 0.25 - 1e-9
        assert left <= ({(0.07, 0.07)} if low else both), time
        assert right <= both
    assert any((0.07, 0.07) in left for _, left, _ in seen)
    assert np.all(core.simulations.models[1].pair_friction[:, 0] == 0.9)
    assert np.all(core.simulations.models[0].pair_friction[:, 0] == 0.9)  # and it has come back


def test_a_floor_that_is_more_slippery_stays_as_it_is():
    episodes = BipedEpisodes(1)
    episodes.begin(
        0, Scenario("a", disturbances=(Slip("left", 0.8, 0.0, 9.0),), errors=ModelErrors(friction=0.4))
    )
    walk(episodes, 3)
    assert np.all(episodes.core.simulations.models[0].pair_friction[:2, 0] == 0.4)


def test_a_robot_carries_a_payload_that_was_dropped_on_it():
    """Under its feet there is the weight of both, in the mean over steps."""
    episodes = BipedEpisodes(1)
    episodes.begin(
        0, Scenario("a", disturbances=(Payload(5.0, 0.2, 0.5, offset=(0.0, 0.0, 0.2)),), duration=20.0)
    )
    walk(episodes, 250)
    loads = []
    for _ in range(200):
        walk(episodes, 1)
        loads.append(episodes.core.physics.load[0].sum())
    assert not episodes.failure().any()
    assert np.mean(loads) == pytest.approx(65.0 * GRAVITY, rel=0.02)


def test_a_block_stops_the_swing_foot_by_its_toe():
    """No more than its force, backward and at the height of the sole; without it the foot goes on."""
    trip = Trip(GaitEvent(4, "right", 0.35), gap=0.01, height=0.2, force=80.0, duration=0.1)
    episodes = BipedEpisodes(2)
    for k, parts in enumerate(((trip,), ())):
        episodes.begin(
            k,
            Scenario(str(k), disturbances=parts, command=Command(vx=0.4), stance_side="right", duration=10.0),
        )
    core, forces = episodes.core, []

    def look() -> None:
        data = core.simulations.data[0]
        forces.append(data.xfrc_applied[data.body("left_foot").id].copy())

    core.after_physics_step = look
    walk(episodes, 260)
    pushed = np.array([force for force in forces if force.any()])
    assert len(pushed) > 10
    assert -80.0 <= pushed[:, 0].min() <= -60.0
    assert pushed[:, 0].max() < 0.0
    np.testing.assert_allclose(pushed[:, 1:3], 0.0, atol=1.0)  # the heading is the world's
    assert pushed[:, 4].max() > 0.0  # below the CoM of the foot, about y


KINDS = (
    Impactor(10.0, 6.0, GaitEvent(1, "left", 0.3), direction=1.9),
    WeightPull(9.0, 0.31, 0.6, direction=-2.0),
    WaistPull(0.12, 0.4, 0.31, direction=0.7),
    SteadyForce(60.0, 0.31, 0.9, direction=2.2),
    Slip("left", 0.08, 0.31, 0.4),
    Trip(GaitEvent(1, "left", 0.3)),
    Payload(4.0, 0.2, 0.31),
    Platform(0.1, 0.3, 0.31, direction=1.0),
    TiltingPlatform(0.06, 0.5, 0.31, direction=0.8, hold=0.2),
)


def scenarios() -> list[Scenario]:
    plain = [
        Scenario(part.json_name, disturbances=(part,), command=Command(vx=0.2), duration=1.6)
        for part in KINDS
    ]
    return [
        *plain,
        *(HARDWARE.applied(replace(scenario, id=f"{scenario.id} hardware")) for scenario in plain),
    ]


@pytest.fixture(scope="module")
def traces():
    """All kinds on both profiles side by side, with two more walks that nothing disturbs: id -> states."""
    found = scenarios()
    calm = [
        replace(found[0], id="calm", disturbances=()),
        replace(found[len(KINDS)], id="calm hardware", disturbances=()),
    ]
    envs = GaitVectorEnv(BipedEpisodes(len(found) + 2, threads=2), autoreset_mode="Disabled")
    envs.reset(options={"scenario": [*found, *calm]})
    seen = []
    for _ in range(160):
        envs.step(POLICY.predict(envs.core.observation)[0])
        seen.append(envs.core.truth.copy())
    states = np.array(seen)
    delivered = envs.core.pushes.delivered.sum(axis=1)
    return {s.id: (states[:, k], delivered[k]) for k, s in enumerate([*found, *calm])}


@pytest.mark.parametrize("k", range(2 * len(KINDS)))
def test_one_robot_is_as_many_and_each_kind_is_felt(traces, k):
    scenario = scenarios()[k]
    env = BipedEnv()
    env.reset(options={"scenario": scenario})
    seen, info = [], {}
    for _ in range(160):
        observation = env.unwrapped.episodes.core.observation
        info = env.step(POLICY.predict(observation)[0][0])[4]
        seen.append(env.unwrapped.episodes.core.truth[0].copy())
    states, delivered = traces[scenario.id]
    assert np.array(seen).tobytes() == states.tobytes()
    assert np.array_equal(info["delivered"], delivered)
    calm = traces["calm hardware" if scenario.sensing == "onboard" else "calm"][0]
    assert states[:14].tobytes() == calm[:14].tobytes()
    assert np.abs(states - calm).max() > 1e-3


@pytest.mark.parametrize("k", range(len(KINDS)))
def test_the_mirrored_kind_is_answered_by_the_mirror_image(traces, k):
    """Long enough for each to be felt; contacts make the two part later."""
    scenario = scenarios()[k]
    episodes = BipedEpisodes(2)
    for i, one in enumerate((scenario, scenario.mirrored())):
        episodes.begin(i, one)
    walk(episodes, 60)
    first, second = episodes.core.truth
    assert first == pytest.approx(second, abs=1e-5)
    side = episodes.core.com[:, 1]
    assert side[0] == pytest.approx(-side[1], abs=1e-6)


@pytest.mark.parametrize("k", [0, 1, 2, 4, 6, 7, 8, 12, 15])
def test_a_robot_goes_on_from_a_snapshot_in_the_middle_of_it(k):
    env, action = BipedEnv(), np.zeros(7, np.float32)
    env.reset(options={"scenario": scenarios()[k]})
    core = env.unwrapped.episodes.core

    def on() -> bytes:
        return b"".join(env.step(POLICY.predict(core.observation)[0][0])[0].tobytes() for _ in range(40))

    for _ in range(45):
        env.step(POLICY.predict(core.observation)[0][0])
    snapshot = env.state_snapshot()
    then = on()
    env.reset(options={"scenario": Scenario("other")})
    env.step(action)
    env.restore(snapshot)
    assert on() == then


def test_a_reset_leaves_nothing_of_a_law():
    """Models, rows and places of the robot before: the plain walk after it is that of a new environment."""
    env, fresh, walks = BipedEnv(), BipedEnv(), []
    for part in KINDS:
        env.reset(options={"scenario": Scenario("a", disturbances=(part,))})
        for _ in range(50):
            env.step(np.zeros(7, np.float32))
    for one in (env, fresh):
        one.reset(options={"scenario": Scenario("b", (Push((90.0, 0.0, 0.0), 0.1, 0.3),))})
        walks.append(b"".join(one.step(np.zeros(7, np.float32))[0].tobytes() for _ in range(60)))
    assert walks[0] == walks[1]
    assert "delivered" not in env.step(np.zeros(7, np.float32))[4]


@pytest.mark.parametrize("part", KINDS, ids=lambda part: part.json_name)
def test_a_pendulum_refuses_what_it_does_not_have(part):
    with pytest.raises(
        InvalidValueError,
        match=rf"takes no {part.json_name}, only constant pushes and what is made of them, got",
    ):
        PendulumEpisodes(1).begin(0, Scenario("a", disturbances=(part,)))


class Draws:
    """A distribution of scenarios that are written down."""

    def __init__(self, *scenarios):
        self._next = iter(scenarios)

    def sample(self, rng):
        return next(self._next)


@pytest.mark.parametrize("first", [True, False])
def test_info_of_a_vector_tells_it_where_a_law_is(first):
    """At the end of an episode, and in the next one, either of which alone has a law."""
    calm = Scenario("calm", duration=0.08)
    hit = replace(calm, disturbances=(Impactor(10.0, 3.0, 0.0),))
    envs = GaitVectorEnv(BipedEpisodes(2), autoreset_mode="SameStep")
    envs.reset(options={"scenario": [hit if first else calm, calm]})
    envs.push_distribution = Draws(calm if first else hit, calm)  # type: ignore[assignment]
    nowhere, info = np.zeros(2, bool), {}
    for _ in range(8):
        info = envs.step(np.zeros((2, 7), np.float32))[4]
    final = info["final_info"]
    assert final.get("_delivered", nowhere).tolist() == [first, False]
    assert info.get("_delivered", nowhere).tolist() == [not first, False]
    if first:
        assert np.linalg.norm(final["delivered"][0]) > 20.0


def test_a_floor_goes_and_tilts_in_the_frame_of_the_robots_heading():
    """The platform after 10 of 25 ms of 20 m/s^2, the axis of the tilt at a right angle: at 0.7 + 0.5 rad."""
    for part in (
        Platform(0.02, 0.5, 0.01, direction=0.5, acceleration=20.0),
        TiltingPlatform(0.1, 1.0, 0.01, 0.5, acceleration=20.0),
    ):
        episodes = BipedEpisodes(1)
        episodes.begin(0, Scenario("a", disturbances=(part,), duration=9.0))
        core = episodes.core
        core.gait.heading[0] = 0.7
        for _ in range(2):
            episodes.step(np.zeros((1, 7), np.float32))
        if isinstance(part, Platform):
            expected = -20.0 * math.cos(1.2), -20.0 * math.sin(1.2)
            assert core.simulations.models[0].opt.gravity[:2] == pytest.approx(expected, abs=1e-6)
        else:
            axis = core.pushes.progress[0, 0, laws.AXIS :][:3]
            assert axis == pytest.approx([-math.sin(1.2), math.cos(1.2), 0.0])


def test_a_short_way_ends_where_it_is_told_to():
    """1 cm at 4 m/s^2 never gets to 0.4 m/s: half of it is gone at 0.05 s, all at 0.1 s."""
    bench = Bench(WaistPull(0.01, 0.4, 0.0, acceleration=4.0, hold=0.2, reach=100.0, damping=0.0))
    forces = np.array([bench()[0] for _ in range(100)])
    assert forces[25] == pytest.approx(5000.0 * 0.005, rel=1e-6)
    assert forces[60:] == pytest.approx(5000.0 * 0.01, rel=1e-6)
    assert laws.way_gone(9.0, 0.01, 0.4, 4.0) == pytest.approx(0.01)
    assert laws.way_gone(0.05, 0.01, 0.4, 4.0) == pytest.approx(0.005)


def test_the_cable_of_a_motor_is_damped():
    """At 0.15 s the end has gone 0.4 x (0.15 - 0.025) = 5 cm at 0.4 m/s: k s + c v."""
    bench = Bench(WaistPull(0.12, 0.4, 0.0, acceleration=8.0, hold=0.2, reach=100.0, damping=50.0))
    forces = [bench()[0] for _ in range(76)]
    assert forces[75] == pytest.approx(5000.0 * 0.05 + 50.0 * 0.4, rel=1e-6)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_block_meets_the_middle_of_the_soles_front_edge(side):
    """biped.xml: the CoM of a foot is at z = -0.035 m, its sole at -0.06 m and 0.2 m long."""
    episodes = BipedEpisodes(1)
    episodes.begin(0, Scenario("a", disturbances=(Trip(GaitEvent(4, side)),)))
    assert episodes.core.pushes.offset[0, 0] == pytest.approx([0.1, 0.0, -0.025])


def test_a_block_gives_back_half_the_speed():
    """With a quarter of the energy: k (d - 0.75 d_max) / 0.25 on the way out."""
    bench = Bench(Trip(GaitEvent(0, "left"), gap=0.02, duration=1.0))
    bench.pushes.start[0, 0] = 0.0
    forces = []
    for x in (0.0, 0.025, 0.0245, 0.023):
        bench.place[0] = x
        forces.append(bench()[0])
    assert forces == pytest.approx([0.0, -50.0, -30.0, 0.0], abs=1e-9)


def test_a_payload_has_0_7_of_critical_damping():
    """2 x 0.7 x sqrt(2000 x 5)."""
    assert Payload(5.0, 0.5, 1.0, stiffness=2000.0).forces[0].law.damping == pytest.approx(140.0)


def test_a_payload_lands_on_a_walker_with_the_walkers_own_speed_aside():
    bench, forces = Bench(Payload(6.0, 0.2, 0.0, stiffness=3000.0)), []
    for i in range(400):
        bench.place[:2] = 0.3 * STEP * i, -0.2 * STEP * i
        forces.append(bench())
    assert np.min(forces) < -100.0
    np.testing.assert_allclose(np.array(forces)[:, :2], 0.0, atol=1e-9)


def test_an_impactor_is_held_back_after_twice_its_time_against_a_wall():
    """T = pi / 2 sqrt(m / k) (1 + e) against a wall, and momentum m v."""
    (push,) = Impactor(10.0, 2.0, 0.0, stiffness=4000.0, restitution=0.5).forces
    assert push.duration == pytest.approx(math.pi * 0.05 * 1.5)
    assert math.hypot(*push.impulse) == pytest.approx(20.0)


@pytest.mark.parametrize(
    "part",
    [TiltingPlatform(0.3, 2.0, 0.0, 0.5, acceleration=20.0), Platform(0.1, 0.5, 0.0, 1.0)],
    ids=lambda part: part.json_name,
)
def test_control_believes_that_the_floor_is_at_rest(biped_core, begin, part):
    core, data = biped_core(), mujoco.MjData(biped_model())
    begin(core, 0, Scenario("a", disturbances=(part,)))
    for _ in range(6):
        action = POLICY.predict(core.observation)[0]
        core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))
    data.qpos[:], data.qvel[:] = core.physics.qpos[0], core.physics.qvel[0]
    mujoco.mj_step1(biped_model(), data)
    np.testing.assert_allclose(core.physics.bias[0], data.qfrc_bias, atol=1e-9)
    assert np.abs(core.simulations.data[0].qfrc_bias - data.qfrc_bias).max() > 10.0


@pytest.mark.parametrize(("errors", "count"), [(ModelErrors(), 1), (ModelErrors(floor_step=0.01), 5)])
def test_a_slip_is_of_the_pairs_of_a_sole_with_floor_and_tiles_alone(errors, count):
    model = altered_model(biped(), errors) or biped_model()
    for sole in PLAN.sole_boxes:
        pairs = laws.sole_pairs(model, sole)
        assert len(pairs) == count
        assert not model.geom_bodyid[model.pair_geom1[pairs]].any()  # the world's


def test_an_end_within_a_held_action_beside_a_robot_whose_law_is_over():
    hit = Scenario("hit", disturbances=(Impactor(10.0, 3.0, 0.0),), duration=0.02)
    envs = GaitVectorEnv(BipedEpisodes(2), hold=2)
    envs.reset(seed=0, options={"scenario": [Scenario("calm", duration=0.03), hit]})
    for _ in range(2):
        info = envs.step(np.zeros((2, 7), np.float32))[4]
    assert info["time"][0] == pytest.approx(0.03)


def masted() -> mujoco.MjSpec:
    """The biped with 3 kg of its trunk on a mast, a body that no push may name."""
    model = spec()
    trunk = model.body("trunk")
    trunk.mass = trunk.mass - 3.0
    mast = trunk.add_body(name="mast", pos=[0.1, 0.05, 0.5])
    mast.mass, mast.ipos, mast.inertia = 3.0, [0.0, 0.0, 0.1], [0.03, 0.02, 0.01]
    mast.explicitinertial = True
    return model


def test_a_body_that_no_push_may_name_feels_a_floor_that_tilts():
    """In axes at rest a robot that is let go falls by gravity alone and does not spin.

    After 0.06 s at 20 rad/s^2 the floor has turned by 0.036 rad and goes at 1.2 rad/s.
    """
    towards = 0.5
    tilt = TiltingPlatform(0.3, 2.0, 0.02, towards, acceleration=20.0)
    episodes = BipedEpisodes(1, robot=replace(ROBOT, name="masted", spec=masted))
    episodes.begin(0, Scenario("tilt", disturbances=(tilt,), duration=10.0, physics=FINE))
    core = episodes.core
    qpos = core.simulations.data[0].qpos.copy()
    qpos[2] += 0.5
    core.put(0, qpos, np.zeros(20))
    for _ in range(8):
        episodes.step(np.zeros((1, 7), np.float32))
    assert not episodes.failure().any()
    axis = np.array([-math.sin(towards), math.cos(towards), 0.0])
    pivot = core.pushes.progress[0, 0, laws.PIVOT :][:3]
    _, velocity, spin = at_rest(core, rotation(0.036 * axis), 1.2 * axis, pivot)
    assert velocity == pytest.approx([0.0, 0.0, -GRAVITY * 0.08], abs=8e-3)
    assert spin == pytest.approx(np.zeros(3), abs=0.03)


@pytest.mark.parametrize("turned", [False, True])
def test_of_slips_of_one_sole_the_lowest_friction_counts(turned):
    slips = Slip("left", 0.3, 0.05, 0.3), Slip("left", 0.1, 0.1, 0.1), Slip("right", 0.2, 0.05, 0.1)
    episodes, seen = BipedEpisodes(1), []
    episodes.begin(0, Scenario("a", disturbances=slips[::-1] if turned else slips, duration=10.0))
    core = episodes.core
    left, right = (laws.sole_pairs(core.simulations.models[0], sole) for sole in core.body.plan.sole_boxes)
    (left,) = set(left) - set(right)

    def look() -> None:
        seen.append((core.simulations.data[0].time, core.simulations.models[0].pair_friction[left, 0]))

    core.after_physics_step = look
    walk(episodes, 40)
    assert len(seen) == 200
    for time, friction in seen:
        after = time + 1e-9
        low = 0.1 if 0.1 <= after < 0.2 else 0.3 if 0.05 <= after < 0.35 else 0.9
        assert friction == low, time


def test_a_scenario_that_is_refused_leaves_the_robot_as_it_was():
    """Also where the scenario has pushes, which would have nowhere to act."""
    both = TiltingPlatform(0.1, 1.0, 0.02), Platform(0.1, 0.3, 1.0)
    core = BipedEpisodes(1).core
    model, laws_of = core.simulations.models[0], core.pushes.law[0].copy()
    with pytest.raises(InvalidValueError, match="a floor has one shift at most"):
        core.assign(0, Scenario("two", disturbances=both))
    assert core.simulations.models[0] is model
    np.testing.assert_array_equal(core.pushes.law[0], laws_of)
