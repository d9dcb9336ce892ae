"""Files of a job, read once more for what they say of its plate: tone, parity, bias, openings, maps, and its hash.

Nothing here is taken from what the job was made into. A job of Python has no files, and one that a run keeps holds its
openings and maps itself: then texts of the spec are read, and of [order] and [process] what they state.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maskfab.base.arrays import Ints
from maskfab.base.units import NM_PER_UM, parse_length_um
from maskfab.job.sections import JobSpec

_ON_THE_PLATE = ("tone", "parity", "chrome")
"""Keys by which [order] speaks of the data themselves, as a bias does that the data have; the rest is for papers."""
_COLOURS = str.maketrans("RGB", "123")


@dataclass(frozen=True, eq=False)
class Sources:
    """The drawing, by the files that state it.

    Attributes:
        openings: dots of every die's openings, int64 [n, n] of 0 and 1, the lowest row first.
        labels: of the emitters in the text of every die's opening, int64 [n, n], 1 to 3 for red, green and blue; None
            for one that states none.
        maps: facts of every die's map, as its file has them; None for a die without one.
        seeds: of every die.
        dark: whether polygons are chrome.
        mirror: whether the data are the design's mirror image.
        bias: by which clear widths of the data are narrower, nanometres.
    """

    openings: tuple[tuple[Ints, ...], ...]
    labels: tuple[Ints | None, ...]
    maps: tuple[Mapping[str, Any] | None, ...]
    seeds: tuple[int | None, ...]
    dark: bool
    mirror: bool
    bias: int
    digest: str


def sources(spec: JobSpec, file: Path | None = None) -> Sources:
    """The drawing, of the resolved spec and the job file that it was read from, if it was."""
    resolved = spec.dump()
    if file is not None and not file.is_file():
        file = None  # that of a package, which was unpacked for a while: it holds what the spec does
    stated = resolved if file is None else _document(file)
    folder = Path() if file is None else file.parent
    openings: list[tuple[Ints, ...]] = []
    labels: list[Ints | None] = []
    maps: list[Mapping[str, Any] | None] = []
    for die, own in zip(stated["die"], spec.die, strict=True):
        names = zip((die["opening"], *(die.get("others") or ())), (own.opening, *(own.others or ())), strict=True)
        texts = [_text(name, stated, "openings", folder) or spec.openings[held] for name, held in names]
        facts = [tomllib.loads(text) for text in texts]
        openings.append(tuple(digits(each["grid"]) for each in facts))
        labels.append(digits(facts[0]["emitters"].translate(_COLOURS)) if "emitters" in facts[0] else None)
        held = own.map
        text = held and (_text(str(die["map"]), stated, "maps", folder) or spec.maps[held])
        maps.append(tomllib.loads(text) if text else None)
    order, process = stated.get("order") or {}, stated.get("process") or {}
    return Sources(
        tuple(openings),
        tuple(labels),
        tuple(maps),
        tuple(die.get("seed", own.seed) for die, own in zip(stated["die"], spec.die, strict=True)),
        order.get("tone") == "dark",
        # What reads right with the chrome down reads wrong with the chrome up.
        (order.get("parity") == "wrong reading") != (order.get("chrome") == "down"),
        _signed_nm(process.get("cd_bias", 0)) if order.get("bias") == "data" else 0,
        digest(resolved),
    )


def _document(file: Path) -> Mapping[str, Any]:
    text = file.read_text("utf-8-sig")
    found: Mapping[str, Any] = json.loads(text) if file.suffix == ".json" else tomllib.loads(text)
    return found


def _text(name: str, stated: Mapping[str, Any], kind: str, folder: Path) -> str:
    """Text of an opening or a map: in the job itself or in the file that it names; empty for a file of another kind."""
    held: Mapping[str, str] = stated.get(kind) or {}
    path = folder / name
    return held.get(name) or (path.read_text("utf-8-sig") if path.suffix.lower() == ".toml" else "")


def digits(text: str) -> Ints:
    """Digits of a map, int64, or dots of an opening, 1 where they are clear; drawn with the top row first."""
    rows: Sequence[str] = text.translate({ord("#"): "1", ord("."): "0"}).split()
    return np.array([[int(digit, 16) for digit in row] for row in reversed(rows)], dtype=np.int64)


def _signed_nm(length: str | float) -> int:
    if not isinstance(length, str):
        return round(length * NM_PER_UM)
    sign = -1 if length.strip().startswith("-") else 1
    return sign * round(parse_length_um(length.strip().lstrip("-+"), zero_allowed=True) * NM_PER_UM)


def digest(resolved: Mapping[str, Any]) -> str:
    """SHA-256 of canonical JSON: keys in order, no spaces, without [report] and what [order] says on paper alone."""
    order = resolved.get("order") or {}
    drawn = {key: order[key] for key in order if key in _ON_THE_PLATE or (key, order[key]) == ("bias", "data")}
    kept = {key: value for key, value in resolved.items() if key not in ("report", "order")}
    text = json.dumps(
        {**kept, "order": drawn} if drawn else kept, sort_keys=True, separators=(",", ":"), ensure_ascii=False
    )
    return hashlib.sha256(text.encode()).hexdigest()
