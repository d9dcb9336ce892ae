"""Results of verbs, and the answers that their commands print of them."""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar

from maskfab.base.errors import JobError
from maskfab.base.folders import Place, check_target
from maskfab.base.work import Progress, silent

if TYPE_CHECKING:
    from pandas import DataFrame

    from maskfab.base.model import Quantity
    from maskfab.report.figures.sheet import Drawing
    from maskfab.report.text import Quantities
    from maskfab.report.verdicts import Verdicts


Hint = TypeVar("Hint")
Taken = TypeVar("Taken")
InPython: TypeAlias = Annotated[Hint, ""]
"""A parameter of a verb that its command has not."""
Hook = TypeVar("Hook", bound="Callable[[Asked], Told]")


class Result:
    """A finding: ``print`` says it, ``to_dict`` is its JSON, ``save`` writes its files, notebooks show it."""

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return True

    @property
    def numbers(self) -> Quantities:
        """Every reported number."""
        from maskfab.report.text import Quantities

        return Quantities(())

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as ``--json`` prints it."""
        raise NotImplementedError

    def rows(self) -> Iterable[Mapping[str, Any]]:
        """Rows of :meth:`to_dataframe`: one for each number."""
        return self.numbers.to_dict()

    def to_dataframe(self) -> DataFrame:
        """The rows as a table."""
        from maskfab.report.text import dataframe

        return dataframe([dict(row) for row in self.rows()])

    def plot(self) -> Drawing | None:
        """A drawing, where there is one."""
        return None

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str | None:
        """The picture, where there is one, over the numbers, or the words that ``print`` says: for notebooks."""
        words = self.numbers._repr_html_() if len(self.numbers) else f"<pre>{html.escape(str(self))}</pre>"
        return f"{self._shown()}{words}"

    def _shown(self) -> str:
        drawing = self.plot()
        if drawing is not None:
            return drawing.svg()
        picture = getattr(self, "_repr_png_", lambda: None)()
        return "" if picture is None else f'<img src="data:image/png;base64,{b64encode(picture).decode()}">'

    def _repr_svg_(self) -> str | None:
        drawing = self.plot()
        return None if drawing is None else drawing.svg()


class FolderResult(Result):
    """A finding whose files fill a directory."""

    def save(self, out: str | Path, *, force: bool = False) -> list[Path]:
        """Write the files of the result into a directory that appears whole.

        Args:
            out: the directory.
            force: replace an earlier result.
        """
        return self._write(check_target(Path(out), force=force))

    def _write(self, place: Place) -> list[Path]:
        raise NotImplementedError


@dataclass
class Asked:
    """A command as it was typed.

    Attributes:
        stated: its arguments, but for those that were left out.
        out: where the result is saved; None for nowhere.
        force: whether an earlier result may be replaced.
        as_json: whether a document is wanted.
        quiet: whether progress is not.
        progress: told where the work stands.
        tell: says a line on stderr at once.
        prompt: asks a person for a line of text.
    """

    function: Callable[..., Any]
    stated: dict[str, Any]
    words: Sequence[str] = ()
    out: Path | None = None
    force: bool = False
    as_json: bool = False
    quiet: bool = False
    attended: bool = False
    progress: Progress = silent
    tell: Callable[[str], None] = print
    prompt: Callable[[str], str] = input

    def found(self, **more: Any) -> Any:
        """The result of the function; arguments in ``more`` come first."""
        return self.function(**{**self.stated, **more})

    def answered(self, question: str, take: Callable[[str], Taken]) -> tuple[str, Taken] | None:
        """A person's answer and what ``take`` makes of it, asked again with the cure while that refuses it.

        None where the line is left blank.
        """
        while text := self.prompt(question).strip():
            try:
                return text, take(text)
            except JobError as refusal:
                self.tell(f"  {refusal.what}. {refusal.cure}")
        return None


@dataclass
class Told:
    """An answer of the command line.

    Attributes:
        document: for ``--json``.
        lines: for people, on stdout.
        passed: whether the exit code is 0, and not 1.
        asides: lines for stderr.
        remarks: lines for stderr beside the text, not beside a document.
    """

    document: Mapping[str, Any]
    lines: Iterable[str]
    passed: bool = True
    asides: Sequence[str] = ()
    remarks: Sequence[str] = field(default=())

    @classmethod
    def of(cls, result: Any, paths: Iterable[Path] = (), **more: Any) -> Told:
        """The answer of a result, with the files that hold it and what its document says ``more``."""
        lines = [*str(result).split("\n"), *map(str, paths)]
        return cls({**result.to_dict(), **more}, lines, getattr(result, "passed", True))


_ANSWERS: dict[str, Callable[[Asked], Told]] = {}


def answers(function: Callable[..., Any]) -> Callable[[Hook], Hook]:
    """Mark what answers a command where :func:`answer` would not do."""

    def marked(hook: Hook) -> Hook:
        _ANSWERS[f"{function.__module__}.{function.__name__}"] = hook
        return hook

    return marked


def answer(asked: Asked) -> Told:
    """Do what is asked for, save it if that was asked for too, and say it."""
    function = asked.function
    hook = _ANSWERS.get(f"{function.__module__}.{function.__name__}", saved)
    return hook(asked)


def saved(asked: Asked, **more: Any) -> Told:
    """The usual answer: the place is looked at before any work, and ``path`` in ``more`` is where the files are."""
    if asked.out is None:
        return Told.of(asked.found())
    check_target(asked.out, force=asked.force)
    result = asked.found()
    # A result that replaces none, such as a race of ways to a PSF, has no ``force``.
    replacing = {"force": asked.force} if "force" in signature(result.save).parameters else {}
    return Told.of(result, result.save(asked.out, **replacing), **more)


def saved_at(asked: Asked) -> Told:
    """The usual answer, whose document names the place of the files."""
    return saved(asked, **({} if asked.out is None else {"path": str(asked.out)}))


def verdict_lines(checks: Iterable[Quantity], verdicts: Verdicts) -> list[str]:
    """Every failed check, every note, which has no verdict, and the five verdicts."""
    from maskfab.report.text import note_lines, place_text

    lines = []
    for check in checks:
        if check.passed is None:
            lines += note_lines([check])
        elif not check.passed:
            line = f"{check.name}{place_text(check)} = {check.value} {check.unit} (limit {check.limit}): {check.method}"
            lines.append(f"FAIL {line}")
    return [*lines, *verdicts.lines]
