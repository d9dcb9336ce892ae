"""Commands derived from the functions of the Python door.

A command is read off the source of its function, so that neither ``--help`` nor a wrong word imports what a verb needs:

* the first parameter is the argument, or what stands in the place of ``*args``; every other is an option of its name,
  ``--no-NAME`` for one that is true by default; a list is an option that may be repeated, its name in the singular;
* ``Args`` of the docstring are the help, the paragraphs before it the description, lines of ``Examples`` that begin
  with ``$`` the examples;
* ``out`` and ``force`` of a result that can be saved are those of its method ``save`` or ``_write``;
* ``Annotated[..., "--from NAME"]`` spells an option otherwise, ``"NAME"`` its value, with ``!`` one that a command must
  state, ``"2..1000"`` its bounds, ``"<IMAGE>"`` a further argument, ``"JOB..."`` one of several; ``InPython[...]`` is
  what only Python has.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

import maskfab

_TYPES: Mapping[str, type] = {
    "AnyJob": Path,
    "AnyPath": Path,
    "AnyPhoto": Path,
    "AnyReport": Path,
    "DesignJob": Path,
    "bool": bool,
    "int": int,
    "float": float,
    "Path": Path,
    "Place": Path,
}
_TEXTS = frozenset({"str", "Length", "Wavelength", "Engine", "ProtocolName", "Light"})
_BOUNDS = re.compile(r"(\d\S*)\.\.(\d\S*)")
_METAVARS = {bool: "", int: "N", float: "NUMBER", str: "TEXT", Path: "PATH"}


@dataclass(frozen=True)
class Parameter:
    """One word, or pair of words, of a command.

    Attributes:
        name: of the function's parameter.
        type: of one value.
        help: sentence on it.
        default: of the function; None where the function finds one itself.
        spelling: as ``--name`` or ``-o``; none for an argument.
        metavar: what stands for its value.
        required: whether it must be stated.
        many: whether it may be repeated.
        keys: "toml" for a table of a job, "str" for KEY=VALUE, empty for a plain value.
        bounds: smallest and largest number.
    """

    name: str
    type: type
    help: str
    default: Any = None
    spelling: tuple[str, ...] = ()
    metavar: str | None = None
    required: bool = False
    many: bool = False
    keys: str = ""
    bounds: tuple[float | None, float | None] = (None, None)

    @property
    def shown(self) -> str:
        """As a manual spells it."""
        value = self.metavar or _METAVARS[self.type]
        return f"{', '.join(reversed(self.spelling))} {value}".rstrip() if self.spelling else value

    def typed(self) -> inspect.Parameter:
        """As the library that reads arguments takes it."""
        low, high = self.bounds
        limits: dict[str, Any] = {} if low is None else {"min": self.type(low), "max": self.type(high)}
        kind: Any = list[self.type] if self.many else self.type  # type: ignore[name-defined]
        default = f" Default: {self.default}." if self.default and self.type is not bool else ""
        help, metavar = self.help + default, self.metavar or _METAVARS[self.type] or None
        hint: Any = (
            typer.Option(*self.spelling, help=help, metavar=metavar, show_default=False, **limits)
            if self.spelling
            else typer.Argument(help=help, metavar=metavar, show_default=False)
        )
        unstated = inspect.Parameter.empty if self.required else False if self.type is bool else None
        kind = kind if unstated is not None else kind | None
        return inspect.Parameter(
            self.name, inspect.Parameter.KEYWORD_ONLY, default=unstated, annotation=Annotated[kind, hint]
        )


JSON = Parameter("as_json", bool, "Print a single JSON document on stdout.", False, ("--json",))
QUIET = Parameter("quiet", bool, "Show no progress on stderr.", False, ("--quiet",))

_FORCE = Parameter("force", bool, "Replace an earlier result.", False, ("--force",))


@dataclass(frozen=True)
class Command:
    """A verb as the command line has it.

    Attributes:
        name: such as ``run`` or ``order fill``.
        module: that its function is in.
        function: its name there.
        summary: what it does, in one sentence.
        text: further paragraphs.
        examples: command lines.
        parameters: arguments, then options; the last are those of every verb.
        saves: whether ``out`` and ``force`` are of its result.
    """

    name: str
    module: str
    function: str
    summary: str
    text: str
    examples: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    saves: bool

    @property
    def options(self) -> tuple[Parameter, ...]:
        """Options alone."""
        return tuple(parameter for parameter in self.parameters if parameter.spelling)

    def callback(self, act: Callable[[Command, typer.Context, dict[str, Any]], None]) -> Callable[..., None]:
        """A function with the command's signature, which gives what was stated to ``act``."""

        def called(context: typer.Context, **stated: Any) -> None:
            act(self, context, stated)

        context = inspect.Parameter("context", inspect.Parameter.POSITIONAL_ONLY, annotation=typer.Context)
        words = [context, *(parameter.typed() for parameter in self.parameters)]
        called.__signature__ = inspect.Signature(words)  # type: ignore[attr-defined]
        called.__annotations__ = {parameter.name: parameter.annotation for parameter in words}
        called.__doc__ = "\n\n".join(filter(None, (self.summary, self.text)))
        return called


