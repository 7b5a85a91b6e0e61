"""Do the tests notice small faults? Each of benchmarks/mutants.toml, one at a time, in a copy of the tree.

python benchmarks/mutants.py                 all that no results are kept of yet
python benchmarks/mutants.py --only gait     those whose file or text holds a word
python benchmarks/mutants.py --check         only whether every fault still finds its place
python benchmarks/mutants.py --table         only the table of what is known

A fault is a piece of text that stands exactly once in its file, and what takes its place. The tests that
mirror the file run first, then the pinned outcomes; the first that fails has caught it. Kernels of the copies
are kept beside the results, so that a fault compiles anew what it changes and no more. Results are kept as
they come: a run that is ended goes on where it was, and `--anew` starts over. Several may run at once, each
with `--only` of its own. Exit code 1 where fewer are caught than WANTED.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FAULTS = Path(__file__).with_suffix(".toml")
PACKAGES = ("controllers", "envs", "eval", "training")
OUTCOMES = "tests/pinned"  # the last resort: outcomes of whole episodes
SLOWEST = 900  # of the tests of one fault, compiling included [s]
WANTED = 0.85  # share to be caught
FAILED, NOTHING_RAN = 1, (2, 3, 4, 5)  # pytest's exit codes


@dataclass(frozen=True)
class Mutant:
    """A fault: in this file, this text is replaced."""

    file: str
    old: str
    new: str
    tests: tuple[str, ...]  # in the order in which they run
    judged: str = ""  # why it may survive

    @property
    def key(self) -> str:
        """Name of its result."""
        return hashlib.sha256("\0".join((self.file, self.old, self.new)).encode()).hexdigest()[:12]


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant."""

    key: str
    verdict: str  # caught, survived or broken
    by: str  # the tests that caught it


def mirrored_tests(file: str) -> tuple[str, ...]:
    """Tests of a source file: of its module, of its room, and outcomes for what moves."""
    path = Path(file)
    room = Path("tests") / path.parent
    module = room / f"test_{path.stem}.py"
    found = [str(target) for target in (module, room) if (ROOT / target).exists()]
    return (*found, *([OUTCOMES] if path.parts[0] in ("controllers", "envs") else []))


def read_mutants(path: Path) -> list[Mutant]:
    """The list, each with its tests; ends the run where a fault or a test does not find its place."""
    mutants, lost = [], []
    for entry in tomllib.loads(path.read_text(encoding="utf-8"))["file"]:
        file = entry["path"]
        text = (ROOT / file).read_text(encoding="utf-8") if (ROOT / file).is_file() else ""
        first = entry.get("first", ())
        lost += [f"{file}: there is no {test}" for test in first if not (ROOT / test.split("::")[0]).exists()]
        tests = (*first, *mirrored_tests(file))
        for old, new, *judged in entry["mutants"]:
            if text.count(old) != 1 or old == new:
                lost.append(f"{file}: found {text.count(old)} times: {old!r}")
            mutants.append(Mutant(file, old, new, tests, "".join(judged)))
    if lost:
        raise SystemExit(
            "every fault must find its place exactly once, and every test its file:\n" + "\n".join(lost)
        )
    if len({mutant.key for mutant in mutants}) != len(mutants):
        raise SystemExit("a fault stands twice in the list")
    return mutants


def copy_tree(target: Path) -> None:
    """Copy what git knows or would know, and a package folder from which the copy is imported."""
    shutil.rmtree(target, ignore_errors=True)
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    package = target / "import" / "push_recovery"
    package.mkdir(parents=True)
    for name in PACKAGES:
        (package / name).symlink_to(target / name)
    for path in (target / "src" / "push_recovery").iterdir():
        (package / path.name).symlink_to(path)
    command = [sys.executable, "-c", "import push_recovery.controllers as c; print(c.__file__)"]
    variables = environment(target, target)
    found = subprocess.check_output(command, env=variables, text=True)  # noqa: S603
    if not found.startswith(str(target)):
        raise SystemExit(f"the copy in {target} is not what is imported, but {found}")


def environment(tree: Path, kernels: Path) -> dict[str, str]:
    """Variables under which the copy is imported, and its kernels kept apart."""
    return {**os.environ, "PYTHONPATH": str(tree / "import"), "NUMBA_CACHE_DIR": str(kernels)}


