"""Settings of a training run, frozen, as JSON and as options; those of the shipped policies by name.

How a shipped policy is trained stands in RECIPES and nowhere else.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import gymnasium as gym
import numpy as np
from tyro.conf import AvoidSubcommands, Positional, Suppress, arg

from ..controllers.errors import InvalidValueError, UnknownNameError, is_finite_number, is_integer, shown
from ..controllers.files import is_file
from ..controllers.policies.learned import LONGEST_HOLD, policy_paths
from ..controllers.policies.mlp import BASE, GATE, MARGIN, OBSERVATION, check_inputs
from ..controllers.policies.residual import DEFAULT_GATE, check_gate, check_residual_scale
from ..controllers.validation import require_choice, require_integer, require_number
from ..envs.scenario.distribution import ErrorRanges, PushDistribution
from ..envs.scenario.model_errors import EXACT_MODEL
from ..envs.scenario.scenario import FASTEST_TURN, get_profiles
from ..eval.rollout.load_policy import training_note
from ..eval.score.kinds import DRAWS, SuiteDistribution
from .actor import check_critic
from .reward import REWARDS

STARTS = ("push", "reset")
# Subclasses of `training.algorithm.Algorithm`, or MODULE:CLASS of one, which is imported where it is used
ALGORITHMS: dict[str, Any] = {"ppo": ".ppo:PPOAlgorithm"}
# Least and most of what is counted: beyond it a run would never end, or find no memory
COUNTS = {
    "timesteps": (0, 10**15), "value_first": (0, 10**15), "seed": (0, 2**31 - 1), "retries": (0, 10**6),
    "n_envs": (1, 100_000), "n_steps": (1, 100_000), "batch_size": (1, 10**7), "n_epochs": (1, 10**6),
    "checkpoint_every": (1, 10**15), "evaluate_every": (1, 10**15), "evaluation_scenarios": (1, 100_000),
    "walks": (1, 10**6), "threads": (1, 1024), "hold": (1, LONGEST_HOLD),
}  # fmt: skip
WIDEST = 65_536  # of a hidden layer
LOG_STD_MAX = 20.0  # of a logarithm of the standard deviation, both ways
# What the id of a kind's environment has after the robot's name. A residual run wraps the gait environment
# itself, so that the policy also scores on the plain one.
FORM_OF_KIND = {"residual": "", "scratch": "", "joint": "Joint", "joint-residual": "JointResidual"}
# Initial log-std of the action: of a residual 0.14 of its scale, of joints about 0.2 rad.
LOG_STD = {"residual": -2.0, "scratch": -1.0, "joint": -1.5, "joint-residual": -1.5}
TAUGHT_ENV = "PushRecovery/BipedJoint-v0"  # of what a teacher shows (`envs.joint.taught`)
# Hard pushes, most of which the planner recovers from
TRAINING_PUSHES = PushDistribution(impulse_min=70.0, impulse_max=210.0, settle_time=2.5)
# Values of settings that older runs lack
LATER: dict[str, Any] = {
    "initial": None,
    "critic": [],
    "algorithm": "ppo",
    "device": "cpu",
    "threads": 1,
    "like": [],
    "target_kl": None,
    "wanted_kl": None,
    "log_std_end": None,
    "retries": 0,
}
Report = Callable[[int, str], None]  # timesteps so far, and how it goes, in words
Widths = Annotated[tuple[int, ...], arg(metavar="N [N ...]")]
# Kinds of settings in words
WORDS: dict[Any, str] = {int: "an integer", float: "a finite number", str: "a name", bool: "True or False",
                         NoneType: "None", PushDistribution: "a PushDistribution"}  # fmt: skip


def _is_of(value: Any, hint: Any) -> bool:
    """Whether a value is of the kind of an annotation; any name is of a `Literal`."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_is_of(value, part) for part in parts)
    if origin is tuple:
        if not isinstance(value, tuple | list):
            return False
        kinds = parts[:1] * len(value) if parts[-1] is Ellipsis else parts
        return len(kinds) == len(value) and all(map(_is_of, value, kinds))
    check = {int: is_integer, float: is_finite_number}.get(hint)
    return isinstance(value, str if origin is Literal else hint) if check is None else check(value)