def place_of(name: str) -> tuple[str, str]:
    """Module and function of a verb: ``order fill`` is ``fill`` of the module ``order``, ``self cite`` is ``cite``."""
    group, _, inner = name.partition(" ")
    if group == "order" and inner:
        return f"{maskfab.WHERE[group]}.{group}", inner
    return maskfab.WHERE[inner or group], inner or group


def summary_of(name: str) -> str:
    """First sentence of a verb's docstring, found without reading the rest of its module."""
    module, function = place_of(name)
    text = re.search(rf'^def {function}\(.*?"""(.*?)(?:\n\n|""")', _source(module), re.MULTILINE | re.DOTALL)
    assert text is not None, name
    return _plain(" ".join(text[1].split()))


@cache
def command_of(name: str) -> Command:
    """The command of a verb."""
    module, function = place_of(name)
    tree = _tree(module)
    (*_, definition) = (
        statement for statement in tree.body if isinstance(statement, ast.FunctionDef) and statement.name == function
    )
    parts = _Docstring(ast.get_docstring(definition) or "")
    parameters, progress = [], False
    for position, (argument, default) in enumerate(_arguments(definition)):
        progress |= argument.arg == "progress"
        read = _parameter(argument, default, parts.args.get(argument.arg, ""), first=position == 0)
        parameters += [] if read is None else [read]
    saving = list(_save_of(tree, definition))
    parameters += [parameter for parameter in saving if parameter.name not in {other.name for other in parameters}]
    parameters.sort(key=lambda parameter: bool(parameter.spelling) + (parameter.name in ("out", "force")))
    last = (JSON, QUIET) if progress else (JSON,)
    rest = parts.summary, parts.text, parts.examples
    return Command(name, module, function, *rest, (*parameters, *last), bool(saving))


def _parameter(argument: ast.arg, default: Any, help: str, *, first: bool) -> Parameter | None:
    """A parameter of a function as a word of its command; None for one that only Python has."""
    annotation, words = argument.annotation, list[str]()
    if isinstance(annotation, ast.Subscript) and _name(annotation.value) == "Annotated":
        assert isinstance(annotation.slice, ast.Tuple)
        annotation, note = annotation.slice.elts
        words = ast.literal_eval(note).split()
    read = _read_type(annotation)
    if read is None:
        return None
    type_, many, keys, choices = read
    flags = tuple(word for word in words if word.startswith("-"))
    bounds = next((match.groups() for word in words if (match := _BOUNDS.fullmatch(word))), (None, None))
    metavar = " ".join(word for word in words if word not in flags and not _BOUNDS.fullmatch(word)) or choices
    required = default is _REQUIRED or (metavar or "").endswith("!")
    name, further = argument.arg.replace("_", "-"), (metavar or "").startswith("<")
    if not (flags or first or further):
        name = name.removesuffix("s") if many else f"no-{name}" if default is True else name
        flags = ("--out", "-o") if name == "out" else (f"--{name}",)
    many |= (metavar or "").endswith("...")
    metavar = metavar and metavar.strip("<>!.")
    if not (flags or metavar):
        metavar = name.upper()
    help = _plain(help) + (" May be repeated." if flags and many else "")
    limits = tuple(None if bound is None else float(bound) for bound in bounds)
    assert len(limits) == 2
    default = None if default is _REQUIRED else default
    return Parameter(argument.arg, type_, help, default, flags, metavar, required, many, keys, limits)


_REQUIRED = object()


def _arguments(function: ast.FunctionDef) -> Iterator[tuple[ast.arg, Any]]:
    stated = function.args
    plain = [*stated.posonlyargs, *stated.args]
    defaults = [None] * (len(plain) - len(stated.defaults)) + [*stated.defaults]
    if stated.vararg is not None:
        yield stated.vararg, _REQUIRED
    for argument, default in [
        *zip(plain, defaults, strict=True),
        *zip(stated.kwonlyargs, stated.kw_defaults, strict=True),
    ]:
        if argument.arg != "self":
            yield argument, _REQUIRED if default is None else _value(default)


def _value(node: ast.expr) -> Any:
    """A default; None for one that is no literal, and for an empty list."""
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return None
    return None if value == () else value


