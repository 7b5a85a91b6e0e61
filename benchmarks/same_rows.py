"""Whether this tree gives the rows and numbers of another commit, bit for bit.

python benchmarks/same_rows.py HEAD                runs both trees: quick-1, hard and reproduce, every variant
python benchmarks/same_rows.py HEAD --suites varied --no-reproduce
python benchmarks/same_rows.py --a DIR --b DIR     of finished runs: folders that hold DIR/quick-1, DIR/hard,
                                                   DIR/reproduce, or are such folders themselves

The other commit gets a git worktree and a virtual environment of its own below `--out`, where its runs stay
and are resumed; this tree runs anew. Every row and every number that the reference A holds must be in B with
the same digits; what B has besides is counted and allowed. Exit code 0 where all are equal, otherwise 1.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
VARIANTS = (
    "passive",
    "stage-1-paper",
    "stage-1",
    "stage-1+cop",
    "stage-1+momentum",
    "two-stage-paper",
    "two-stage",
)
NUMBERS = "reproduction.json"
ROWS = "outcomes.jsonl"
SHOWN = 10  # differences of a folder


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Every number and word of a JSON value with where it stands; digits as JSON writes them."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from leaves(part, f"{path}/{key}")
    elif isinstance(value, list):
        yield f"{path}/length", str(len(value))
        for i, part in enumerate(value):
            yield from leaves(part, f"{path}/{i}")
    else:
        yield path, json.dumps(value)


def rows_of(path: Path) -> dict[str, str]:
    """Leaves of all rows of an outcome file, by policy and scenario, or by a job's key."""
    found: dict[str, str] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        row = json.loads(line)
        name = row.get("key") or f"{row['policy']}/{row['scenario_id']}"
        found.update(leaves(row, name))
    return found


def content_of(folder: Path) -> dict[str, str]:
    """What a finished run says: the numbers of a reproduction, otherwise the rows of an evaluation.

    A reproduction's rows are named by hashes of their settings, which may change while its numbers stay.
    """
    if (folder / NUMBERS).is_file():
        return dict(leaves(json.loads((folder / NUMBERS).read_text(encoding="utf-8"))))
    return rows_of(folder / ROWS)


def runs_in(folder: Path) -> dict[str, Path]:
    """Finished runs by name: the folder itself, or those in it."""
    if not folder.is_dir():
        raise SystemExit(f"{folder} is no folder of runs")
    found = {"": folder} if (folder / ROWS).is_file() else {}
    found |= {path.name: path for path in sorted(folder.iterdir()) if (path / ROWS).is_file()}
    if not found:
        raise SystemExit(f"{folder} holds no run: neither {ROWS} nor a folder with one")
    return {"": folder} if "" in found else found


def compare(a: dict[str, str], b: dict[str, str]) -> tuple[list[str], int]:
    """Where B differs from the reference A or lacks something of it, and how many entries only B has."""
    different = [name for name, text in a.items() if b.get(name) != text]
    return different, len(b.keys() - a.keys())


def report(a: Path, b: Path) -> bool:
    """Print what is equal, run by run; True where all of A is in B."""
    first, second = runs_in(a), runs_in(b)
    equal = True
    for name, folder in first.items():
        if name not in second:
            print(f"{name}: B has no such run")
            equal = False
            continue
        one, other = content_of(folder), content_of(second[name])
        different, more = compare(one, other)
        equal = equal and not different and bool(one)
        print(f"{name or a}: {len(one) - len(different)} of {len(one)} entries equal, {more} only in B")
        for entry in different[:SHOWN]:
            print(f"  {entry}: {one[entry]} in A, {other.get(entry, 'nothing')} in B")
    return equal


def run(command: list[str], where: Path) -> None:
    """A command in a folder; its failure ends this one."""
    print("+", *command, f"  (in {where})", flush=True)
    done = subprocess.run(command, cwd=where, check=False)  # noqa: S603
    if done.returncode != 0:
        raise SystemExit(f"{command[0]} ended with exit code {done.returncode}")


def reference_tree(commit: str, out: Path) -> tuple[Path, str]:
    """Worktree of a commit with an environment of its own, made where it is missing; its Python."""
    tree = out / "tree"
    if not (tree / "pyproject.toml").is_file():
        run(["git", "worktree", "prune"], ROOT)
        run(["git", "worktree", "add", "--force", "--detach", str(tree), commit], ROOT)
    python = tree / ".venv" / "bin" / "python"
    if not (tree / ".venv" / "installed").is_file():
        run([sys.executable, "-m", "venv", ".venv"], tree)
        run([str(python), "-m", "pip", "install", "-q", "-c", "constraints.txt", "-e", "."], tree)
        (tree / ".venv" / "installed").touch()
    return tree, str(python)


def suite_file(name: str, out: Path) -> str:
    """The suite of this tree as a file, which the other tree can read whatever its own suites are."""
    from push_recovery.eval.score.suites import get_suite

    path = out / f"{Path(name).stem}.json"
    get_suite(name).save(path)
    return str(path)


def run_all(python: str, tree: Path, out: Path, options: argparse.Namespace, anew: bool) -> None:
    """Evaluate the suites with every variant, and reproduce, of one tree; into folders of `out`."""
    command, again = [python, "-m", "push_recovery"], ["--overwrite"] * anew
    for suite in options.suites:
        into = str(out / Path(suite).stem)
        asked = ["--suite", suite, "--policies", *options.policies, "--out", into]
        run([*command, "evaluate", *asked, *again], tree)
    if options.reproduce:
        run([*command, "reproduce", "--out", str(out / "reproduce"), *again], tree)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Options; either a commit or two folders."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("commit", nargs="?", help="the reference: any name that git knows")
    parser.add_argument("--a", type=Path, help="finished runs of the reference")
    parser.add_argument("--b", type=Path, help="finished runs to hold against them")
    parser.add_argument("--suites", nargs="*", default=["quick-1", "hard"], help="suites to run")
    parser.add_argument("--policies", nargs="+", default=list(VARIANTS), help="policies to run")
    parser.add_argument(
        "--no-reproduce", dest="reproduce", action="store_false", help="leave `reproduce` out"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "same-rows", help="where all of it goes")
    options = parser.parse_args(arguments)
    if (options.commit is None) == (options.a is None) or (options.a is None) != (options.b is None):
        parser.error("give either a commit, or two folders by --a and --b")
    return options


def main(arguments: list[str] | None = None) -> None:
    """Run what is asked for and compare."""
    options = parse(arguments)
    a, b = options.a, options.b
    if options.commit is not None:
        name = ["git", "rev-parse", "--short", f"{options.commit}^{{commit}}"]
        found = subprocess.run(name, cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S603
        if found.returncode != 0:
            raise SystemExit(f"{options.commit!r} is no commit of this repository")
        out = options.out.resolve() / found.stdout.strip()
        a, b = out / "a", out / "b"
        out.mkdir(parents=True, exist_ok=True)
        options.suites = [suite_file(name, out) for name in options.suites]
        tree, python = reference_tree(found.stdout.strip(), out)
        run_all(python, tree, a, options, anew=False)
        run_all(sys.executable, ROOT, b, options, anew=True)
    raise SystemExit(0 if report(a, b) else 1)


if __name__ == "__main__":
    main()