def _words(hint: Any) -> str:
    """The kind of an annotation in words, such as "[a finite number, a finite number] or None"."""
    parts = ["..." if part is Ellipsis else _words(part) for part in get_args(hint)]
    if get_origin(hint) is tuple:
        return f"[{', '.join(parts)}]"
    return " or ".join(parts) if parts else WORDS.get(hint, str(hint))


def env_of_kind(kind: str, env_id: str) -> str:
    """Id of the form of the same robot in which a kind is trained, where the robot has one; else the id."""
    if kind == "residual":
        found = re.sub(r"(?<!Joint)Residual(?=-v\d+$)", "", env_id)
    else:
        found = re.sub(r"(?=-v\d+$)", FORM_OF_KIND[kind], env_id)
    return found if found in gym.registry else env_id


@dataclass(frozen=True)
class TrainingSettings:
    """One training run; the defaults are those with which PPO worked on the biped.

    These are the options of `push-recovery train` too, with what stands beside them as their help; those
    marked Suppress the command line gives in another form (`--env`, `--scale`) or not at all.
    """

    kind: Positional[Literal["residual", "scratch", "joint", "joint-residual"]] = "residual"
    """what is trained. residual: a correction of `policy`; scratch: a network that acts alone, in the same
    action space; joint: a network that acts alone, on joint targets; joint-residual: a correction of the
    joint torques of two-stage and whole-body control"""
    env_id: Suppress[str] = "PushRecovery/Biped-v0"
    timesteps: int = 4_000_000  # number of learned actions; each lasts `hold` periods; 0: untrained
    seed: int = 0  # seed of weights, exploration and pushes
    n_envs: int = 128  # number of environments side by side
    hold: Annotated[int | None, arg(metavar="{None|N}")] = None
    """number of planning periods of 10 ms for which a learned action is held; None: 2, and 1 on joints, where
    an action belongs to a stance foot"""
    policy: str = "two-stage"  # the policy that a residual corrects
    scale: Suppress[tuple[float, ...] | None] = None  # (7,) in action units; None: that of `ResidualAction`
    gate: Annotated[tuple[float, ...] | None, arg(metavar="{None|SHUT OPEN}")] = DEFAULT_GATE
    """DCM errors at which the gate of a residual begins to open and is open [m]; None: always open"""
    teacher: bool = False
    """whether a policy on joints begins as what the planner shows (DAgger, minutes; docs/training.md) rather
    than untrained"""
    initial: Annotated[str | None, arg(metavar="{None|NAME|FILE}")] = None
    """policy that the run begins as, with its layers and inputs; None: untrained, or as the teacher shows"""
    value_first: int = 0  # number of timesteps at first in which only the value network learns
    inputs: Annotated[tuple[str, ...] | None, arg(metavar="{None|BLOCK [BLOCK ...]}")] = None
    """what the network sees: blocks of observation, base, gate, margin; None: all that the kind has"""
    critic: Annotated[tuple[str, ...], arg(metavar="[BLOCK ...]")] = ()
    """what only the value network sees besides: push (the impulse to come), place (where it acts and for how
    long), schedule (when later pushes come), sensing (the sensors' errors)"""

    # What is trained on, and for what
    starts: Literal["push", "reset"] | None = None
    """when episodes begin. push: at the moment of a push, in walks that are put back; reset: at a reset, with
    `pushes` to come; None: push where robots can be put back"""
    reward: Annotated[str | None, arg(metavar=f"{{None,{','.join(REWARDS)}}}")] = None
    """what is rewarded. recovery: 1 for it, -1 for a fall, the capture margin as a potential; environment:
    the environment's own reward; steps: that, and each touchdown by what recovery is judged by; None:
    recovery where robots share one core, but environment for joint"""
    profile: Annotated[tuple[str, ...], arg(metavar="NAME [NAME ...]")] = ("exact",)
    """profiles of the robots, exact, collisions, hardware or weighed; of several each robot draws one"""
    errors: Annotated[tuple[tuple[str, float, float], ...], arg(metavar="[NAME LOW HIGH ...]")] = ()
    """ranges of `ErrorRanges` that each robot's model is drawn from, such as friction 0.4 1.0: domain
    randomisation"""
    pushes: Annotated[PushDistribution, AvoidSubcommands] = TRAINING_PUSHES
    """pushes of most training episodes; scores use other pushes"""
    like: Annotated[tuple[str, ...], arg(metavar="[KIND ...]")] = ()
    """kinds of suites, as in `suite new --like`, that pushes and commands are drawn like, all equally often,
    instead of from `pushes`, and that the learning curve is of"""
    easy: Annotated[tuple[float, float], arg(metavar="LOW HIGH")] = (5.0, 80.0)
    """impulses of the other episodes, so that nothing easy is forgotten [N s]"""
    easy_share: float = 0.05  # share of episodes that have an easy push
    least_acceptance: float = 0.1
    """chance that a push is taken whose kind is always or never recovered from; 1: all are taken alike"""
    retries: int = 0  # how often a push that was lost comes again
    walks: int = 1500  # number of walks that are put back, each of another robot and command

    # Proximal policy optimisation, or another algorithm
    algorithm: Annotated[str, arg(metavar="{ppo}")] = "ppo"  # learning algorithm
    device: str = "cpu"
    """where torch learns, cpu or cuda; the robots are simulated on the processor's cores either way"""
    threads: int = 1
    """threads of an update on a processor, which pay for layers of 256 and more; others give other weights,
    by rounding"""
    n_steps: int = 64  # number of learned actions per environment and update
    batch_size: int = 1024  # largest batch; the largest divisor of n_envs x n_steps up to it is taken
    n_epochs: int = 5  # number of passes over the actions of an update
    gamma: float = 0.99  # discount per learned action
    gae_lambda: float = 0.95  # lambda of the generalised advantage estimate
    clip_range: float = 0.2  # range to which the ratio of probabilities is clipped
    target_kl: Annotated[float | None, arg(metavar="{None|X}")] = None
    """divergence from the policy of the rollout at which an update ends before its last pass"""
    wanted_kl: Annotated[float | None, arg(metavar="{None|X}")] = None
    """divergence of an update from the policy of the rollout that the rate is held near: 1.5 times less after
    an update of more than twice as much, 1.5 times more after one of less than half; None: see the rates"""
    learning_rate: float = 3e-4  # rate of Adam at the start; it falls linearly to that at the end
    learning_rate_end: float = 1e-5  # rate of Adam at the end
    policy_layers: Widths = (128, 128)  # widths of the hidden layers of the policy
    value_layers: Widths = (256, 256)  # widths of the hidden layers of the value network
    log_std: Annotated[float | tuple[float, ...] | None, arg(metavar="{None|X [X ...]}")] = None
    """initial logarithm of the standard deviation, one or one per action; None: that of the kind"""
    log_std_end: Annotated[float | None, arg(metavar="{None|X}")] = None
    """largest logarithm of the standard deviation at the end; the bound falls linearly from the initial one;
    None: no bound"""
    normalise_reward: bool | None = None
    """divide the reward by the running deviation of the return; None: only with the reward
    environment"""

    # Reports
    checkpoint_every: int = 100_000  # least number of timesteps between checkpoints
    evaluate_every: int = 500_000  # least number of timesteps between evaluations
    evaluation_scenarios: int = 512  # number of pushes of an evaluation

    def __post_init__(self) -> None:
        require_choice("kind of training", self.kind, tuple(FORM_OF_KIND))
        for entry in fields(self):
            if isinstance(value := getattr(self, entry.name), list):
                self._set(entry.name, tuple(value))
        if isinstance(self.profile, str):
            self._set("profile", (self.profile,))
        if isinstance(self.pushes, dict):
            self._set("pushes", PushDistribution.from_dict(self.pushes))
        for name, (least, most) in COUNTS.items():
            if name != "hold" or self.hold is not None:
                require_integer(f"training setting {name}", getattr(self, name), least, most)
        for name, hint in HINTS.items():
            self._check(name, _is_of(getattr(self, name), hint), _words(hint))
        require_integer("training setting n_steps x n_envs", self.rollout, 2)
        if self.minibatch == 1:
            raise InvalidValueError(
                f"training setting batch_size must allow minibatches of more than 1, got {self.batch_size} "
                f"for {self.rollout} timesteps, which it has to divide"
            )
        self._check("teacher", not self.teacher or self.kind == "joint", "False but for the kind joint")
        self._check("initial", not (self.initial and self.teacher), "None beside a teacher")
        for name in ("gamma", "gae_lambda", "least_acceptance"):
            self._check(name, 0 < getattr(self, name) <= 1, "in (0, 1]")
        for name in ("clip_range", "learning_rate", "learning_rate_end"):
            value = getattr(self, name)
            self._check(name, math.isfinite(value) and value > 0, "positive and finite")
        self._check("easy_share", 0 <= self.easy_share <= 1, "in [0, 1]")
        for name, valid in (("starts", STARTS), ("reward", REWARDS), ("algorithm", ALGORITHMS)):
            if (value := getattr(self, name)) is not None:
                require_choice(f"training setting {name}", value, tuple(valid))
        self._check(
            "device", re.fullmatch(r"cpu|cuda(:\d+)?", self.device) is not None, "cpu, cuda or cuda:N"
        )
        for name in ("target_kl", "wanted_kl"):
            value = getattr(self, name)
            self._check(name, value is None or 0 < value < math.inf, "None or positive")
        for kind in self.like:
            require_choice("kind of suite", kind, tuple(DRAWS))
            middle = DRAWS[kind].scenario(kind, np.full(DRAWS[kind].coordinates, 0.5), 0)
            self._check("like", bool(middle.pushes), "kinds that push")
            put_back = self.starts == "push" and middle.errors != EXACT_MODEL
            self._check(
                "like", not put_back, "kinds of pushes alone, or starts reset: walks keep their robot"
            )
        get_profiles(self.profile)
        self._set("errors", tuple(tuple(one) for one in self.errors))
        self.easy_pushes  # noqa: B018  # raises where it is impossible
        if self.gate is not None:
            self._set("gate", check_gate(self.gate))
        if self.inputs is not None:
            self._set("inputs", check_inputs(self.inputs, self.residual))
        self._set("critic", check_critic(self.critic))
        for name in ("policy_layers", "value_layers", "log_std"):
            self._check(name, getattr(self, name) != (), "one number or more")
        for name in ("policy_layers", "value_layers"):
            for width in getattr(self, name):
                require_integer(f"training setting {name}", width, 1, WIDEST)
        for value in self.initial_log_std:
            require_number("training setting log_std", value, -LOG_STD_MAX, LOG_STD_MAX)
        if self.log_std_end is not None:
            require_number("training setting log_std_end", self.log_std_end, -LOG_STD_MAX, LOG_STD_MAX)
        self._set("env_id", env_of_kind(self.kind, self.env_id.removeprefix("push_recovery:")))
        if self.teacher and (self.env_id, self.periods) != (TAUGHT_ENV, 1):
            raise InvalidValueError(
                f"a teacher shows the joints of {TAUGHT_ENV} at every planning period (hold 1), "
                f"not those of {self.env_id} at hold {self.periods}"
            )
        if self.kind == "joint-residual" and self.policy != "two-stage":
            raise InvalidValueError(f"a joint residual corrects two-stage, not {self.policy!r}")
        if self.scale is not None:
            if not self.residual:
                raise InvalidValueError(
                    f"a scale belongs to residual training, which corrects gait actions, not to {self.kind!r}"
                )
            self._set("scale", tuple(check_residual_scale(self.scale).tolist()))

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _check(self, name: str, good: bool, wanted: str) -> None:
        if not good:
            raise InvalidValueError(
                f"training setting {name} must be {wanted}, got {shown(getattr(self, name))}"
            )

    @property
    def residual(self) -> bool:
        """Whether the network corrects a policy's gait actions."""
        return self.kind == "residual"

    @property
    def drawn_pushes(self) -> PushDistribution:
        """Pushes of most training episodes, on robots with `errors` where any are given."""
        ranges = {name: (low, high) for name, low, high in self.errors}
        return replace(self.pushes, errors=ErrorRanges.from_dict(ranges)) if ranges else self.pushes

    @property
    def drawn_like(self) -> SuiteDistribution | None:
        """The same, of the kinds of suites in `like`; None where there are none."""
        pushes = self.drawn_pushes
        return SuiteDistribution(self.like, pushes.settle_time, pushes.errors) if self.like else None

    @property
    def easy_pushes(self) -> PushDistribution:
        """Pushes of the other episodes: the same, with the impulses of `easy`."""
        return replace(self.drawn_pushes, impulse_min=self.easy[0], impulse_max=self.easy[1])

    @property
    def on_joints(self) -> bool:
        """Whether the environment takes actions of the joints."""
        return self.kind in {"joint", "joint-residual"}

    @property
    def periods(self) -> int:
        """Planning periods for which a learned action is held."""
        return self.hold or (1 if self.on_joints else 2)

    def left_open(self, own: bool, walks: bool) -> dict[str, Any]:
        """What is taken where hold, inputs, starts and reward are None.

        Args:
            own: in an environment of this project.
            walks: and in one whose robots a planner walks to where they are pushed.
        """
        inputs: tuple[str, ...] = (OBSERVATION,)
        if own and not self.on_joints:
            inputs += (BASE, GATE, MARGIN) if self.residual else (MARGIN,)
        # A policy on joints has to walk by itself and learns nothing from ends alone
        reward = "recovery" if own and self.kind != "joint" else "environment"
        starts = "push" if walks else "reset"
        return {"hold": self.periods, "inputs": inputs, "starts": starts, "reward": reward}

    @property
    def initial_log_std(self) -> tuple[float, ...]:
        """Log of the exploration noise at the start, one for all actions or one per action."""
        if self.log_std is None:
            return (LOG_STD[self.kind],)
        return self.log_std if isinstance(self.log_std, tuple) else (float(self.log_std),)

    @property
    def rollout(self) -> int:
        """Timesteps between two updates."""
        return self.n_envs * self.n_steps

    @property
    def minibatch(self) -> int:
        """The largest divisor of a rollout up to `batch_size`."""
        sizes = range(1, min(self.batch_size, self.rollout) + 1)
        return max(size for size in sizes if self.rollout % size == 0)

    def to_json(self) -> dict[str, Any]:
        """Every setting, as JSON types."""
        values = {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self).items()}
        return values | {"pushes": self.pushes.to_dict(), "errors": [list(one) for one in self.errors]}

    @classmethod
    def from_json(cls, values: Any) -> TrainingSettings:
        """The settings that `to_json` wrote; those of runs before a setting of LATER go without it.

        Raises:
            InvalidValueError: The keys are not exactly the settings, or a value is impossible.
        """
        names = {field.name for field in fields(cls)}
        if not isinstance(values, dict) or set(values) | LATER.keys() != names:
            found = sorted(values) if isinstance(values, dict) else values
            raise InvalidValueError(f"training settings must have the keys {sorted(names)}, got {found}")
        whole: dict[str, Any] = LATER | values
        try:
            return cls(**whole)
        except (TypeError, LookupError, AttributeError, ArithmeticError) as error:
            raise InvalidValueError(f"training settings: {error}") from error


