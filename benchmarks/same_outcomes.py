"""Whether two policies of one evaluation had the same outcomes in every field but their names.

python benchmarks/same_outcomes.py runs/DIR/outcomes.jsonl A B
"""

import json
import sys
from pathlib import Path
from typing import Any


def main() -> None:
    """Print how many rows are equal; exit code 1 where one differs."""
    path, *names = sys.argv[1:]
    rows: dict[str, dict[str, dict[str, Any]]] = {name: {} for name in names}
    for line in Path(path).read_text().splitlines():
        row = json.loads(line)
        policy, _ = row.pop("policy"), row.pop("policy_sha256", None)
        if policy in rows:
            rows[policy][row["scenario_id"]] = row
    a, b = (rows[name] for name in names)
    different = [scenario for scenario in a if a[scenario] != b.get(scenario)]
    print(f"{len(a) - len(different)} of {len(a)} rows equal")
    for scenario in different[:10]:
        print(f"  {a[scenario]}\n  {b.get(scenario)}")
    raise SystemExit(bool(different) or a.keys() != b.keys())


if __name__ == "__main__":
    main()
