"""What outcomes depend on: a sample of a suite under other solvers, steps, losses and delays.

Each variation is a profile that changes one thing of the exact robot or its physics, and some together; each
is held against the exact robot on the same pushes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...controllers.validation import require_choice, require_integer
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors, PhysicsOptions
from ...envs.scenario.scenario import COLLISIONS, EXACT, HARDWARE, ONBOARD, PROFILES, Profile
from ..output.statistics import PairedCounts
from ..output.tables import Table, markdown_page, write_reports
from ..rollout import DEFAULT_ENV
from ..rollout.environments import profile_on
from ..rollout.outcome import Score
from .evaluate import Evaluation, evaluate
from .suites import Suite

NUMERICS = (  # of which no result should hang
    ("step-1ms", PhysicsOptions(time_step=0.001)),
    ("step-0.5ms", PhysicsOptions(time_step=0.0005)),
    ("euler", PhysicsOptions(integrator="euler")),
    ("implicit", PhysicsOptions(integrator="implicit")),
    ("rk4", PhysicsOptions(integrator="rk4")),
    ("rk4-0.5ms", PhysicsOptions(time_step=0.0005, integrator="rk4")),
    ("cg", PhysicsOptions(solver="cg")),
    ("pgs", PhysicsOptions(solver="pgs")),
    ("elliptic", PhysicsOptions(cone="elliptic")),
    ("elliptic-impratio-10", PhysicsOptions(cone="elliptic", impratio=10.0)),
    ("contacts-4ms", PhysicsOptions(contact_time=0.004)),
    ("contacts-20ms", PhysicsOptions(contact_time=0.02)),
    ("fine", PhysicsOptions(time_step=0.0005, cone="elliptic", impratio=10.0, contact_time=0.004)),
)
MODEL_ERRORS = (  # one at a time
    ("floor-0.6", ModelErrors(friction=0.6)),
    ("floor-0.7", ModelErrors(friction=0.7)),
    ("floor-1.2", ModelErrors(friction=1.2)),
    ("joint-friction-1", ModelErrors(joint_friction=1.0)),
    ("joint-friction-2", ModelErrors(joint_friction=2.0)),
    ("joint-damping-1", ModelErrors(joint_damping=1.0)),
    ("armature-0.03", ModelErrors(armature=0.03)),
    ("armature-0.05", ModelErrors(armature=0.05)),
    ("delay-4ms", ModelErrors(delay=0.004)),
    ("delay-10ms", ModelErrors(delay=0.01)),
    (COLLISIONS.name, COLLISIONS.errors),
    ("motor-2kW", ModelErrors(motor_power=2000.0)),
    ("bus-3kW", ModelErrors(bus_power=3000.0)),
    ("bus-1.5kW", ModelErrors(bus_power=1500.0)),
    ("continuous-0.4", ModelErrors(continuous_torque=0.4)),
)
SENSES = Profile("onboard", sensing=ONBOARD)  # the exact robot on its own sensors
VARIATIONS: Mapping[str, Profile] = {
    EXACT.name: EXACT,
    **{name: Profile(name, EXACT_MODEL, physics) for name, physics in NUMERICS},
    **{name: Profile(name, errors) for name, errors in MODEL_ERRORS},
    **{profile.name: profile for profile in (SENSES, HARDWARE)},
}


@dataclass(frozen=True)
class Change:
    """One policy under one variation, beside itself on the same pushes without."""

    variation: str
    score: Score
    recovered: PairedCounts  # a: under the variation, b: exact
    survived: PairedCounts

    def to_dict(self) -> dict[str, Any]:
        """Counts, and the difference of the recovery rates with its interval and p value."""
        return {
            "recovered": self.score.recovered,
            "survived": self.score.survived,
            "episodes": self.score.episodes,
            "lost": self.recovered.only_b,
            "gained": self.recovered.only_a,
            "rate_difference": self.recovered.rate_difference,
            "ci95": list(self.recovered.interval),
            "mcnemar_p": self.recovered.p_value,
            "survived_lost": self.survived.only_b,
            "survived_gained": self.survived.only_a,
        }


@dataclass(frozen=True)
class Sensitivity:
    """Outcomes of policies on the same pushes under every variation."""

    suite: Suite  # that the sample is of
    pushes: int  # in the sample
    variations: tuple[str, ...]  # the first is EXACT
    evaluation: Evaluation

    def changes(self, policy: str) -> list[Change]:
        """Outcomes of a policy under each variation, in order."""
        rows = self.evaluation.rows[policy]
        parts = [rows[i : i + self.pushes] for i in range(0, len(rows), self.pushes)]
        found = []
        for name, part in zip(self.variations, parts, strict=True):
            pairs = (PairedCounts.of_rows(part, parts[0], field) for field in ("recovered", "survived"))
            found.append(Change(name, Score.of(part), *pairs))
        return found

    def to_dict(self) -> dict[str, Any]:
        """Policy -> variation -> counts."""
        return {
            "suite": self.suite.summary(),
            "sample": self.pushes,
            "env": self.evaluation.env_id,
            "policies": {
                policy: {change.variation: change.to_dict() for change in self.changes(policy)}
                for policy in self.evaluation.rows
            },
            "out": str(self.evaluation.directory),
        }


def sample_of(suite: Suite, count: int) -> Suite:
    """`count` scenarios of a suite, evenly spread over its order: numbers floor(i n / count)."""
    most = len(suite.scenarios)
    require_integer("sample", count, 1, most)
    scenarios = tuple(suite.scenarios[i * most // count] for i in range(count))
    return Suite(f"{suite.name}-{count}", suite.version, scenarios)


def varied_by(suite: Suite, variations: Sequence[str], env_id: str = DEFAULT_ENV) -> Suite:
    """The scenarios of a suite under each variation, EXACT first, with ids of their own.

    Named profiles (exact, collisions, hardware) are scaled to the environment's robot; the other variations
    are not.
    """
    for name in variations:
        require_choice("variation", name, list(VARIATIONS))
    if variations[0] != EXACT.name or len(set(variations)) < len(variations):
        raise InvalidValueError(
            f"variations must be distinct and begin with {EXACT.name!r}, got {', '.join(variations)}"
        )
    found = {name: profile_on(env_id, name) if name in PROFILES else VARIATIONS[name] for name in variations}
    scenarios = tuple(
        replace(found[name].applied(scenario), id=f"{scenario.id}/{name}")
        for name in variations
        for scenario in suite.scenarios
    )
    return Suite(f"{suite.name}-sensitivity", suite.version, scenarios)


def sensitivity(
    suite: Suite,
    count: int,
    env_id: str,
    policies: Any,
    variations: Sequence[str] = tuple(VARIATIONS),
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Sensitivity:
    """Run a sample of a suite under every variation; a run that was stopped goes on where it was.

    Model errors and physics that the scenarios have themselves stand; the exact robot comes first whether it
    is named or not.

    Raises:
        PushRecoveryError: as `evaluate`, `sample_of` and `varied_by`.
    """
    rest = list(variations)
    if EXACT.name in rest:
        rest.remove(EXACT.name)
    names = (EXACT.name, *rest)
    pushes = varied_by(sample_of(suite, count), names, env_id)
    evaluation = evaluate(pushes, env_id, policies, workers, directory, overwrite)
    return Sensitivity(suite, count, names, evaluation)


NOTE = (
    "Lost and gained: pushes that the exact robot recovers from and this one does not, and the other way "
    "round. Difference: rate of recovery minus that of the exact robot, with its 95 % score interval "
    "(Newcombe). p: exact McNemar. What a variation is: docs/generated/sensitivity.md."
)


def sensitivity_tables(result: Sensitivity) -> list[Table]:
    """Counts of each policy under every variation, and how they differ from those of the exact robot."""
    suite, tables = result.suite, []
    for policy in result.evaluation.rows:
        lines = []
        for change in result.changes(policy):
            pairs, compared = change.recovered, ("-", "-")
            if change.variation != EXACT.name:
                low, high = pairs.interval
                difference = f"{pairs.rate_difference:+.3f} ({low:+.3f} to {high:+.3f})"
                compared = difference, f"{pairs.p_value:.2g}"
            counts = change.score.recovered, change.score.survived, pairs.only_b, pairs.only_a
            lines.append((change.variation, *map(str, counts), *compared))
        title = (
            f"{result.evaluation.env_id}: {policy}, {result.pushes} pushes of suite {suite.name} "
            f"v{suite.version}, sha256 {suite.sha256[:12]}"
        )
        columns = "variation", "recovered", "survived", "lost", "gained", "difference of rates", "p"
        tables.append(Table(title, columns, lines, NOTE))
    return tables


def write_sensitivity_reports(result: Sensitivity) -> Path:
    """Write report.json and report.md into the directory; returns the path of the latter."""
    markdown = markdown_page("Sensitivity", sensitivity_tables(result))
    return write_reports(result.evaluation.directory, result.to_dict(), markdown)