def run_tests(tree: Path, targets: str, kernels: Path) -> int:
    """Exit code of pytest in the copy; FAILED where it takes too long."""
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    command, variables = [sys.executable, "-m", "pytest", *options, targets], environment(tree, kernels)
    try:
        return subprocess.run(  # noqa: S603
            command, cwd=tree, env=variables, timeout=SLOWEST, capture_output=True, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        return FAILED


def judge(mutant: Mutant, tree: Path, kernels: Path) -> Verdict:
    """Put the fault in, run its tests until one fails, and take the fault out again."""
    path = tree / mutant.file
    whole = path.read_text(encoding="utf-8")
    try:
        path.write_text(whole.replace(mutant.old, mutant.new), encoding="utf-8")
        for targets in mutant.tests:
            code = run_tests(tree, targets, kernels)
            if code == FAILED:
                return Verdict(mutant.key, "caught", targets)
            if code in NOTHING_RAN:
                return Verdict(mutant.key, "broken", targets)
        return Verdict(mutant.key, "survived", "")
    finally:
        path.write_text(whole, encoding="utf-8")


def known_verdicts(path: Path) -> dict[str, Verdict]:
    """Results so far, by key."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return {row["key"]: Verdict(**row) for row in map(json.loads, lines)}


def table(mutants: list[Mutant], known: dict[str, Verdict]) -> Iterator[str]:
    """Lines of Markdown: counts by package, then what was not caught."""
    yield "| package | faults | caught | survived | broken | not run |"
    yield "|---|---|---|---|---|---|"
    for package in (*PACKAGES, ""):
        chosen = [m for m in mutants if m.file.startswith(package)]
        count = Counter(known[m.key].verdict if m.key in known else "not run" for m in chosen)
        numbers = [len(chosen), *(count[name] for name in ("caught", "survived", "broken", "not run"))]
        yield f"| {package or 'all'} | " + " | ".join(map(str, numbers)) + " |"
    for mutant in mutants:
        verdict = known.get(mutant.key)
        if verdict is not None and verdict.verdict != "caught":
            yield f"- {verdict.verdict}: {mutant.file}: `{mutant.old}` -> `{mutant.new}`. {mutant.judged}"


def run_missing(mutants: list[Mutant], known: dict[str, Verdict], out: Path) -> None:
    """Judge what no result is kept of."""
    missing = [mutant for mutant in mutants if mutant.key not in known]
    if not missing:
        return
    tree, kernels = out / f"tree-{os.getpid()}", out / "kernels"
    copy_tree(tree)
    try:
        judge_all(missing, known, tree, kernels, out / "verdicts.jsonl")
    finally:
        shutil.rmtree(tree, ignore_errors=True)


def judge_all(
    missing: list[Mutant], known: dict[str, Verdict], tree: Path, kernels: Path, results: Path
) -> None:
    """Judge mutants in a copy, each result kept as it comes; what catches one must pass without any."""
    sound: set[str] = set()
    with results.open("a", encoding="utf-8") as file:
        for i, mutant in enumerate(missing):
            verdict = judge(mutant, tree, kernels)
            if verdict.by not in {"", *sound} and run_tests(tree, verdict.by, kernels) != 0:
                raise SystemExit(f"{verdict.by} fails without any fault, too")
            sound.add(verdict.by)
            known[mutant.key] = verdict
            file.write(json.dumps(asdict(verdict)) + "\n")
            file.flush()
            print(f"{i + 1}/{len(missing)} {verdict.verdict} {mutant.file}: {mutant.old!r}", flush=True)


def main() -> None:
    """Run what is asked for, print the table."""
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=layout)
    parser.add_argument("--only", default="", help="faults whose file or text holds this word")
    parser.add_argument("--check", action="store_true", help="only whether every fault finds its place")
    parser.add_argument("--table", action="store_true", help="run nothing")
    parser.add_argument("--anew", action="store_true", help="forget the results so far")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "mutants", help="results and copies")
    options = parser.parse_args()
    mutants = [m for m in read_mutants(FAULTS) if options.only in f"{m.file} {m.old}"]
    print(f"{len(mutants)} faults, each in its place")
    if options.check:
        return
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if options.anew:
        (out / "verdicts.jsonl").unlink(missing_ok=True)
    known = known_verdicts(out / "verdicts.jsonl")
    if not options.table:
        run_missing(mutants, known, out)
    print("\n".join(table(mutants, known)))
    judged = [known[m.key].verdict for m in mutants if m.key in known]
    raise SystemExit(0 if judged and judged.count("caught") >= WANTED * len(judged) else 1)


if __name__ == "__main__":
    main()
