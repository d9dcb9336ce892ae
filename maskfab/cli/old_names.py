"""Words of the last release, in those of this one; to be dropped with the next."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Sequence

from maskfab import OLD_NAMES

_CAMERA = ("--stop", "--stop-shape", "--focal", "--wavelengths", "--pixel", "--window")
_SCENE = (
    *("--gap", "--field", "--depth", "--focus", "--aberration"),
    *("--distortion", "--spectrum", "--illuminant", "--accuracy"),
)


def renewed(words: Sequence[str]) -> list[str] | None:
    """A command line with the verbs and options of this release; None for one that has no others."""
    verb, rest = (words[0], list(words[1:])) if words else ("", [])
    if verb in _TURNED:
        new = _TURNED[verb](rest)
    elif verb in OLD_NAMES and "_" not in verb:
        new = [*OLD_NAMES[verb].split(), *rest]
    else:
        return None
    return new if new != list(words) else None


def told(words: Sequence[str], new: Sequence[str]) -> str:
    """A sentence on a command line that was renewed."""
    was = shlex.join(["maskfab", *words])
    return f"note: {was} is now {shlex.join(['maskfab', *new])}; the old words go with the next release"


def _taken(words: Sequence[str], *options: str) -> tuple[list[tuple[str, str]], list[str]]:
    pairs, others, left = [], [], iter(words)
    for word in left:
        option, equals, value = word.partition("=")
        if option in options:
            pairs.append((option, value if equals else next(left, "")))
        else:
            others.append(word)
    return pairs, others


def _shops(words: list[str]) -> list[str]:
    pairs, others = _taken(words, "--compare")
    return ["order", "compare", pairs[0][1], *others] if pairs else ["order", "list", *others]


def _shape(words: list[str]) -> list[str]:
    pairs, others = _taken(words, "--out", "-o")
    return ["new", *(path for _, path in pairs), *(["--shape"] if others else []), *others]


def _schema(words: list[str]) -> list[str]:
    plain = [word for word in words if not word.startswith("-")]
    return ["explain", "--schema", *([] if plain else ["job"]), *plain, *(word for word in words if word not in plain)]


def _order(words: list[str]) -> list[str]:
    inner = words[:1] in (["list"], ["compare"], ["fill"], ["pack"], ["--help"], [])
    return ["order", *words] if inner else ["order", "fill", *words]


def _check(words: list[str]) -> list[str]:
    pairs, _ = _taken(words, "--shop")
    return ["order", "pack", *words, "--dry-run"] if pairs else ["check", *words]


def _measure(words: list[str]) -> list[str]:
    pairs, others = _taken(words, "--edge", "--mtf")
    return ["edge", pairs[0][1], *others] if len(pairs) == 1 else ["measure", *words]


def _simulate(words: list[str]) -> list[str]:
    pairs, others = _taken(words, "--picture")
    return ["simulate", *others, *(word for _, path in pairs for word in ("--out", path))]


def _analyse(words: list[str]) -> list[str]:
    pairs, others = _taken(words, *_CAMERA, *_SCENE)
    stated = dict(pairs)
    if "--stop-shape" in stated and not stated.get("--stop", "").lstrip().startswith("{"):
        stated.setdefault("--stop", "4 mm")
    shape = stated.pop("--stop-shape", "circle")
    waves = [", ".join(value.split(":", 1)) for option, value in pairs if option == "--aberration"]
    for table, options in (("--camera", _CAMERA), ("--scene", _SCENE)):
        keys = [
            f"{'aberrations' if option == '--aberration' else option[2:]} = {_value(option, value, shape, waves)}"
            for option, value in stated.items()
            if option in options
        ]
        others += [table, f"{{ {', '.join(keys)} }}"] if keys else []
    return ["analyse", *others]


def _value(option: str, text: str, shape: str, waves: Sequence[str]) -> str:
    match option:
        case "--stop":
            return text if text.lstrip().startswith("{") else _inline({"shape": shape, "diameter": text})
        case "--wavelengths" | "--depth":
            return json.dumps([part.strip() for part in text.split(",")])
        case "--aberration":
            return f"[{', '.join(f'[{pair}]' for pair in waves)}]"
        case "--distortion":
            ratio, _, height = text.partition(":")
            return f"{{ ratio = {ratio}, height = {json.dumps(height.strip())} }}"
        case "--accuracy":
            return text if text.replace(".", "", 1).replace("e-", "").isdigit() else json.dumps(text)
    return json.dumps(text)


def _inline(table: dict[str, str]) -> str:
    return f"{{ {', '.join(f'{key} = {json.dumps(value)}' for key, value in table.items())} }}"


_TURNED: dict[str, Callable[[list[str]], list[str]]] = {
    "shops": _shops,
    "shape": _shape,
    "schema": _schema,
    "order": _order,
    "check": _check,
    "measure": _measure,
    "simulate": _simulate,
    "analyse": _analyse,
}
