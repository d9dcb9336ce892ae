"""Pages that maskfab itself writes: tables of verbs, keys of a job, design rules, quantities and error codes."""

from __future__ import annotations

import ast
import inspect
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module, metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import maskfab
from maskfab.base.findings import origins
from maskfab.base.quantities import quantities
from maskfab.base.resources import explained, grouped
from maskfab.cli.command import Parameter, command_of, summary_of
from maskfab.cli.program import GROUPS
from maskfab.designs.rules.constraints import RULES
from maskfab.job.brief import modules, questions
from maskfab.job.devices import devices
from maskfab.job.reference import keys_of, tables
from maskfab.mask.emitter_layouts import DISPLAYS
from maskfab.report.documents.display import check_schema
from maskfab.report.documents.report import schema

_ROOT = Path(__file__).parents[1]

_PANELS = ("Panel", "Opening", "Design with a map")
WORDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "AnyJob": ("job file", "loaded job", "Plate", *_PANELS, "list or mapping of these"),
        "AnyPanel": _PANELS,
        "AnyReport": ("finished run", "loaded job", "Plate", *_PANELS, "list of these"),
        "DesignJob": ("job file", "loaded job"),
        "AnyPhoto": ("file", "array"),
        "AnyPath": ("path", "result of run"),
        "ArrayLike": ("array",),
        "NDArray[Any]": ("array",),
        "Plate": ("Plate",),
        "Panel": ("Panel",),
        "Tiled": ("Panel",),
        "Opening": ("Opening",),
        "model.Opening": ("Opening",),
        "Tensor": ("tensor",),
        "Brief": ("Brief",),
        "CellMap": ("map",),
        "Path": ("path",),
    }
)
"""Words for the types of :mod:`maskfab.api.asked`, and for others that stand in signatures."""
_OUTPUTS = frozenset({"out", "place", "images", "checkpoint", "checkpoints", "chart", "masks"})
"""Files that are written, or that go with an object and are none."""


class Taken(NamedTuple):
    """One verb: the objects that its parameters take, in words, and whether it takes a camera."""

    verb: str
    parameters: Mapping[str, tuple[str, ...]]
    camera: bool