HINTS = get_type_hints(TrainingSettings)
del HINTS["scale"], HINTS["gate"]  # which have checks of their own
RESIDUAL = TrainingSettings("residual")
# What corrects torques has to know how to turn by itself
TURNING = replace(TRAINING_PUSHES, turn=FASTEST_TURN)
# Of every kind, which small batches don't learn (docs/notebook/training.md#larger-batches)
EVERY_KIND = replace(
    RESIDUAL,
    like=("quick", "quick", "hard"),
    pushes=TURNING,
    critic=("push", "schedule"),
    n_envs=256,
    batch_size=4096,
    target_kl=0.05,
    timesteps=5_000_000,
)
# An action on joints lasts half as long. With less noise than by default it learns half as much
# (docs/notebook/training.md#more-noise)
JOINT_RESIDUAL = replace(
    EVERY_KIND, kind="joint-residual", gamma=0.995, timesteps=12_000_000, evaluate_every=1_000_000
)
# By smaller batches, on pushes like those of hard; it began as the exact one of its time
RESIDUAL_ON_HARDWARE = replace(
    RESIDUAL,
    initial="residual",
    profile=("hardware",),
    critic=("push", "sensing"),
    value_first=100_000,
    learning_rate=2e-4,
    timesteps=2_000_000,
)
# By large batches again: with this noise they pay on hardware, too (docs/notebook/training.md#more-noise)
JOINT_ON_HARDWARE = replace(
    JOINT_RESIDUAL,
    initial="joint-residual",
    profile=("hardware",),
    errors=(("friction", 0.5, 1.0), ("delay", 0.0, 0.01)),
    critic=("push", "schedule", "sensing"),
    value_first=100_000,
    learning_rate=2e-4,
    timesteps=2_000_000,
    evaluate_every=1_000_000,
)
# The same on robots of others, on as many actions as two cores had time for
JOINT_ON_ROBOT = {
    f"joint-residual-{robot.lower()}": replace(
        JOINT_RESIDUAL, env_id=f"PushRecovery/{robot}JointResidual-v0", timesteps=10_000_000
    )
    for robot in ("G1", "T1", "JVRC1")
}
# Of networks that have no planner to fall back on: the easy ones, too
ALL_PUSHES = replace(TRAINING_PUSHES, impulse_min=5.0)
# Half on the pelvis, where `hard` has them, the others where the tour's punches bring a G1 down
ON_G1 = replace(
    TRAINING_PUSHES, impulse_min=30.0,
    bodies=(
        *8 * ("pelvis",), *2 * ("trunk",), "left_foot", "right_foot",
        *2 * ("link:left_elbow_joint",), "link:left_shoulder_yaw_joint",
        *2 * ("link:right_elbow_joint",), "link:right_shoulder_yaw_joint",
    ),
)  # fmt: skip
# Without a planner and a teacher (docs/training.md#joints-from-nothing)
FROM_NOTHING = TrainingSettings(
    "joint",
    like=("quick", "varied", "hard"),
    pushes=replace(ALL_PUSHES, turn=FASTEST_TURN),
    reward="steps",
    critic=("push", "place", "schedule"),
    n_envs=256,
    batch_size=4096,
    n_epochs=4,
    policy_layers=(256, 256),
    wanted_kl=0.01,
    log_std_end=-2.1985,
    threads=2,
    timesteps=25_400_000,
    evaluate_every=1_000_000,
)
RECIPES = {  # in the order of `NAMES` in eval/rollout/load_policy.py
    "residual": EVERY_KIND,
    "residual-hardware": RESIDUAL_ON_HARDWARE,
    "scratch": TrainingSettings("scratch", pushes=ALL_PUSHES),
    "joint": FROM_NOTHING,
    "joint-residual": JOINT_RESIDUAL,
    "joint-residual-hardware": JOINT_ON_HARDWARE,
    "residual-g1": replace(RESIDUAL, env_id="PushRecovery/G1-v0", pushes=ON_G1),
    **JOINT_ON_ROBOT,
    "joint-g1": replace(
        FROM_NOTHING, env_id="PushRecovery/G1Joint-v0", log_std_end=-2.0885, timesteps=21_400_000
    ),
}  # fmt: skip


