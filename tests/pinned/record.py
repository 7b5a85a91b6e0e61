"""Records the pinned outcomes anew, after a change of the results that the changelog names.

python tests/pinned/record.py

Of each policy as many rows of a suite are kept as COUNTS says, the first ones that hang on nothing small: on
a robot heavier or lighter by MASS, far more than another processor's rounding, every word and count stays
and numbers move by less than STEADY. Hand-written scenarios keep those of their rows of which this is true.
"""

import json
from dataclasses import replace
from pathlib import Path

from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout_all
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.score.suites import get_suite
from test_outcomes import SLOTS, close

FOLDER = Path(__file__).parent
MASS, STEADY = 1e-12, 1e-6
VARIANTS = ("stage-1", "stage-1+cop", "stage-1+momentum", "two-stage-paper", "stage-1-paper", "raibert")
COUNTS = {
    "quick": {"two-stage": 14, **dict.fromkeys(VARIANTS, 6)},
    "standard": {"two-stage": 50},
    "hard": {"two-stage": 14, **dict.fromkeys(VARIANTS, 6)},
}
FIELDS = (
    "scenario_id", "policy", "survived", "recovered", "recovered_at", "failure_reason", "end_time",
    "env_steps", "total_reward", "first_limit",
)  # fmt: skip


def played(env_id: str, policy: str, scenarios: list[Scenario]) -> list[dict]:
    """Outcomes of the scenarios, as JSON has them; None in the place of one that hangs on something small."""
    env = make_env(env_id)
    runs = []
    for mass in (0.0, MASS, -MASS):
        moved = [replace(s, errors=replace(s.errors, mass=s.errors.mass + mass)) for s in scenarios]
        outcomes = rollout_all(env, load_policy(policy, env), moved, policy, SLOTS)
        runs.append([json.loads(json.dumps(outcome.to_dict())) for outcome in outcomes])
    return [
        row if all(close(other, row, STEADY) for other in others) else None
        for row, *others in zip(*runs, strict=True)
    ]


def suites(env_id: str) -> dict:
    """Rows of COUNTS, from scenarios spread over each suite."""
    found: dict = {"env": env_id}
    for suite, counts in COUNTS.items():
        found[suite] = []
        for policy, count in counts.items():
            scenarios = list(get_suite(suite).scenarios)
            rows = played(env_id, policy, scenarios[:: len(scenarios) // (2 * count)])
            steady = [{key: row[key] for key in FIELDS} for row in rows if row is not None]
            found[suite] += steady[:count]
    return found


def by_hand(name: str) -> dict:
    """A file of hand-written scenarios with its rows run anew, less those that are not steady."""
    pinned = json.loads((FOLDER / f"{name}.json").read_text())
    scenarios = {entry["id"]: Scenario.from_dict(entry) for entry in pinned["scenarios"]}
    policies = dict.fromkeys(row["policy"] for row in pinned["rows"])
    rows = [row for policy in policies for row in played(pinned["env"], policy, list(scenarios.values()))]
    return {"env": pinned["env"], "scenarios": pinned["scenarios"], "rows": [row for row in rows if row]}


def write(name: str, content: dict) -> None:
    """One line an entry of every list."""
    parts = []
    for key, value in content.items():
        if isinstance(value, list):
            entries = ",\n".join(f"  {json.dumps(entry)}" for entry in value)
            parts.append(f' "{key}": [\n{entries}\n ]')
        else:
            parts.append(f' "{key}": {json.dumps(value)}')
    (FOLDER / f"{name}.json").write_text("{\n" + ",\n".join(parts) + "\n}\n")


if __name__ == "__main__":
    write("suites", suites("PushRecovery/Biped-v0"))
    write("biped", by_hand("biped"))
