"""`push-recovery list`."""

from __future__ import annotations

from dataclasses import dataclass

from ..options import JsonOption


@dataclass(frozen=True, kw_only=True)
class Names(JsonOption):
    """Names that the other commands take."""

    def run(self) -> None:
        """Print the names."""
        from ...rollout.environments import env_ids
        from ...rollout.load_policy import FORMS, policy_names
        from ...score.suites import SUITES

        suites = {name: {**make().summary(), "name": name} for name, make in SUITES.items()}
        if self.json:
            self.print_json(
                {"envs": env_ids(), "policies": list(policy_names()), "suites": list(suites.values())}
            )
            return
        print("environments:", *env_ids(), sep="\n  ")
        print("policies:", *policy_names(), *FORMS, sep="\n  ")
        print("suites:")
        for name, suite in suites.items():
            print(f"  {name} v{suite['version']}: {suite['scenarios']} pushes, sha256 {suite['sha256']}")
