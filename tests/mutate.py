"""How sharp the tests are: small faults are planted in the package, and the nearest tests must see them.

    python tests/mutate.py                        200 faults in optics, mask, display and camera, drawn by seed 0
    python tests/mutate.py --count 40 --seed 7 --rooms optics

A fault changes one comparison, sign, factor, number, bound or word of a condition. It is planted in a copy of the
package, and at most three test files are run against it: those that import the module and speak most of the function,
else those that import its nearest importers. Printed are the faults that no test saw; those that EQUIVALENT names
change nothing that can be seen, and count as neither.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("optics", "mask", "display", "camera")
LONGEST_S = 240
"""Seconds after which the tests of a fault are ended; whether they see it is then not known, and it does not count."""
LATE = f"ended after {LONGEST_S} s"
COMPARED = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
REVERSED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Div}
JOINED = {ast.And: ast.Or, ast.Or: ast.And}
RENAMED = {"min": "max", "max": "min", "floor": "ceil", "ceil": "floor", "any": "all", "all": "any"}
EQUIVALENT: dict[str, str] = {
    "maskfab/optics/phase.py defocus_error: `math.ceil(abs(edge))` -> `math.floor(abs(edge))`": (
        "both numbers of Gauss points are ample: the Strehl ratios agree to 3e-14"
    ),
}
"""Faults that nobody could see, as printed without their line's number, and why."""


@dataclass(frozen=True)
class Fault:
    """A change of one node: which file, the node's number in a walk of its tree, and what a reader would see of it."""

    path: Path
    node: int
    function: str
    line: int
    words: str

    def __str__(self) -> str:
        return f"{self.path.relative_to(ROOT)}:{self.line} {self.function}: {self.words}"

    @property
    def name(self) -> str:
        """Stays when lines above it come and go."""
        return f"{self.path.relative_to(ROOT)} {self.function}: {self.words}"


def is_left_alone(node: ast.AST) -> bool:
    """Texts, annotations, messages of errors, and whether a zip looks at lengths that are equal anyway."""
    strict = isinstance(node, ast.keyword) and node.arg == "strict"
    return strict or isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.arg)


def changed(node: ast.AST) -> ast.AST | None:
    """The node with a fault in it; None where it offers none."""
    new = copy.deepcopy(node)
    match new:
        case ast.Compare(ops=[op]) if type(op) in COMPARED:
            new.ops = [COMPARED[type(op)]()]
        case ast.BinOp(op=op) if type(op) in REVERSED and not isinstance(new.left, ast.Constant | ast.JoinedStr):
            new.op = REVERSED[type(op)]()
        case ast.BoolOp(op=op):
            new.op = JOINED[type(op)]()
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            return new.operand
        case ast.Constant(value=bool(value)):
            new.value = not value
        case ast.Constant(value=int(value) | float(value)):
            new.value = value + 1
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in RENAMED:
            setattr(new.func, "id" if isinstance(new.func, ast.Name) else "attr", RENAMED[name])
        case _:
            return None
    return new


def faults(path: Path) -> Iterator[Fault]:
    """Every fault that a file's functions offer."""
    numbers = count()

    def walk(node: ast.AST, function: str) -> Iterator[Fault]:
        number = next(numbers)
        if is_left_alone(node):
            return
        if isinstance(node, ast.FunctionDef):
            function = node.name
        if function and isinstance(node, ast.expr) and (new := changed(node)) is not None:
            words = f"`{ast.unparse(node)}` -> `{ast.unparse(new)}`".replace("\n", " ")
            yield Fault(path, number, function, node.lineno, words)
        for child in ast.iter_child_nodes(node):
            yield from walk(child, function)

    yield from walk(ast.parse(path.read_text()), "")


def planted(fault: Fault) -> str:
    """The file's text with the fault in it."""
    numbers = count()

    def walk(node: ast.AST) -> ast.AST:
        if next(numbers) == fault.node:
            new = changed(node)
            assert new is not None
            return new
        if not is_left_alone(node):
            for name, value in ast.iter_fields(node):
                if isinstance(value, ast.AST):
                    setattr(node, name, walk(value))
                elif isinstance(value, list):
                    setattr(node, name, [walk(each) if isinstance(each, ast.AST) else each for each in value])
        return node

    return ast.unparse(ast.fix_missing_locations(walk(ast.parse(fault.path.read_text()))))


@cache
def texts(folder: str) -> dict[Path, str]:
    """Every file of the package, or of the tests."""
    return {path: path.read_text() for path in sorted((ROOT / folder).rglob("*.py"))}


@cache
def callers(path: Path, function: str) -> re.Pattern[str]:
    """Calls of a function, or for a private one of the public ones of its file that lead to it."""
    said = {
        node.name: {getattr(each, "id", getattr(each, "attr", "")) for each in ast.walk(node)}
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }
    names = {function}
    while more := {name for name, words in said.items() if any(w in names and w[:1] == "_" for w in words)} - names:
        names |= more
    # Shorter words are said of much else.
    return re.compile("|".join(rf"\b{name}\(|\.{name}\b" for name in sorted(names) if len(name) > 4) or "(?!)")


