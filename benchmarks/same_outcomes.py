"""Whether two policies of one evaluation had the same outcomes, row by row and field by field.

python benchmarks/same_outcomes.py runs/DIR/outcomes.jsonl A B
"""

import json
import sys
from pathlib import Path


def main() -> None:
    """Print how many rows are equal; exit code 1 where one differs."""
    path, *names = sys.argv[1:]
    rows: dict[str, dict[str, dict[str, object]]] = {name: {} for name in names}
    for line in Path(path).read_text().splitlines():
        row = json.loads(line)
        policy = row.pop("policy")
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