def get_recipe(name: str) -> TrainingSettings:
    """The settings of a shipped policy, by name, or those that the policy of a file was trained with.

    Raises:
        UnknownNameError: neither a name nor a file; lists the names.
        InvalidValueError: the file can't be read, or says nothing of a training by this version's settings.
    """
    if name in RECIPES:
        return RECIPES[name]
    path = policy_paths(name)[1]
    if not is_file(path):
        raise UnknownNameError("recipe", name, [*RECIPES, "FILE.json of a policy"])
    return file_settings(path)


def file_settings(path: Path) -> TrainingSettings:
    """Settings that stand under `training` in a policy's JSON.

    Raises:
        InvalidValueError: see `get_recipe`.
    """
    note = training_note(path)
    try:
        settings = note["settings"]
    except (KeyError, TypeError):
        raise InvalidValueError(f"{path} does not say what its policy was trained with") from None
    return TrainingSettings.from_json(settings)


def difference(recipe: TrainingSettings, settings: TrainingSettings) -> str | None:
    """A setting in which a run differs from a recipe, or None.

    A run may have settled what its recipe leaves open, as the recipe's environment does, and may learn on
    another device.
    """
    own = recipe.env_id.startswith("PushRecovery/")
    settled = recipe.left_open(own, walks=own and recipe.kind != "joint")
    for name in (entry.name for entry in fields(TrainingSettings) if entry.name != "device"):
        asked, found = getattr(recipe, name), getattr(settings, name)
        same = asked == found or (asked is None and found == settled.get(name))
        if name == "log_std" and asked is None:
            same = recipe.initial_log_std == settings.initial_log_std
        if not same:
            return name
    return None


def command_of(settings: TrainingSettings, file: str) -> str:
    """The command that trains with these settings again; `file` is the policy's where no recipe has them."""
    name = next((name for name, recipe in RECIPES.items() if difference(recipe, settings) is None), file)
    return f"push-recovery train --recipe {name}"