def _read_type(node: ast.expr | None) -> tuple[type, bool, str, str | None] | None:
    """Type of one value, whether several may be stated, whether by keys, and choices; None for what is not text."""
    parts = list(_union(node))
    for part in parts:
        if isinstance(part, ast.Subscript):
            head = _name(part.value)
            if head == "Mapping":
                assert isinstance(part.slice, ast.Tuple)
                texts = "str" in map(_name, _union(part.slice.elts[1]))
                return str, texts, "str" if texts else "toml", None
            if head == "Sequence":
                inner = _read_type(part.slice)
                # Numbers that may also be one text, such as a box, are that text.
                if inner is not None and inner[0] in (int, float) and "str" in map(_name, parts):
                    continue
                return None if inner is None else (inner[0], True, "", inner[3])
            if head == "Literal":
                choices = part.slice.elts if isinstance(part.slice, ast.Tuple) else [part.slice]
                return str, False, "", "|".join(str(ast.literal_eval(choice)) for choice in choices)
    names = [_name(part) for part in parts]
    kinds = [_TYPES[name] for name in names if name in _TYPES]
    if Path in kinds or (kinds and not _TEXTS.intersection(names)):
        return Path if Path in kinds else kinds[0], False, "", None
    return (str, False, "", None) if _TEXTS.intersection(names) else None


def _union(node: ast.expr | None) -> Iterator[ast.expr]:
    if isinstance(node, ast.BinOp):
        yield from _union(node.left)
        yield from _union(node.right)
    elif node is not None and not (isinstance(node, ast.Constant) and node.value is None):
        yield node


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _save_of(tree: ast.Module, function: ast.FunctionDef) -> Iterator[Parameter]:
    """``out`` and ``force`` of the method that saves what a function returns, the first that there is."""
    classes = {statement.name: statement for statement in tree.body if isinstance(statement, ast.ClassDef)}
    for part in _union(function.returns):
        body = classes[_name(part)].body if _name(part) in classes else []
        for method in body:
            if isinstance(method, ast.FunctionDef) and method.name in ("save", "_write"):
                parts, whole = _Docstring(ast.get_docstring(method) or ""), method.name == "_write"
                if whole:
                    method.args.args[1].arg = "out"
                for argument, default in _arguments(method):
                    read = _parameter(argument, default, parts.args.get(argument.arg, parts.summary), first=False)
                    if read is not None and whole:
                        help = f"Folder for {read.help[:1].lower()}{read.help[1:]}"
                        yield replace(read, help=help, metavar="FOLDER", required=(read.metavar or "") != "")
                    elif read is not None:
                        yield replace(read, required=False)
                yield from [_FORCE] if whole else []
                return


class _Docstring:
    """Summary, paragraphs, ``Args`` and command lines of a docstring."""

    def __init__(self, text: str) -> None:
        head, *sections = re.split(r"\n\n(?=(?:Args|Examples|Raises|Returns|Note|Attributes):\n)", text)
        summary, _, rest = head.partition("\n\n")
        self.summary, self.text = _plain(" ".join(summary.split())), _plain(rest)
        bodies = {title: body for title, _, body in (section.partition(":\n") for section in sections)}
        shown = re.sub(r"\\\n\s*", "", bodies.get("Examples", ""))
        self.examples = tuple(re.findall(r"^\s*\$ (.*)$", shown, re.MULTILINE))
        self.args = {
            name: " ".join(body.split())
            for names, body in re.findall(r"^    ([\w, ]+): (.*(?:\n      .*)*)", bodies.get("Args", ""), re.MULTILINE)
            for name in names.split(", ")
        }


def _plain(text: str) -> str:
    text = re.sub(r":\w+:`(?:[\w.]*\.)?(\w+)`", r"\1", text)
    text = re.sub(r"``\"?(.*?)\"?``", r"'\1'", text)
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", ":")) or not text else ".")


@cache
def _source(module: str) -> str:
    root = Path(maskfab.__file__).parent
    return root.joinpath(*module.split(".")[1:]).with_suffix(".py").read_text(encoding="utf-8")


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(_source(module))


def tables(parameter: Parameter, stated: str | Sequence[str]) -> dict[str, Any]:
    """A mapping that is stated as a TOML table, or as KEY=VALUE. Raises JobError MF101 or MF105 for what is none."""
    from maskfab.base.errors import JobError

    option, cure = parameter.spelling[0], "Write it as --help shows"
    if parameter.keys == "str":
        pairs = [text.partition("=") for text in stated]
        wrong = [key for key, equals, _ in pairs if not equals or not key.strip()]
        if wrong:
            cure = f"Write it as {option} KEY=VALUE, such as {option} {parameter.metavar}"
            raise JobError("MF105", f"{wrong[0]!r} is no KEY=VALUE", where=option, cure=cure)
        names = [key.strip() for key, _, _ in pairs]
        twice = [key for key in names if names.count(key) > 1]
        if twice:
            raise JobError("MF102", f"{twice[0]} is given twice", where=option, cure="Give each name once")
        return {key.strip(): value.strip() for key, _, value in pairs}
    from maskfab.job.toml import loads

    assert isinstance(stated, str)
    try:
        table = loads(f"table = {stated}")["table"]
    except (ValueError, RecursionError) as error:
        raise JobError("MF101", f"{stated!r} is not a TOML table", where=option, cure=cure) from error
    if not isinstance(table, dict):
        raise JobError("MF105", f"{stated!r} is not a table", where=option, cure=cure)
    return table
