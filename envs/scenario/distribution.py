"""Random scenarios: the pushes, commands and model errors that `reset` draws where it is given none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol

import numpy as np

from ...controllers.errors import InvalidValueError, shown
from ...controllers.model.robot import Similarity
from ...controllers.validation import changed_fields, require_all, require_integer, require_number
from .model_errors import CONTROL_STEP, EXACT_MODEL, ModelErrors
from .push import (
    DURATION_MAX,
    FORCE_MAX,
    STEP_MAX,
    TIME_MAX,
    GaitEvent,
    Push,
    polar_push,
    require_body,
)
from .record import JsonRecord, object_of
from .scenario import FASTEST_TURN, SETTLE_TIME, Command, Scenario

DRAWS = 12  # numbers that a draw takes of its generator, whatever is given
LATER = ("joint_friction", "joint_damping", "armature", "motor_power", "bus_power", "continuous_torque")

Range = tuple[float, float]


@dataclass(frozen=True)
class ErrorRanges(JsonRecord):
    """Uniform ranges (low, high) of model errors for domain randomisation; None: always the default.

    A range of `trunk_com` holds for each of its three components. A delay is drawn in whole control steps of
    the biped.
    """

    json_name, left_out = "error ranges", None

    mass: Range | None = None
    payload: Range | None = None  # [kg]
    trunk_com: Range | None = None  # [m]
    friction: Range | None = None
    slope_forward: Range | None = None  # [rad]
    slope_left: Range | None = None  # [rad]
    delay: Range | None = None  # [s]
    dcm_noise: Range | None = None  # [m]
    joint_noise: Range | None = None  # [rad]
    floor_step: Range | None = None  # [m]
    joint_friction: Range | None = None  # [N m]
    joint_damping: Range | None = None  # [N m s/rad]
    armature: Range | None = None  # [kg m^2]
    motor_power: Range | None = None  # [W]
    bus_power: Range | None = None  # [W]
    continuous_torque: Range | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != 2:
                raise InvalidValueError(f"ErrorRanges.{field.name} must be (low, high), got {shown(value)}")
            low, high = (require_number(f"ErrorRanges.{field.name}", entry) for entry in value)
            if low > high:
                raise InvalidValueError(f"ErrorRanges.{field.name} must have low <= high, got {low} > {high}")
            for bound in (low, high):
                _errors_at(field.name, bound)  # raises where it is out of bounds
            self._set(**{field.name: (low, high)})
        if self.delay is not None and math.ceil(self._delay_steps[0]) > math.floor(self._delay_steps[1]):
            raise InvalidValueError(
                f"ErrorRanges.delay must hold a multiple of {CONTROL_STEP} s, got {self.delay}"
            )

    def scaled(self, scale: Similarity) -> ErrorRanges:
        """The same ranges for a robot of another size."""
        ranges = {}
        for name, bounds in changed_fields(self).items():
            scaled = [getattr(_errors_at(name, bound).scaled(scale), name) for bound in bounds]
            ranges[name] = tuple(bound[0] if name == "trunk_com" else bound for bound in scaled)
        return ErrorRanges(**ranges)

    @property
    def _delay_steps(self) -> Range:
        """Range of the delay in control steps, a hair wider than stated."""
        low, high = self.delay or (0.0, 0.0)
        return low / CONTROL_STEP - 1e-9, high / CONTROL_STEP + 1e-9

    def sample(self, rng: np.random.Generator) -> ModelErrors:
        """Draw errors; always the same number of draws, so that one more range changes no other draw."""
        u, index = rng.random(DRAWS), 0
        # Fields that came later draw from a generator that those numbers seed, so that they change none.
        u = np.concatenate([u, np.random.default_rng(u.view(np.uint64)).random(len(LATER))])
        values: dict[str, Any] = {}
        for field in fields(self):
            count = 3 if field.name == "trunk_com" else 1
            mine = u[index : index + count]
            index += count
            bounds = getattr(self, field.name)
            if bounds is None:
                continue
            if field.name == "delay":
                first, last = math.ceil(self._delay_steps[0]), math.floor(self._delay_steps[1])
                drawn = [CONTROL_STEP * min(first + int(mine[0] * (last - first + 1)), last)]
            else:
                drawn = [float(bounds[0] + x * (bounds[1] - bounds[0])) for x in mine]
            values[field.name] = tuple(drawn) if count == 3 else drawn[0]
        return ModelErrors(**values)


def _errors_at(name: str, bound: float) -> ModelErrors:
    """The model errors with one of them at an end of its range."""
    value: Any = (bound,) * 3 if name == "trunk_com" else bound
    return ModelErrors(**{name: value})


TURNS = 100.0 * math.pi  # bound of a direction, both ways [rad]
COMMAND_KINDS = ("in_place", "forward", "backward", "sideways")
PUSHES_MAX = 100  # of a scenario
LATEST_NEXT = 4  # steps after a push in which the next one comes


class ScenarioDistribution(Protocol):
    """What scenarios are drawn from."""

    def sample(self, rng: np.random.Generator, scenario_id: str | None = None) -> Scenario:
        """Draw one scenario."""
        ...


@dataclass(frozen=True)
class PushDistribution(JsonRecord):
    """Scenarios with one push or more, drawn from a Generator; used by `reset` without a scenario.

    Impulse, direction and phase are uniform; the command is in place, forward, backward or sideways with
    equal probability and a uniform speed up to its maximum. Where `turn` is not 0, half of the robots turn
    besides, at a uniform rate to either side. The push acts on the CoM of one of `bodies`, all of them
    equally likely; one that is named twice is drawn twice as often. Model errors come from `errors`.

    A push lasts `push_duration` and up to `push_duration_ratio` times as long, uniform in the logarithm. A
    scenario has 1 to `pushes_max` pushes, all counts equally likely. Each of n pushes has the impulse drawn
    divided by sqrt(n), on the same body for the same time; a later one comes in one of the four steps after
    that of the push before, half of them in the direction of the first.
    """

    json_name, left_out = "push distribution", ("errors",)

    impulse_min: float = 5.0  # [N s]
    impulse_max: float = 80.0  # [N s]
    direction_min: float = -math.pi  # psi, counter-clockwise from forward [rad]
    direction_max: float = math.pi  # [rad]
    phase_max: float = 0.9  # latest start, fraction of the step
    push_duration: float = 0.1  # least duration [s]
    push_duration_ratio: float = 1.0  # longest duration over the least
    pushes_max: int = 1  # largest number of pushes
    first_step: int = 4  # pushes start no earlier than this step
    forward_speed: float = 0.5  # [m/s]
    backward_speed: float = 0.25  # [m/s]
    sideways_speed: float = 0.2  # [m/s], to either side
    turn: float = 0.0  # fastest, of the half of the robots that turns [rad/s]
    settle_time: float = SETTLE_TIME  # [s]
    bodies: tuple[str, ...] = ("pelvis",)  # that pushes act on, as `Push.body` names them
    errors: ErrorRanges | None = None  # of the robot, drawn anew for every scenario

    def __post_init__(self) -> None:
        self._set(errors=object_of(ErrorRanges, self.errors))
        if not isinstance(self.errors, ErrorRanges | None):
            raise InvalidValueError(f"PushDistribution.errors must be ErrorRanges, got {shown(self.errors)}")
        require_number("PushDistribution.impulse_min [N s]", self.impulse_min, 0.0)
        require_number("PushDistribution.impulse_max [N s]", self.impulse_max, self.impulse_min)
        require_number("PushDistribution.direction_min [rad]", self.direction_min, -TURNS, TURNS)
        require_number("PushDistribution.direction_max [rad]", self.direction_max, self.direction_min, TURNS)
        require_number("PushDistribution.phase_max", self.phase_max, 0.0, 1.0)
        duration = self.push_duration
        require_number("PushDistribution.push_duration [s]", duration, 0.0, DURATION_MAX, open_low=True)
        hardest = self.impulse_max / duration
        if not hardest <= FORCE_MAX:
            raise InvalidValueError(
                f"PushDistribution.impulse_max / push_duration must be at most {FORCE_MAX:g} N, got "
                f"{self.impulse_max:g} N s / {duration:g} s = {hardest:g} N"
            )
        longest = DURATION_MAX / duration
        require_number("PushDistribution.push_duration_ratio", self.push_duration_ratio, 1.0, longest)
        require_integer("PushDistribution.pushes_max", self.pushes_max, 1, PUSHES_MAX)
        require_integer("PushDistribution.first_step", self.first_step, high=STEP_MAX)
        for name in ("forward_speed", "backward_speed", "sideways_speed"):
            require_number(f"PushDistribution.{name} [m/s]", getattr(self, name), 0.0, 5.0)
        require_number("PushDistribution.turn [rad/s]", self.turn, 0.0, FASTEST_TURN)
        require_number("PushDistribution.settle_time [s]", self.settle_time, 0.0, TIME_MAX, open_low=True)
        self._set(bodies=require_all("PushDistribution.bodies", self.bodies, str))
        if not self.bodies:
            raise InvalidValueError("PushDistribution.bodies must name at least one body")
        for body in self.bodies:
            require_body(body)

    def scaled(self, scale: Similarity) -> PushDistribution:
        """The same distribution for a robot of another size."""
        fastest = Command(self.forward_speed, self.sideways_speed, self.turn).scaled(scale)
        return replace(
            self,
            impulse_min=self.impulse_min * scale.impulse,
            impulse_max=self.impulse_max * scale.impulse,
            push_duration=self.push_duration * scale.time,
            forward_speed=fastest.vx,
            backward_speed=self.backward_speed * scale.velocity,
            sideways_speed=fastest.vy,
            turn=fastest.turn,
            settle_time=self.settle_time * scale.time,
            errors=None if self.errors is None else self.errors.scaled(scale),
        )

    def command(self, kind: int, speed: float, to_left: bool) -> Command:
        """Command of a kind (index into COMMAND_KINDS) at a fraction `speed` in [0, 1] of its maximum."""
        if COMMAND_KINDS[kind] == "forward":
            return Command(vx=speed * self.forward_speed)
        if COMMAND_KINDS[kind] == "backward":
            return Command(vx=-speed * self.backward_speed)
        if COMMAND_KINDS[kind] == "sideways":
            return Command(vy=(speed if to_left else -speed) * self.sideways_speed)
        return Command()

    def turning(self, share: float, side: float) -> float:
        """Rate at which a robot turns [rad/s], of two uniform draws: 0 in the lower half of the first one."""
        return (2.0 * side - 1.0) * self.turn if share >= 0.5 else 0.0

    def body(self, rng: np.random.Generator) -> str:
        """The body that a push acts on; no draw where there is only one."""
        return self.bodies[0 if len(self.bodies) == 1 else int(rng.integers(len(self.bodies)))]

    def duration(self, rng: np.random.Generator) -> float:
        """Duration of a push [s]; no draw where all last equally long."""
        ratio = self.push_duration_ratio
        return self.push_duration * (1.0 if ratio == 1.0 else ratio ** float(rng.random()))

    def with_later(self, push: Push, walk: Scenario, step: int, rng: np.random.Generator) -> tuple[Push, ...]:
        """A push and those that come after it; no draw where there is one only.

        Args:
            push: of the whole impulse, which all of them share.
            walk: whose steps they come in.
            step: that the first one comes in, since reset.
            rng: of the draws, whose number does not depend on that of the pushes.
        """
        if self.pushes_max == 1:
            return (push,)
        count = int(rng.integers(1, self.pushes_max + 1))
        draws = rng.random((self.pushes_max - 1, 3))[: count - 1].tolist()
        force = math.hypot(*push.force) / math.sqrt(count)
        pushes = [polar_push(force, push.direction, push.duration, push.start, push.body)]
        for pause, turn, phase in draws:
            step += 1 + int(pause * LATEST_NEXT)
            event = GaitEvent(step, walk.side_of_step(step), phase * self.phase_max)
            other = self.direction_min + (2.0 * turn - 1.0) * (self.direction_max - self.direction_min)
            psi = push.direction if turn < 0.5 else other
            pushes.append(polar_push(force, psi, push.duration, event, push.body))
        return tuple(pushes)

    def sample(self, rng: np.random.Generator, scenario_id: str | None = None) -> Scenario:
        """Draw one scenario; of one distribution all take equally many draws, so that episodes compare."""
        u = rng.random(8)
        noise_seed = int(rng.integers(2**31))
        errors = EXACT_MODEL if self.errors is None else self.errors.sample(rng)
        impulse = self.impulse_min + u[0] * (self.impulse_max - self.impulse_min)
        direction = self.direction_min + u[1] * (self.direction_max - self.direction_min)
        event = GaitEvent(self.first_step, "left" if u[2] < 0.5 else "right", float(u[3] * self.phase_max))
        kind = min(int(u[4] * len(COMMAND_KINDS)), len(COMMAND_KINDS) - 1)
        command = self.command(kind, float(u[5]), bool(u[6] < 0.5))
        if self.turn:
            command = replace(command, turn=self.turning(*rng.random(2).tolist()))
        body, duration = self.body(rng), self.duration(rng)
        push = polar_push(float(impulse / duration), float(direction), duration, event, body)
        scenario = Scenario(
            id=scenario_id or f"random-{noise_seed:08x}",
            pushes=(push,),
            command=command,
            stance_side="left" if u[7] < 0.5 else "right",
            settle_time=self.settle_time,
            noise_seed=noise_seed,
            errors=errors,
        )
        step = event.step_index(scenario.stance_side)
        return replace(scenario, pushes=self.with_later(push, scenario, step, rng))
