"""What the golden set asks in one process: explanations of every key and code, exits of errors, and public names.

    python tests/golden_probes.py explain | exits | names

Prints one JSON document. Asks the command line, started as ``python -m maskfab`` starts it, and public names.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import json
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import maskfab as mf

BY_NAME = ("curves", "maps", "openings", "shops")
"""Tables whose keys are names of the user's own, which the schema leaves out."""
JOB = "layouts/upc12.toml"
JOB_LINE = re.compile(r"(\[{1,2}\w+\]{1,2}) ((\w+) = .*)", re.DOTALL)
"""An example of an error code that is a line of a job."""


def command(*words: str) -> tuple[int, str]:
    """Exit code and stdout of one command."""
    sys.argv = ["maskfab", *words]
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        try:
            runpy.run_module("maskfab", run_name="__main__", alter_sys=False)
        except SystemExit as end:
            return int(end.code or 0), out.getvalue()
    return 0, out.getvalue()


def document(*words: str) -> Any:
    """The answer of one command."""
    return json.loads(command(*words, "--json")[1])


def explain() -> dict[str, Any]:
    """Every error code, and every key that the schema of a job names, in data and in words."""
    codes = sorted(code for group in document("explain").values() for code in group)
    words = sorted({*BY_NAME, *property_names(document("schema", "job"))})
    keys: dict[str, Any] = {}
    for word in words:
        for key in document("explain", word).get("keys", ()):
            keys[f"{key['section']}.{key['name']}"] = key
    return {
        "codes": {code: {"data": document("explain", code), "words": command("explain", code)[1]} for code in codes},
        "keys": keys,
        "words": {word: command("explain", word)[1] for word in words},
    }


def property_names(schema: Any) -> Iterator[str]:
    """Names of all keys that a schema describes, at any level."""
    if isinstance(schema, dict):
        properties = schema.get("properties")
        if isinstance(properties, dict):
            yield from properties
        for part in schema.values():
            yield from property_names(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from property_names(part)


def exits() -> dict[str, Any]:
    """The exit and error of every example that is a line of a job, in place of that key of a shipped job; and the exit
    code of every class of errors."""
    examples = {code: document("explain", code)["example"] for group in document("explain").values() for code in group}
    found: dict[str, Any] = {}
    for code, example in sorted(examples.items()):
        if line := JOB_LINE.fullmatch(example):
            Path("example.toml").write_text(with_line(*line.groups()), encoding="utf-8")
            exit_code, said = command("run", "example.toml", "--out", "out", "--dry-run", "--json")
            found[code] = {"exit": exit_code, **json.loads(said).get("error", {})}
    return {"examples": found, "classes": dict(sorted(classes(mf.MaskfabError)))}


def with_line(heading: str, line: str, key: str) -> str:
    """The shipped job with a line in place of its key, below the first such heading."""
    text = Path(JOB).read_text(encoding="utf-8").replace('"openings/', '"layouts/openings/')
    text = text.replace('"maps/', '"layouts/maps/')
    if heading not in text:
        text += f"\n{heading}\n"
    before, after = text.split(f"{heading}\n", 1)
    section, *rest = re.split(r"(?m)^(?=\[)", after, maxsplit=1)
    section = re.sub(rf"(?m)^{key} =.*\n", "", section)
    return f"{before}{heading}\n{line}\n{section}{''.join(rest)}"


def classes(kind: type) -> Iterator[tuple[str, int]]:
    """Errors and their exit codes, from one down; those of dependencies' modules that are loaded."""
    yield kind.__name__, kind.exit_code  # type: ignore[attr-defined]
    for below in kind.__subclasses__():
        yield from classes(below)


def names() -> dict[str, Any]:
    """Public names: signatures of functions; of types also their bases, members and those members' signatures."""
    return {name: described(getattr(mf, name)) for name in sorted(mf.__all__)}


def described(thing: Any) -> Any:
    """How a thing is called, and what it has."""
    if inspect.isclass(thing):
        inherited = {name for kind in thing.__mro__ if kind.__module__ == "builtins" for name in vars(kind)}
        members = {
            name: member
            for name, member in inspect.getmembers_static(thing)
            if name[0] != "_" and name not in inherited
        }
        return {"call": signature(thing), **{name: described_member(member) for name, member in members.items()}}
    return signature(thing) if callable(thing) else type(thing).__name__


def described_member(member: Any) -> str:
    """A method's signature, or what kind of attribute it is."""
    if isinstance(member, property):
        return f"property -> {inspect.signature(member.fget).return_annotation}" if member.fget else "property"
    if isinstance(member, classmethod | staticmethod):
        return f"{type(member).__name__} {signature(member.__func__)}"
    return signature(member) if callable(member) else type(member).__name__


def signature(thing: Any) -> str:
    """The signature in text, without places in memory."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(inspect.signature(thing)))


if __name__ == "__main__":
    print(json.dumps({"explain": explain, "exits": exits, "names": names}[sys.argv[1]](), ensure_ascii=False))
