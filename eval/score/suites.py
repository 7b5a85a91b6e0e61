"""Versioned suites of scenarios: the same pushes for every policy, addressed by a hash of their content.

Built-in suites have names, to which `register_suite` adds; `new_suite` draws one from a seed.
"""

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

from ...controllers import files, validation
from ...controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError, shown
from ...controllers.model.robot import SAME, Similarity
from ...envs.scenario.distribution import PushDistribution
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.push import GaitEvent
from ...envs.scenario.scenario import EXACT, HARDWARE, Profile, Scenario
from ..output.rows import read_json
from ..protocols.kick import every_kick
from ..rollout import DEFAULT_ENV
from ..rollout.environments import code_digest, env_label, profile_on, robot_of
from ..rollout.load_policy import shipped_digest
from .draw import BLOCK, pelvis_draw
from .kinds import DRAWS, RANGES, SHIFTS

SEED, HARD_SEED, VARIED_SEED, QUICK_SEED = 20180609, 20181121, 20261122, 20261123
STANDING_SEED, DISTURBANCES_SEED, TERRAIN_SEED = 20261125, 20261126, 20261127
BLOCKS = 4  # of 256 scenarios
VERSION = "1"
OF_ROBOT = "@"  # between the name of a suite and that of the robot that it was scaled for
PROFILED = {  # suites of a profile that have names of their own
    "varied+hardware": "hardware",
    "varied-sealed+hardware": "hardware-sealed",
}
# Names of directories under runs/ begin with that of the suite, and terminals show it.
PLAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+=,@-]{0,999}")


def check_name(part: str, text: object) -> None:
    """Raise InvalidValueError where a name or version of a suite is not plain text."""
    if not (isinstance(text, str) and PLAIN_NAME.fullmatch(text)):
        raise InvalidValueError(
            f"a suite's {part} must be 1 to 1000 letters, digits, spaces and ._+=,@- that begin with "
            f"a letter or digit, got {shown(text)}"
        )