def nearest(fault: Fault, most: int) -> list[Path]:
    """Test files that import the faulty module, or a module that does, themselves or by a helper of theirs.

    Those that speak most of the function and of its callers come first, then those of the module's own room.
    """
    room = fault.path.relative_to(ROOT / "maskfab").parts[0]

    def importers(module: str, folder: str) -> list[Path]:
        parent, _, last = module.rpartition(".")
        said = re.compile(rf"^\s*(from {re.escape(module)} import|from {re.escape(parent)} import .*\b{last}\b)", re.M)
        return [path for path, text in texts(folder).items() if said.search(text)]

    def named(path: Path) -> str:
        return ".".join(path.relative_to(ROOT).with_suffix("").parts)

    def closeness(path: Path) -> tuple[int, bool, int, int]:
        text = texts("tests")[path]
        same = path.stem.removeprefix("test_") == fault.path.stem
        spoken = len(callers(fault.path, fault.function).findall(text)) + 3 * len(word.findall(text))
        return 9 * same + spoken, room in path.parts, text.count(fault.path.stem), -len(text)

    word = re.compile(rf"\b{re.escape(fault.function)}\b")
    direct = importers(named(fault.path), "tests")
    helpers = "|".join(path.stem for path in direct if not path.name.startswith("test_"))
    if helpers:
        said = re.compile(rf"^from (\w+\.)?({helpers}) import", re.M)
        direct = [path for path, text in texts("tests").items() if path in direct or said.search(text)]
    beyond = {test for module in importers(named(fault.path), "maskfab") for test in importers(named(module), "tests")}
    found = [
        path
        for group in (direct, beyond - set(direct))
        for path in sorted(group, key=closeness, reverse=True)
        if path.name.startswith("test_")
    ]
    return found[:most]


def seen_by(fault: Fault, copied: Path, most: int) -> str:
    """The test that fails with the fault planted in that copy, which is mended afterwards; an empty word if none."""
    tests = nearest(fault, most)
    if not tests:
        return ""
    file = copied / fault.path.relative_to(ROOT)
    file.write_text(planted(fault))
    # -P: else the working folder's own package, which has no fault, would come before the copy.
    command = [
        sys.executable,
        "-P",
        "-m",
        "pytest",
        "-x",
        "-q",
        "-n",
        "0",
        "-m",
        "not slow",
        "-p",
        "no:cacheprovider",
        *map(str, tests),
    ]
    surroundings = os.environ | {"PYTHONPATH": str(copied), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        run = subprocess.run(command, check=False, cwd=ROOT, env=surroundings, capture_output=True, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        return LATE
    finally:
        shutil.copyfile(fault.path, file)
    if run.returncode not in (0, 1, 2):
        raise SystemExit(f"{fault}: pytest could not run\n{run.stdout.decode()[-2000:]}")
    if run.returncode == 0:
        return ""
    failed = [line for line in run.stdout.decode().splitlines() if line.startswith(("FAILED", "ERROR"))]
    return (failed or ["ended early"])[0]


def main() -> int:
    """Plant faults, print those that lived; exit 1 if more than the allowed share did."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="faults to plant")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", nargs="+", default=ROOMS, help="rooms of the package, or files in them")
    parser.add_argument("--files", type=int, default=3, help="nearest test files at the most")
    parser.add_argument("--jobs", type=int, default=2, help="faults side by side")
    parser.add_argument("--least", type=float, default=0.85, help="share that must be seen")
    parser.add_argument("--verbose", action="store_true", help="print the faults that were seen too, and by which test")
    asked = parser.parse_args()
    places = [ROOT / "maskfab" / room for room in asked.rooms]
    files = sorted(path for place in places for path in ([place] if place.is_file() else place.rglob("*.py")))
    every = [fault for path in files for fault in faults(path)]
    drawn = [
        f for f in random.Random(asked.seed).sample(every, min(asked.count, len(every))) if f.name not in EQUIVALENT
    ]
    copies: SimpleQueue[Path] = SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="mutate-") as temporary, ThreadPoolExecutor(asked.jobs) as pool:
        for number in range(asked.jobs):
            copied = Path(temporary) / str(number)
            shutil.copytree(ROOT / "maskfab", copied / "maskfab", ignore=shutil.ignore_patterns("__pycache__"))
            for beside in ("layouts", "export_templates"):
                (copied / beside).symlink_to(ROOT / beside)
            copies.put(copied)

        def try_out(fault: Fault) -> str:
            copied = copies.get()
            try:
                return seen_by(fault, copied, asked.files)
            finally:
                copies.put(copied)

        seen = 0
        for fault, by in zip(drawn, pool.map(try_out, drawn), strict=True):
            seen += by not in ("", LATE)
            if by == LATE or (by and asked.verbose):
                print(f"{'late' if by == LATE else 'seen'}: {fault}\n       {by}", flush=True)
            elif not by:
                near = ", ".join(str(path.relative_to(ROOT)) for path in nearest(fault, asked.files)) or "no test"
                print(f"lived: {fault}\n       {near}", flush=True)
    print(f"{seen} of {len(drawn)} faults seen, {seen / len(drawn):.0%}; {len(every)} could have been drawn")
    return int(seen < asked.least * len(drawn))


if __name__ == "__main__":
    raise SystemExit(main())