def verbs() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Public functions that take something, by their names as they are called after ``mf.``."""
    for name, module in maskfab.WHERE.items():
        held = getattr(maskfab, name)
        if inspect.ismodule(held):
            inner = vars(import_module(f"{module}.{name}"))
            functions = (part for part in inner.items() if inspect.isfunction(part[1]) and part[0][:1] != "_")
            yield from (
                (f"{name}.{part}", function) for part, function in functions if function.__module__ == held.__name__
            )
        elif inspect.isfunction(held):
            yield name, held


def taken() -> list[Taken]:
    """Every verb that takes an object, in the order of the public names."""
    rows = []
    for verb, function in verbs():
        parameters = inspect.signature(function).parameters
        words = {name: _words(str(held.annotation)) for name, held in parameters.items() if name not in _OUTPUTS}
        objects = {name: found for name, found in words.items() if set(found) - {"path"}}
        if objects:
            rows.append(Taken(verb, objects, "camera" in parameters))
    return rows


def _words(annotation: str) -> tuple[str, ...]:
    """Words for the types in an annotation, each once."""
    names = re.findall(r"NDArray\[Any\]|[A-Za-z_][\w.]*", re.sub(r'"[^"]*"', "", annotation))
    return tuple(dict.fromkeys(word for name in names for word in WORDS.get(name, ())))


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"


def _table(heads: Iterable[str], rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    named = list(heads)
    yield from ("", _row(*named), _row(*["---"] * len(named)), *(_row(*row) for row in rows), "")


def _plain(text: str) -> str:
    """Text as Markdown: names of modules and literals as code, brackets and angles as they are."""
    marked = re.sub(r":\w+:`([^`]*)`|``([^`]*)``", lambda mark: f"`{mark[1] or mark[2]}`", text)
    return re.sub(r"([][])(?=[^`]*(?:`[^`]*`[^`]*)*$)", r"\\\1", marked).replace("<", "&lt;")


def _keys() -> Iterator[str]:
    for table in tables():
        yield f"### {table.name or 'Whole job'}\n\n{_plain(table.meaning)}"
        yield from _table(
            ("key", "meaning", "form", "default"),
            (
                (
                    f"`{key.name}`",
                    _plain(key.meaning),
                    _plain(key.form),
                    _plain(key.default or "none") if key.default is not None else "required",
                )
                for key in table.keys
            ),
        )


def _codes() -> Iterator[str]:
    for heading, codes in grouped().items():
        yield f"## {heading}\n"
        for code in codes:
            entry = explained(code)
            yield f"### {code}\n\n{_plain(entry.meaning)}\n\n```text\n{entry.example}\n```\n"
            yield f"**Usual cause.** {_plain(entry.cause)}\n\n**Cure.** {_plain(entry.cure)}\n"


def _verbs() -> Iterator[str]:
    """Every verb by its group, in one line."""
    for group, names in GROUPS.items():
        rows = ((f"[`maskfab {name}`](#maskfab-{name.replace(' ', '-')})", summary_of(name)) for name in names)
        yield f"**{group}**"
        yield from _table(("command", "purpose"), ((link, _plain(text)) for link, text in rows))
    yield "Each has `--help` with examples; `--json` prints one JSON document on stdout, progress goes to stderr."


def _reference() -> Iterator[str]:
    """Every verb with its arguments, options and examples, as ``--help`` has them."""
    for group, names in GROUPS.items():
        yield f"## {group}\n"
        for name in names:
            command = command_of(name)
            yield f"### maskfab {name}\n\n{_plain(command.summary)}\n\n{_plain(command.text)}\n"
            yield "\n".join(("```sh", *command.examples, "```"))
            rows = ((f"`{word.shown}`", _plain(word.help + _default(word))) for word in command.parameters)
            yield from _table(("word", "meaning"), rows)


def _default(parameter: Parameter) -> str:
    return " Required." if parameter.required else f" Default: {parameter.default}." if parameter.default else ""


def _quantities() -> Iterator[str]:
    yield from _table(
        ("name", "title", "unit", "meaning", "if its check fails", "found by"),
        (
            (
                *(f"`{entry.name}`", entry.title, entry.unit, _plain(entry.meaning), _plain(entry.cure)),
                ", ".join(work.name for work in origins(entry.name)),
            )
            for entry in quantities().values()
        ),
    )


def _rules() -> Iterator[str]:
    yield from _table(
        ("rule", "meaning", "unit", "refused before the search if"),
        (
            (f"`{rule.name}`", _plain(keys_of(rule.where)[0].meaning), rule.unit, _plain(rule.refused_if))
            for rule in RULES
        ),
    )


def _rooms() -> Iterator[str]:
    """Every floor from the top, and each room on it by the sentence that its own file begins with."""
    settings = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (plan,) = (rule for rule in settings["tool"]["importlinter"]["contracts"] if rule["type"] == "layers")
    rows = []
    for floor in plan["layers"]:
        for number, room in enumerate(floor.replace("maskfab.", "").split(" | ")):
            folder = _ROOT / "maskfab" / room
            source = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
            text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
            inner = ", ".join(f"`{path.parent.name}`" for path in sorted(folder.glob("*/__init__.py")))
            rows.append(("" if number else "floor", f"`{room}`", _plain(text.partition("\n\n")[0]), inner))
    yield from _table(("", "room", "content", "inner rooms"), rows)


def _questions() -> Iterator[str]:
    """Questions to a display engineer, with the defaults of a phone and of a dashboard."""
    rows = []
    for question in questions():
        phone, car = (question.default_of({"pitch": pitch}) or "not stated" for pitch in ("400 dpi", "150 dpi"))
        default = phone if question.of_pitch is None else f"{phone} at 400 dpi, {car} at 150 dpi"
        rows.append((f"`{question.key}`", question.text, default, question.why))
    yield from _table(("key", "question", "default", "reason"), rows)


def _cameras() -> Iterator[str]:
    yield from _table(
        ("name", "camera", "lens, stop", "pixel, µm", "full well, read noise, electrons", "sources"),
        (
            (
                f"`{name}`",
                camera.title,
                f"{camera.focal / 1000:g} mm f/{camera.f_number:g}, {camera.stop_um / 1000:.2f} mm",
                f"{camera.pixel:g}",
                f"{camera.well:g}, {camera.read_noise:g}",
                camera.source,
            )
            for name, camera in modules().items()
        ),
    )


def _devices() -> Iterator[str]:
    yield from _table(
        ("name", "device", "published", "not published", "sources, read on"),
        (
            (
                f"`{name}`",
                device.title,
                ", ".join(
                    text
                    for number, text in (
                        (device.dpi, f"{device.dpi} dpi over the camera"),
                        (device.f_number, f"f/{device.f_number}"),
                        (device.pixel, f"pixel {device.pixel} µm"),
                        (device.field_deg, f"field {device.field_deg}°"),
                    )
                    if number is not None
                ),
                ", ".join(device.missing),
                f"{device.source} Read on {device.day}.",
            )
            for name, device in devices().items()
        ),
    )


def _shapes() -> Iterator[str]:
    """Lengths of every display that ``new --shape`` draws, with the meaning that its layout states."""
    rows = []
    for kind, display in DISPLAYS.items():
        stated = (inspect.getdoc(display.layout) or "").partition("Args:\n")[2].partition("\n\n")[0]
        meanings = re.findall(r"(?m)^    ([a-z_, ]+): (.*(?:\n {8}.*)*)", stated)
        own = "; ".join(f"`{name}={length}`" for name, length in display.lengths.items())
        told = " ".join(f"{key}: {_plain(' '.join(text.split()))}" for key, text in meanings if key != "dots")
        whole = f", a multiple of {display.multiple}" if display.multiple > 1 else ""
        drawn = (inspect.getdoc(display.layout) or "").partition("\n")[0]
        rows.append((f"`{kind}`", drawn, f"{display.dots} on {display.pitch.replace('um', 'µm')}{whole}", own, told))
    yield from _table(("shape", "cell", "dots", "lengths, in dots, and their defaults", "meaning"), rows)


def _objects() -> Iterator[str]:
    """What every verb takes from Python, read from its signature."""
    many = next(words for row in taken() for words in row.parameters.values() if "loaded job" in words)
    yield f"*A job or panels* below stands for: {', '.join(many)}."
    rows = []
    for row in taken():
        takes = "; ".join(
            f"`{name}`: {'*a job or panels*' if words == many else ', '.join(words)}"
            for name, words in row.parameters.items()
        )
        rows.append((f"`mf.{row.verb}`", takes, "yes" if row.camera else ""))
    yield from _table(("verb", "takes", "`camera=`"), rows)


def _schemas() -> Iterator[str]:
    for title, rules in (("report.json", schema()), ("maskfab check --json", check_schema())):
        yield f"### `{title}`\n\n```json\n{json.dumps(rules, indent=1, ensure_ascii=False)}\n```\n"


def _readers() -> Iterator[str]:
    """Packages that read files: versions that the tests ran with, the least that are asked for, and their makers."""
    texts = [(_ROOT / name).read_text(encoding="utf-8") for name in ("constraints.txt", "pyproject.toml")]
    rows = []
    for name in ("klayout", "gdstk", "ezdxf", "gerbonara", "OpenImageIO", "rawpy", "trimesh", "cadquery", "zxing-cpp"):
        told = metadata.metadata(name)
        pages = [address.partition(", ")[2] for address in told.get_all("Project-URL") or ()]
        versions = (" or ".join(re.findall(rf"\b{name}[=>]=([\w.]+)", text)) for text in texts)
        rows.append((name, *versions, told["Summary"] or "", told["Home-page"] or (pages or [""])[0]))
    yield from _table(("reader", "tests ran with", "least", "by its makers", "page"), rows)


_MADE: dict[str, Callable[[], Iterator[str]]] = {
    "keys": _keys,
    "codes": _codes,
    "verbs": _verbs,
    "reference": _reference,
    "rules": _rules,
    "quantities": _quantities,
    "schemas": _schemas,
    "objects": _objects,
    "rooms": _rooms,
    "questions": _questions,
    "cameras": _cameras,
    "devices": _devices,
    "shapes": _shapes,
    "readers": _readers,
}


def on_page_content(html: str, **_: object) -> str:
    """Leave the roles of docstrings out, which the page has no use for: ``:func:`design` ``."""
    return re.sub(r":(?:class|data|func|meth|mod):(?=<code>)", "", html)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Put each table in the place of its mark, ``<!-- name -->``."""
    return re.sub(r"<!-- (\w+) -->", lambda mark: "\n".join(_MADE[mark[1]]()), markdown)