@dataclass(frozen=True)
class Suite:
    """A named, versioned, ordered set of scenarios with distinct ids."""

    name: str
    version: str
    scenarios: tuple[Scenario, ...]

    def __post_init__(self) -> None:
        check_name("name", self.name)
        check_name("version", self.version)
        scenarios = validation.require_all("Suite.scenarios", self.scenarios, Scenario)
        object.__setattr__(self, "scenarios", scenarios)
        if not self.scenarios:
            raise InvalidValueError(f"suite {self.name!r} has no scenarios")
        ids = [scenario.id for scenario in self.scenarios]
        if len(set(ids)) != len(ids):
            twice = next(name for name in ids if ids.count(name) > 1)
            raise InvalidValueError(f"suite {self.name!r} has the scenario id {twice!r} more than once")
        for scenario in self.scenarios:
            check_pushes_come(scenario)

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of name, version and all scenarios as canonical JSON."""
        head = json.dumps([self.name, self.version])
        lines = "\n".join([head, *(scenario.to_json() for scenario in self.scenarios)])
        return hashlib.sha256(lines.encode()).hexdigest()

    def summary(self) -> dict[str, Any]:
        """Name, version, hash and number of scenarios."""
        head = {"name": self.name, "version": self.version, "sha256": self.sha256}
        return {**head, "scenarios": len(self.scenarios)}

    def save(self, path: str | Path) -> None:
        """Write the suite as JSON, whole or not at all."""
        content = {**self.summary(), "scenarios": [scenario.to_dict() for scenario in self.scenarios]}
        files.write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def check_pushes_come(scenario: Scenario) -> None:
    """Raise InvalidValueError for an episode that ends before any of its pushes comes."""
    if scenario.duration is None:
        return
    starts = [part.start for part in (*scenario.forces, *scenario.jumps)]
    first = min((0.0 if isinstance(start, GaitEvent) else start for start in starts), default=0.0)
    if first >= scenario.duration:
        raise InvalidValueError(
            f"Scenario.duration [s] of {shown(scenario.id)} must be more than the start of its first push at "
            f"{first:g}, got {scenario.duration:g}"
        )


def load_suite(path: Path) -> Suite:
    """Read a suite file; its `sha256`, where it states one, must match its content.

    Raises:
        InvalidValueError: the file is missing, no suite, or its hash does not match.
    """
    what = f"suite file {str(path)!r}"
    data = read_json(path, "suite file")
    content = validation.require_keys(what, data, {"name", "version", "scenarios"}, {"sha256"})
    if not isinstance(content["scenarios"], list):
        raise InvalidValueError(f"{what}: scenarios must be a list")
    entries = enumerate(content["scenarios"], start=1)
    scenarios = tuple(_read_scenario(f"{what}, scenario {number}", entry) for number, entry in entries)
    suite = Suite(content["name"], content["version"], scenarios)
    if "sha256" in content and content["sha256"] != suite.sha256:
        raise InvalidValueError(
            f"{what} states sha256 {content['sha256']} but its content has {suite.sha256}: "
            "it was changed; remove the sha256 key to use it as a suite of your own"
        )
    return suite


def _read_scenario(where: str, entry: object) -> Scenario:
    """A scenario of a suite file; raises InvalidValueError naming its place."""
    try:
        return Scenario.from_dict(entry)
    except PushRecoveryError as error:
        named = f" ({shown(entry['id'])})" if isinstance(entry, dict) and "id" in entry else ""
        raise InvalidValueError(f"{where}{named}: {error}") from error


def with_errors(suite: Suite, errors: ModelErrors) -> Suite:
    """The same scenarios on robots that are off by `errors`, a suite of its own name and hash.

    Scenarios keep their ids, so that outcomes pair with those of the robot without errors, and their noise
    seeds. No errors give the suite itself.

    Raises:
        InvalidValueError: the suite has errors already.
    """
    if errors == EXACT_MODEL:
        return suite
    if taken := [scenario for scenario in suite.scenarios if scenario.errors != EXACT_MODEL]:
        raise InvalidValueError(
            f"suite {suite.name!r} has model errors already: scenario {taken[0].id!r} has "
            f"{taken[0].errors.to_dict()}"
        )
    values = {name: _value_words(value) for name, value in errors.to_dict().items()}
    label = "+".join(f"{name}={value}" for name, value in values.items())
    scenarios = tuple(replace(scenario, errors=errors) for scenario in suite.scenarios)
    return Suite(f"{suite.name}+{label}", suite.version, scenarios)


def _value_words(value: Any) -> Any:
    """A value of model errors in the name of a suite; of a terrain its kind and a hash of all of it."""
    if isinstance(value, dict):
        whole = json.dumps(value, sort_keys=True).encode()
        return f"{value['kind']}-{hashlib.sha256(whole).hexdigest()[:8]}".replace(" ", "-")
    return ",".join(map(str, value)) if isinstance(value, list) else value


def with_profile(suite: Suite, profile: Profile) -> Suite:
    """The same scenarios on robots of a profile, a suite of its own name and hash; itself for `exact`.

    Scenarios keep their ids and noise seeds; what they say of errors and physics stands.
    """
    if profile == EXACT:
        return suite
    scenarios = tuple(profile.applied(scenario) for scenario in suite.scenarios)
    name = f"{suite.name}+{profile.name}"
    return Suite(PROFILED.get(name, name), suite.version, scenarios)


def on_robots(suite: Suite, errors: ModelErrors, profile: str, env_id: str = DEFAULT_ENV) -> Suite:
    """The suite on robots of an environment with model errors, of the profile with this name."""
    return with_profile(with_errors(suite, errors), profile_on(env_id, profile))


def of_size(suite: Suite, robot: str, size: Similarity) -> Suite:
    """The same scenarios for a robot of another size, a suite of its own name and hash.

    Scenarios keep their ids. Kicks are the same for every robot, since their velocity is what others publish.
    """
    if size == SAME or any(scenario.kicks for scenario in suite.scenarios):
        return suite
    scenarios = tuple(scenario.scaled(size) for scenario in suite.scenarios)
    return Suite(f"{suite.name}{OF_ROBOT}{robot}", suite.version, scenarios)


def _drawn(
    name: str, kind: str, seed: int, blocks: int = BLOCKS, version: str = VERSION, ids: str | None = None
) -> Suite:
    """256 scenarios a block of a kind of DRAWS; their ids begin with the suite's name, or with `ids`."""
    return Suite(name, version, DRAWS[kind].stratified(ids or name, blocks, seed))


