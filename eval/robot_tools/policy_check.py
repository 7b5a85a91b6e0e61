"""Does a policy of others do unpushed what its contract says? And if not: is it the contract, or the policy?

An unpushed control stands and walks five commands. Where it falls or goes astray, contracts that differ from
the one given in a single thing, as adapters usually do, are tried: two joints exchanged, a scale or the
gains off by a usual factor, a clock that stands or has another period, gravity or the command with another
sign. If one of them passes the whole control, the contract is at fault there; if none does, the policy is
weak, or the fault is none of those that were tried, such as an angle of the default pose, or two at once.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ...controllers.errors import InvalidValueError, MissingExtraError, PushRecoveryError
from ...envs.joint.full_body import FullBodyEnv, driven, joint_names
from ...envs.robots.compiled_robot import compiled_robot
from ...envs.robots.description import robot_description
from ...envs.scenario.scenario import Command, Scenario
from ..output.progress import Work, about, progress_bars
from ..rollout.contender import Contender
from ..rollout.contract import DAMPING, NAMES, SCALE, STIFFNESS, TERMS, PolicyContract, term_field
from ..rollout.episodes import rollout

SECONDS = 10.0  # of a control
SETTLED = 3.0  # from when speeds are averaged [s]
CONTROLS: dict[str, Command] = {
    "stand": Command(),
    "forward": Command(0.5),
    "backward": Command(-0.3),
    "left": Command(0.0, 0.3),
    "aslant": Command(0.3, -0.2),
    "turn": Command(turn=0.5),
}
ASTRAY = 0.2  # largest error of the mean speed of one that does what it is told [m/s], [rad/s]
DRIFT = 0.1  # most that one may move that is told to stand, from SETTLED on [m]
ROBOTS = ("g1", "t1", "jvrc1", "apollo", "berkeley", "op3", "biped")


def robot_of(contract: PolicyContract) -> str:
    """The robot that has all joints of a contract, of those that come with the package.

    Raises:
        MissingExtraError: none of those whose models are installed has.
        InvalidValueError: there is none.
    """
    missing = None
    for name in ROBOTS:
        try:
            contract.present(joint_names(compiled_robot(driven(name))))
        except MissingExtraError as error:
            missing = error
            continue
        except PushRecoveryError:
            continue
        return name
    if missing is not None:
        raise missing
    raise InvalidValueError(
        f"none of {', '.join(ROBOTS)} has the joints of policy {contract.name!r}, such as "
        f"{contract.joints[0]!r}; name the robot with --robot"
    )


@dataclass(frozen=True)
class Control:
    """What became of one unpushed control."""

    command: Command
    fell_at: float | None  # [s]
    velocity: tuple[float, float]  # mean, in the axes of the heading [m/s]
    turn: float  # mean [rad/s]
    drift: float  # between SETTLED and the end [m]

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {**asdict(self), "passed": self.passed}

    @property
    def passed(self) -> bool:
        """Whether it stayed up and did what it was told."""
        if self.fell_at is not None:
            return False
        asked = self.command
        if not (asked.vx or asked.vy or asked.turn):
            return self.drift <= DRIFT
        astray = np.hypot(self.velocity[0] - asked.vx, self.velocity[1] - asked.vy)
        return bool(astray <= ASTRAY and abs(self.turn - asked.turn) <= ASTRAY)


class Controls:
    """Runs unpushed controls of policies on one robot; one environment serves policies with equal servos."""

    def __init__(self, robot: str, trusted: bool = False):
        """Take a robot by its name, robot file or `module:attribute`; `trusted`: see `Contender`."""
        self._robot, self._trusted = robot, trusted
        self._joints = joint_names(compiled_robot(driven(robot_description(robot))))
        self._made: tuple[Any, Any] = (None, None)  # servos and rate, and their environment

    def _env(self, contract: PolicyContract) -> Any:
        asked = contract.servos(self._joints), contract.rate
        if asked != self._made[0]:
            self._made = asked, FullBodyEnv(asked[0], robot=self._robot, control_hz=asked[1])
        return self._made[1]

    def run(self, contract: PolicyContract, command: Command, seconds: float) -> Control:
        """One control."""
        env, seen = self._env(contract), []

        def look(robots: Any) -> None:
            gait = robots.episodes.core.gait
            seen.append((gait.time.item(0), *robots.episodes.core.com[0].tolist(), gait.heading.item(0)))

        scenario = Scenario("control", command=command, duration=seconds)
        policy = Contender(contract, env.unwrapped.episodes, self._trusted)
        outcome = rollout(env, policy, scenario, "control", look)
        time, x, y, heading = np.array(seen).T
        late = time >= min(SETTLED, 0.5 * time[-1])
        way, facing = np.diff([x[late], y[late]]), np.unwrap(heading[late])
        cosine, sine, span = np.cos(facing[1:]), np.sin(facing[1:]), max(time[-1] - time[late][0], 1e-9)
        forward, left = cosine * way[0] + sine * way[1], cosine * way[1] - sine * way[0]
        return Control(
            command,
            None if outcome.survived else outcome.end_time,
            (float(forward.sum() / span), float(left.sum() / span)),
            float((facing[-1] - facing[0]) / span),
            float(np.hypot(x[-1] - x[late][0], y[-1] - y[late][0])),
        )

    def run_all(self, contract: PolicyContract) -> dict[str, Control]:
        """All controls, by name."""
        return {name: self.run(contract, command, SECONDS) for name, command in CONTROLS.items()}


@dataclass(frozen=True)
class Repair:
    """A contract that differs from the one given in one thing."""

    field: str
    what: str  # that was changed, in words
    contract: PolicyContract


DEGREES = 180.0 / np.pi
FACTORS = (2.0, 0.5, 4.0, 0.25, 5.0, 0.2, 10.0, 0.1, 20.0, 0.05, DEGREES, 1.0 / DEGREES)
GAINS = (2.0, 0.5, 4.0, 0.25, 10.0, 0.1)
PERIODS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2)


def repairs(given: PolicyContract) -> Iterator[Repair]:
    """Contracts that differ from one in a single thing, the likely ones first."""

    def changed(field: str, what: str, change: Callable[[Any], None]) -> Repair:
        other = copy.deepcopy(given.contract)
        change(other)
        return Repair(field, what, replace(given, contract=other))

    terms = given.get(TERMS)

    def scale(i: int, factor: float) -> Callable[[Any], None]:
        def change(c: Any) -> None:
            term = c.get(TERMS)[i]
            term["scale"] = (factor * np.broadcast_to(term["scale"], term["dim"])).tolist()

        return change

    def parameter(i: int, key: str, value: Any) -> Callable[[Any], None]:
        def change(c: Any) -> None:
            c.get(TERMS)[i].setdefault("params", {})[key] = value

        return change

    fields = [term_field(term) for term in terms]
    for i, term in enumerate(terms):
        if term["id"] not in ("projected_gravity", "last_action") and "phase" not in term["id"]:
            for factor in FACTORS:
                yield changed(f"{fields[i]}.scale", f"times {factor:g}", scale(i, factor))
        yield changed(f"{fields[i]}.scale", "with the other sign", scale(i, -1.0))
    clocks = [i for i, term in enumerate(terms) if "phase" in term["id"]]
    for period in PERIODS if clocks else ():

        def tick(c: Any, period: float = period) -> None:
            for i in clocks:
                parameter(i, "period", period)(c)

        yield changed(f"{fields[clocks[0]]}.params.period", f"{period:g} s", tick)
    for field, factors in ((SCALE, FACTORS), (STIFFNESS, GAINS), (DAMPING, GAINS)):
        for factor in factors:

            def act(c: Any, field: str = field, factor: float = factor) -> None:
                c.set(field, {name: factor * value for name, value in c.get(field).items()})

            yield changed(field, f"times {factor:g}", act)
    joints = list(given.joints)
    for first, second in combinations(range(len(joints)), 2):
        names = list(joints)
        names[first], names[second] = names[second], names[first]
        what = f"{joints[first]} and {joints[second]} exchanged"
        yield changed(NAMES, what, lambda c, names=names: c.set(NAMES, names))


SHORT = 3.0  # of the first look at a repair [s]
TRY = 0.3  # of a core for that, about [s]


def find_fault(given: PolicyContract, controls: Controls, found: dict[str, Control]) -> Repair | None:
    """The first repair that passes every control, given what became of those of the contract itself.

    A repair has to do better within SHORT at the control that failed first, before the whole of it is run.
    """
    first, tried = next(name for name, one in found.items() if not one.passed), list(repairs(given))
    what = f"it does not pass {first!r}: {len(tried)} contracts that differ in one thing"
    with progress_bars(["contracts"], len(tried), Work(what, about(TRY * len(tried)))) as bars:
        for number, repair in enumerate(tried):
            bars.set("contracts", number, repair.field)
            if controls.run(repair.contract, CONTROLS[first], SHORT).fell_at is not None:
                continue
            if all(controls.run(repair.contract, one, SECONDS).passed for one in CONTROLS.values()):
                return repair
        bars.set("contracts", len(tried))
    return None


@dataclass(frozen=True)
class Diagnosis:
    """What became of the controls of a contract, and the one change that mends it, if there is one."""

    controls: dict[str, Control]
    repair: Repair | None

    @property
    def passed(self) -> bool:
        """Whether every control was passed."""
        return all(control.passed for control in self.controls.values())

    @property
    def verdict(self) -> str:
        """What to make of it, in words."""
        if self.passed:
            return "works"
        if self.repair is not None:
            return "contract at fault"
        return "weak policy, or a fault of its contract that was not tried"


def diagnose(contract: PolicyContract, controls: Controls) -> Diagnosis:
    """Run all controls of a contract; where one is not passed, look for the fault."""
    found = controls.run_all(contract)
    passed = all(control.passed for control in found.values())
    return Diagnosis(found, None if passed else find_fault(contract, controls, found))
