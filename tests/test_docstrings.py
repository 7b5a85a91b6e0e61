"""Docstrings: what stands in backticks exists, and first lines say something by themselves."""

import ast
import builtins
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("controllers", "envs", "eval", "training", "src")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
QUOTED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")


def names_of(tree: ast.AST) -> set[str]:
    """Every identifier of a syntax tree, and the words of its short strings that are no docstrings."""
    found = set()
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)]
    for node in ast.walk(tree):
        if node in texts and isinstance(node, ast.Constant):
            continue
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                found.add(name)
            case ast.Name(id=name) | ast.Attribute(attr=name):
                found.add(name)
            case ast.arg(arg=name) | ast.keyword(arg=str(name)):
                found.add(name)
            case ast.alias(name=name, asname=other):
                found |= {*name.split("."), other or ""}
            case ast.Constant(value=str(text)) if len(text) < 80:
                found.update(re.findall(r"[\w+-]+", text))
    return found


def described(tree: ast.AST) -> list[tuple[str, str]]:
    """Names and docstrings of a module and of its classes and functions."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = [node for node in ast.walk(tree) if isinstance(node, kinds)]
    found = [(getattr(node, "name", "module"), ast.get_docstring(node) or "") for node in nodes]
    return [(name, text) for name, text in found if text]


def test_names_in_backticks_exist():
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
    known = {name for tree in trees.values() for name in names_of(tree)} | set(dir(builtins))
    known |= {part for path in FILES for part in path.relative_to(ROOT).with_suffix("").parts}
    stale = [
        f"{path.relative_to(ROOT)}, {name}: `{quoted}`"
        for path, tree in trees.items()
        for name, text in described(tree)
        for quoted in QUOTED.findall(text)
        if not set(quoted.split(".")) <= known
    ]
    assert not stale


def test_the_check_finds_a_stale_name():
    tree = ast.parse('def f(size):\n    """Call `g` with `size`, as `f.size` says."""\n')
    (described_one,) = described(tree)
    assert QUOTED.findall(described_one[1]) == ["g", "size", "f.size"]
    assert names_of(tree) == {"f", "size"}
    assert described(ast.parse("def f(): pass")) == []