def sealed_seed() -> int:
    """Seed of the sealed suites: whoever changes the code or a shipped policy meets other pushes."""
    return int(hashlib.sha256(f"{code_digest()} {shipped_digest()}".encode()).hexdigest(), 16)


SUITES: dict[str, Callable[[], Suite]] = {
    name: cache(maker)
    for name, maker in {
        # 256 pushes of every kind like those of `varied`, up to harder ones
        "quick": lambda: _drawn("quick", "quick", QUICK_SEED, 1, "2"),
        # 1024 of 5-80 N s, 0.1 s at the pelvis, after four nominal steps
        "standard": lambda: _drawn("standard", "standard", SEED),
        # the same, but 80-200 N s: pushes that separate strong controllers
        "hard": lambda: _drawn("hard", "hard", HARD_SEED),
        # 1024 of every kind, see `varied_scenario`
        "varied": lambda: _drawn("varied", "varied", VARIED_SEED),
        # these, by the same ids, on robots of the profile `hardware`
        "hardware": lambda: with_profile(SUITES["varied"](), HARDWARE),
        # 1024 of every kind on robots that stand, see `standing_scenario`
        "standing": lambda: _drawn("standing", "standing", STANDING_SEED),
        # 256 of the kinds that laboratories use, see `laboratory_scenario`
        "disturbances": lambda: _drawn("disturbances", "disturbances", DISTURBANCES_SEED, 1),
        # 256 of pushes on robots that know the floor on which they walk, see `terrain_scenario`
        "terrain": lambda: _drawn("terrain", "terrain", TERRAIN_SEED, 1),
        # these, by the same ids, on robots that do not know it
        "terrain-blind": lambda: _drawn("terrain-blind", "terrain-blind", TERRAIN_SEED, 1, ids="terrain"),
        # 1024 more, of `sealed_seed`: nobody can have looked at them while designing the code
        "quick-sealed": lambda: _drawn("quick-sealed", "quick", sealed_seed()),
        "varied-sealed": lambda: _drawn("varied-sealed", "varied", sealed_seed()),
        "hardware-sealed": lambda: with_profile(SUITES["varied-sealed"](), HARDWARE),
        "hard-sealed": lambda: _drawn("hard-sealed", "hard", sealed_seed()),
        "standing-sealed": lambda: _drawn("standing-sealed", "standing", sealed_seed()),
        "disturbances-sealed": lambda: _drawn("disturbances-sealed", "disturbances", sealed_seed()),
        "terrain-sealed": lambda: _drawn("terrain-sealed", "terrain", sealed_seed()),
        "terrain-blind-sealed": lambda: _drawn(
            "terrain-blind-sealed", "terrain-blind", sealed_seed(), ids="terrain-sealed"
        ),
        # `quick` until its version 2, the first 256 of `standard`, stratified too; the pendulum's still
        "quick-1": lambda: Suite("quick", VERSION, SUITES["standard"]().scenarios[:BLOCK]),
        # 256 pushes like those of `hard`, one thing changed of each
        **{name: partial(_drawn, name, name, shift.seed, 1) for name, shift in SHIFTS.items()},
        # 1200 jumps of the velocity in place
        "kick": lambda: Suite("kick", VERSION, every_kick("stated")),
        "kick-coded": lambda: Suite("kick-coded", VERSION, every_kick("coded")),
    }.items()
}


