"""The registry of quantities: every number that is reported has its words there, and only there."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from typing import get_args

import pytest

import maskfab
from maskfab.base.errors import InternalError
from maskfab.base.findings import Need, origins
from maskfab.base.model import COLOURS, Quantity
from maskfab.base.quantities import FAMILIES, Entry, quantities, registered
from maskfab.camera.scores import Score
from maskfab.job.sections import ClaimSection

UNITS = {"", "1", "nm", "um", "um^2", "m", "cy/mm", "cy/pixel", "px", "1/deg", "1/in", "deg", "dB", "mA/cm2", "waves"}
UNITS |= {"edges", "names", "places", "{detail}", "polygons over {detail} vertices"}


JOINED = ("border_delta_e_", "model_", "field_mtf_", "order_zero_", "orders_lowest_five_", "rule_", "written_")
"""Beginnings of names that the program joins with a word."""


SAMPLES = {
    "level": ("50", "12.5", "1e-05"), "frequency": ("62.5", "1e-05"), "entry": ("any text", ""), "gauge": ("a 1 x",),
    "picture": ("flat",),
}  # fmt: skip
"""Of families without end."""


@cache
def sources() -> dict[str, str]:
    root = Path(maskfab.__file__).parent
    tables = {root / "base" / "quantities.py", root / "base" / "findings.py"}
    files = [path for path in sorted(root.rglob("*.py")) if path not in tables]
    return {str(path.relative_to(root)): path.read_text(encoding="utf-8") for path in files}


def written(node: ast.expr) -> str | None:
    """The pattern of a literal name; a word that is put in matches anything."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return re.escape(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(written(part) or ".+" for part in node.values)
    return None


def members(entry: Entry) -> list[str]:
    names = [entry.name]
    for word, known in FAMILIES.items():
        if f"{{{word}}}" in entry.name:
            values = SAMPLES[word] if word in SAMPLES else known.split("|")
            names = [each.replace(f"{{{word}}}", value) for each in names for value in values]
    return names


def test_every_rule_of_a_house_is_registered():
    rules = FAMILIES["shop_rule"].split("|")
    houses = [text for path, text in sources().items() if path.startswith("mask/houses")]
    calls = [call for text in houses for call in ast.walk(ast.parse(text)) if isinstance(call, ast.Call)]
    named = [written(call.args[0]) for call in calls if getattr(call.func, "id", "") == "Finding" and call.args]
    assert len(named) > 20
    assert [name for name in named if name and not any(re.fullmatch(name, rule) for rule in rules)] == []


def test_every_quantity_has_an_origin():
    assert [name for entry in quantities().values() for name in members(entry) if not origins(name)] == []


def test_claims_are_about_numbers_whose_origin_is_known():
    for measure in get_args(ClaimSection.model_fields["measure"].annotation):
        photographed = any(Need.PHOTOGRAPHS in work.needs for work in origins(measure))
        assert photographed == (measure in Score.__dataclass_fields__)


def test_every_name_written_in_a_call_is_registered():
    found = 0
    for path, text in sources().items():
        for call in ast.walk(ast.parse(text)) if "Quantity(" in text else ():
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Quantity":
                pattern = written(call.args[0])
                if pattern is not None:
                    found += 1
                    known = any(
                        re.fullmatch(pattern, name) for entry in quantities().values() for name in members(entry)
                    )
                    assert known, f"{path}:{call.lineno}: {pattern}"
    assert found > 80


def test_every_entry_is_the_name_of_something():
    """An entry whose name stands in no module, whole or in the parts that are joined to it, describes nothing."""
    text = "".join(sources().values())

    def stands(part: str) -> bool:
        return any(f"{before}{part}{after}" in text for before in '"}' for after in '"{')

    for name in quantities():
        starts = [start for start in JOINED if name.startswith(start)]
        ends = [name.removeprefix(start).removesuffix("_{reading}") for start in starts]
        whole = all(stands(part) for part in re.split(r"\{\w+\}", name) if part)
        assert whole or any(stands(end) or stands(end.replace("_", " ")) for end in ends), name


@pytest.mark.parametrize("name", ["count", "open_ratios", "circuit_room_violet", "mtf_per_pixel", "shop_colour", ""])
def test_a_name_that_is_not_registered_is_refused(name):
    with pytest.raises(InternalError, match="registered") as refused:
        Quantity(name, 1, "counted")
    assert refused.value.code == "MF901"


def test_no_name_has_two_entries():
    for entry in quantities().values():
        for name in members(entry):
            assert registered(name).name == entry.name
    exact = {name for name in quantities() if "{" not in name}
    families = [entry for entry in quantities().values() if "{" in entry.name]
    for entry in families:
        pattern = re.sub(r"\\\{(\w+)\\\}", lambda word: f"(?:{FAMILIES[word[1]]})", re.escape(entry.name))
        assert not [name for name in exact if re.fullmatch(pattern, name)], entry.name


def test_every_entry_has_words_and_every_unit_one_spelling():
    for entry in quantities().values():
        assert entry.title, entry.name
        assert entry.meaning.endswith("."), entry.name
        assert not entry.cure or entry.cure.endswith("."), entry.name
        assert entry.unit in UNITS, entry.name
    assert {entry.unit for entry in quantities().values()} >= UNITS
    titles = [entry.title for entry in quantities().values()]
    assert len(set(titles)) == len(titles)


def test_a_member_of_a_family_is_told_in_its_words():
    assert registered("mtf30_per_pixel").symbol == "ν30 p"
    assert registered("mtf30_per_pixel").meaning.startswith("MTF30 in cycles")
    assert registered("cd_resolution_8_um_x").title == "CD resolution 8 um x"
    assert registered("written_mtf50_fused").title == "MTF50 as written, fused"
    assert registered("manifest_{entry}").title == "Manifest: {entry}"
    assert FAMILIES["colour"].split("|") == [*COLOURS]


def test_a_detail_completes_symbol_or_unit_and_nothing_else():
    energy = Quantity("ensquared_energy", 0.5, "integral", detail="6 um")
    assert (energy.symbol, energy.unit) == ("SE(6 um)", "1")
    rule = Quantity("shop_flashes", 3, "counted", detail="rectangles")
    assert (rule.symbol, rule.unit) == ("", "rectangles")
    for name, detail in (("ensquared_energy", None), ("open_ratio", "6 um")):
        with pytest.raises(InternalError, match=name):
            Quantity(name, 0.5, "integral", detail=detail)
