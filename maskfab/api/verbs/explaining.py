"""Error codes and keys of a job in words."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from maskfab.base import resources
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import CATALOGUE

_WIDTH = 100
_CODE = re.compile(r"(?i)\s*(mf.?\d|\d)")
_INDENT = " " * len("Usual cause: ")


@dataclass(frozen=True, repr=False)
class Answer:
    """An explanation, as text for people and as plain data."""

    text: str
    document: Mapping[str, Any]

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return self.text

    def to_dict(self) -> dict[str, Any]:
        """The parts by their names."""
        return dict(self.document)


@checked_arguments
def explain(code: str | None = None) -> Answer:
    """Explain an error code (meaning, example, usual cause, cure) or a key of a job (form, default, meaning).

    Examples:
        >>> import maskfab as mf
        >>> print(mf.explain("MF111").text.splitlines()[0])
        MF111  A random tiling needs a seed.

    Args:
        code: such as ``"MF106"``, or a key or table of a job such as ``"camera.stop"``, or its last word; None
            for the list of codes.

    Raises:
        JobError: MF105 for what is neither.
    """
    if code is None:
        groups = resources.grouped()
        lists = ("\n".join([heading, *(f"  {e}  {CATALOGUE[e]}" for e in codes)]) for heading, codes in groups.items())
        return Answer("\n\n".join(lists), {h: {e: CATALOGUE[e] for e in codes} for h, codes in groups.items()})
    if not _CODE.match(code):
        return _of_keys(code)
    found = resources.explained(code)
    parts = _parts(("Example", found.example), ("Usual cause", found.cause), ("Cure", found.cure))
    return Answer(f"{found.code}  {found.meaning}\n\n{parts}", asdict(found))


def _of_keys(path: str) -> Answer:
    from maskfab.job.reference import keys_of

    keys = keys_of(path, or_word=True)
    document = {"keys": [asdict(key) for key in keys]}
    if len({key.section for key in keys}) > 1 and all(key.name == path.strip().lower() for key in keys):
        # A word that ends several keys: which is meant, their first sentences tell.
        width = max(len(key.path) for key in keys)
        lines = [f"{key.path:<{width}}  {key.meaning.partition('. ')[0].rstrip('.')}." for key in keys]
        return Answer("\n".join([*lines, f"maskfab explain {keys[0].path} tells more"]), document)
    refused = _refused_if() if any(key.section == "design.rules" for key in keys) else {}
    told = []
    for key in keys:
        default = "required" if key.default is None else key.default or "none"
        parts = _parts(("Meaning", key.meaning), ("Form", key.form), ("Default", default), *refused.get(key.path, ()))
        told.append(key.path + key.section.partition(" ")[1] + key.section.partition(" ")[2] + "\n" + parts)
    return Answer("\n\n".join(told), document)


def _refused_if() -> dict[str, tuple[tuple[str, str]]]:
    """By the keys of design rules, when a design is refused for them before it is searched for."""
    from maskfab.designs.rules.constraints import RULES

    return {rule.where: (("Refused if", rule.refused_if),) for rule in RULES if rule.refused_if}


def _parts(*parts: tuple[str, str]) -> str:
    told = []
    for title, text in parts:
        lines = (line for each in text.splitlines() for line in textwrap.wrap(each, _WIDTH - len(_INDENT)))
        told.append(f"{title + ':':<{len(_INDENT)}}" + f"\n{_INDENT}".join(lines))
    return "\n".join(told)