def register_suite(name: str, maker: Callable[[], Suite]) -> None:
    """Give a suite of one's own a name, which `evaluate` and all others in this process then take.

    Args:
        name: that no suite has; the suite may call itself something else.
        maker: makes the suite, the same each time; called when it is first asked for.

    Raises:
        InvalidValueError: the name is taken, is none, or is that of a file; or the maker can't be called.
    """
    check_name("name", name)
    if name.endswith(".json"):
        raise InvalidValueError(f"a suite's name must not end in .json, as that of a file does, got {name!r}")
    if not callable(maker):
        raise InvalidValueError(f"maker must be a function that gives a Suite, got {shown(maker)}")
    if name in SUITES:
        raise InvalidValueError(f"there is a suite {name!r} already")
    SUITES[name] = cache(maker)


def default_suite(env_id: str) -> str:
    """`quick`; the pendulum, which neither turns nor has a trunk to push, has `quick-1`."""
    return "quick-1" if env_label(env_id).startswith("Pendulum") else "quick"


def pushes_on(env_id: str, suite: str | None, errors: ModelErrors, profile: str) -> Suite:
    """A suite by name or file, or the default one, on robots of an environment: errors, profile and size."""
    named = get_suite(default_suite(env_id) if suite is None else suite, env_id)
    return on_robots(named, errors, profile, env_id)


def get_suite(name_or_file: str, env_id: str = DEFAULT_ENV) -> Suite:
    """A built-in suite by name, of the size of an environment's robot, or one from a JSON file as it is."""
    if name_or_file in SUITES:
        return of_size(SUITES[name_or_file](), *robot_of(env_id))
    path = Path(name_or_file)
    if path.suffix == ".json" or files.is_file(path):
        return load_suite(path)
    raise UnknownNameError("suite", name_or_file, [*SUITES, "FILE.json"])


KINDS = tuple(DRAWS)
LARGEST = 65536  # scenarios
# Fields of a distribution that these suites do not draw: one push all round at the pelvis, of one duration
UNUSED = {
    "direction_min", "direction_max", "errors", "turn", "bodies", "push_duration_ratio", "pushes_max",
}  # fmt: skip


def new_suite(
    like: str = "varied",
    seed: int = 0,
    scenarios: int = BLOCK,
    name: str | None = None,
    pushes: Mapping[str, Any] | None = None,
) -> Suite:
    """A suite drawn like a named one, from another seed; the same arguments give the same suite.

    Args:
        like: one of KINDS.
        seed: of the draw.
        scenarios: how many; every whole 256 of them are stratified.
        name: of the suite; by default that of the kind and the seed.
        pushes: other ranges than those of the kind, by fields of `PushDistribution`; of standard and hard.

    Raises:
        UnknownNameError: another kind, or a field that is none.
        InvalidValueError: a number out of its bounds, an impossible range or name, or ranges of a kind that
            has others.
    """
    validation.require_choice("kind of suite", like, KINDS)
    validation.require_integer("seed", seed)
    validation.require_integer("scenarios", scenarios, 1, LARGEST)
    label, blocks = f"{like}-{seed}" if name is None else name, math.ceil(scenarios / BLOCK)
    check_name("name", label)
    pushes = {} if pushes is None else validation.require_kind("pushes", pushes, Mapping)
    if pushes and like not in RANGES:
        raise InvalidValueError(
            f"only {' and '.join(RANGES)} take other ranges of pushes, not {like!r}: "
            f"got {shown(dict(pushes))}"
        )
    draw = pelvis_draw(_ranges(like, pushes)) if pushes else DRAWS[like]
    drawn = draw.stratified(label, blocks, seed)
    return Suite(label, "1", drawn[:scenarios])


def _ranges(like: str, pushes: Mapping[str, Any]) -> PushDistribution:
    """The ranges of a kind, with other values of some fields."""
    known = RANGES[like].to_dict()
    given = validation.require_keys("ranges of pushes", dict(pushes), set(), set(known) - UNUSED)
    return PushDistribution.from_dict({**known, **given})
