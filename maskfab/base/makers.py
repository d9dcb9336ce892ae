"""Which functions give a quantity or raise an error, and which tests guard them: read from the code, kept by nobody.

A function is a maker of a name if it holds that name as a text, or an f-string that a family of names matches. The
formula is what its docstring says; tests stand in a checkout only.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from maskfab.base.quantities import FAMILIES

PACKAGE = Path(__file__).resolve().parents[1]
_TESTS = PACKAGE.parent / "tests"
_WORDED = ("report/pages", "cli", "base", "_bundled")
"""Rooms that word what others find, and are no makers of it; and what a wheel brings beside the package."""
_MOST_TESTS = 5


@dataclass(frozen=True)
class Maker:
    """A function that makes something of a name.

    Attributes:
        function: with its module, ``optics.metrics.mtf_quantities``.
        place: file and line, relative to the folder of the package.
        formula: what its docstring says before arguments and errors; that of its module where it has none.
    """

    function: str
    place: str
    formula: str


def makers(name: str, family: str) -> tuple[Maker, ...]:
    """Makers of a quantity (``family`` by the registry: ``mtf{percent}`` for mtf50) or of an error code; maybe none."""
    pattern = re.compile(re.sub(r"\{(\w+)\}", lambda word: rf"(?:{FAMILIES[word[1]]}|\{{\}})", family), re.DOTALL)
    # A name may stand whole, or be put together of a beginning or an end and what a loop gives.
    stems = [max(re.split(r"\{\w+\}", family), key=len)]
    for joint in re.finditer("_", name):
        stems += [name[: joint.end()] + "{", "}" + name[joint.start() :]]
    found = []
    for path, text in _sources(PACKAGE):
        place = path.relative_to(PACKAGE).as_posix()
        if any(stem in text for stem in stems) and not place.startswith(_WORDED):
            tree = ast.parse(text)
            for function in _holders(tree, name, pattern):
                words = ast.get_docstring(function) or (ast.get_docstring(tree) or "").partition("\n\n")[0]
                formula = re.split(r"\n\n(?:Args|Raises|Returns|Attributes|Examples):", words)[0]
                module = place.removesuffix(".py").replace("/", ".")
                found.append(Maker(f"{module}.{function.name}", f"{PACKAGE.name}/{place}:{function.lineno}", formula))
    return tuple(found)


@cache
def _sources(folder: Path) -> tuple[tuple[Path, str], ...]:
    return tuple((path, path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.py")))


def _holders(tree: ast.AST, name: str, pattern: re.Pattern[str]) -> Iterator[ast.FunctionDef]:
    """Innermost functions that hold a text of that pattern, or one that the name completes."""
    for child in ast.iter_child_nodes(tree):
        inner = list(_holders(child, name, pattern))
        yield from inner
        if isinstance(child, ast.FunctionDef) and not inner:
            texts = list(_texts(child))
            if any(pattern.fullmatch(text) or ("{}" in text and _completes(name, text)) for text in texts):
                yield child


def _completes(name: str, text: str) -> bool:
    """Whether a name begins or ends as an f-string does, to an underscore, and fits the rest."""
    parts = text.split("{}")
    ends = parts[0].endswith("_") or parts[-1].startswith("_")
    return ends and re.fullmatch(".+".join(map(re.escape, parts)), name) is not None


def _texts(function: ast.FunctionDef) -> Iterator[str]:
    for node in ast.walk(function):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)


def guards(name: str, maker: Maker) -> tuple[str, ...]:
    """Tests, as pytest calls them, that speak most of the name or its function's module; none where not installed."""
    module, _, function = maker.function.rpartition(".")
    named, called = re.compile(rf"[\"']{re.escape(name)}[\"']"), re.compile(rf"\b{re.escape(function)}\b")
    counted = []
    # Beside an installed package others may have left theirs.
    for path, text in _sources(_TESTS) if (PACKAGE.parent / "pyproject.toml").exists() else ():
        imports = f"maskfab.{module} " in text
        if named.search(text) or (imports and called.search(text)):
            functions = (node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef))
            for node in (node for node in functions if node.name.startswith("test_")):
                spoken = ast.unparse(node)
                if count := len(named.findall(spoken)) + imports * len(called.findall(spoken)):
                    counted.append((-count, f"tests/{path.relative_to(_TESTS).as_posix()}::{node.name}"))
    return tuple(test for _, test in sorted(counted)[:_MOST_TESTS])
