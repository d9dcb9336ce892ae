"""The exception tree, its stable codes, and the exit code of each branch.

    MaskfabError
     ├─ InputError          exit 2: the user can correct it
     │   ├─ JobError        MF1xx  the job file
     │   │   ├─ MissingPackageError  MF152  a package of an extra that is not installed
     │   │   └─ ManyFaultsError  MF153  several faults of one input; ``faults`` has each as an error of its own
     │   ├─ OpeningError    MF2xx  an opening
     │   ├─ SourceError     MF3xx  a file that is read
     │   ├─ OutputError     MF4xx  the place results go to
     │   └─ UnknownNameError  MF432  a name that results are looked up by; a KeyError too
     └─ InternalError       MF9xx  exit 3: a fault of maskfab

Every error says what is wrong, the value with its unit, the limit, where it stands, and the cure. A refusal is written
so that code, place and cure stand on one line, and long texts have names:

    if width < line:
        what = f"a stop of {width:g} um is narrower than the wavelength of {line:g} um"
        raise JobError("MF104", what, where=where, cure='Give the diameter of the lens, such as "4 mm"')

"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from errno import ENOMEM
from functools import cache, partial
from pathlib import Path
from types import TracebackType
from typing import Self

_LACK_OF_MEMORY = ("bad_alloc", "failed to map segment", "Cannot allocate memory")
"""Words of C++, of the loader of libraries and of the C library."""

_LONGEST = 4000
"""Characters of each part of an error."""


@cache
def catalogue() -> Mapping[str, Mapping[str, str]]:
    """Meaning, example, usual cause and cure of every code, which are read only when somebody asks."""
    import tomllib

    return tomllib.loads(Path(__file__).with_name("error_codes.toml").read_text(encoding="utf-8"))


class MaskfabError(Exception):
    """Root of every error that maskfab raises on purpose.

    Args:
        code: a key of :func:`catalogue`.
        what: what is wrong, with the value and its unit and the limit it breaks.
        where: file and key (``layouts/x.toml: camera.focal``), or empty.
    """

    exit_code = 3

    def __init__(self, code: str, what: str, *, where: str = "", cure: str = "") -> None:
        what, where, cure = (
            text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} [...] {text[-_LONGEST // 2 :]}"
            for text in (what, where, cure)
        )
        self.code = code
        self.what = what
        self.where = where
        self.cure = cure
        place = f" ({where})" if where else ""
        remedy = f" {cure}" if cure else ""
        super().__init__(f"{code} {what}{place}.{remedy}")

    @property
    def summary(self) -> str:
        """The one line that every error of its code shares."""
        return catalogue()[self.code]["meaning"]

    @property
    def faults(self) -> tuple[MaskfabError, ...]:
        """All that is wrong, each as an error of its own; of most errors the error itself."""
        return (self,)

    def reword(self, word: Callable[[str], str]) -> None:
        """Put what it says in the words of another caller; an error keeps its traceback."""
        MaskfabError.__init__(self, self.code, word(self.what), where=word(self.where), cure=word(self.cure))

    def to_dict(self) -> dict[str, object]:
        """Plain data: code, what, where and cure, and those of every fault."""
        facts = [{"code": e.code, "what": e.what, "where": e.where, "cure": e.cure} for e in (self, *self.faults)]
        return {**facts[0], "faults": facts[1:]}

    def __reduce__(self) -> tuple[Callable[..., MaskfabError], tuple[object, ...]]:
        return partial(type(self), where=self.where, cure=self.cure), (self.code, self.what)


def is_lack_of_memory(error: BaseException) -> bool:
    """Whether an exception says that the system refuses memory, in the words of whichever library asked for it."""
    return (
        isinstance(error, MemoryError)
        or (isinstance(error, OSError) and error.errno == ENOMEM)
        or any(words in str(error) for words in _LACK_OF_MEMORY)
    )


class InputError(MaskfabError):
    """The user's input is at fault; nothing was written."""

    exit_code = 2


class JobError(InputError):
    """The job file asks for something that cannot be made."""


class MissingPackageError(JobError):
    """Work is asked for that needs a package which is not installed."""


class ManyFaultsError(JobError):
    """Several faults of one input, told at once: two or more, in the order in which they are told."""

    def __init__(self, faults: Sequence[MaskfabError]) -> None:
        places = {fault.where.partition(": ")[0] for fault in faults}
        where = places.pop() if len(places) == 1 else ""
        super().__init__("MF153", f"{len(faults)} faults", where=where, cure="Write what each of them says")
        self._faults = tuple(faults)
        self.args = ("\n".join([str(self), *(f"  {fault}" for fault in faults)]),)

    def reword(self, word: Callable[[str], str]) -> None:
        """Put every fault in the words of another caller."""
        for fault in self._faults:
            fault.reword(word)
        ManyFaultsError.__init__(self, self._faults)

    @property
    def faults(self) -> tuple[MaskfabError, ...]:
        """The faults, one or more lines of the message each."""
        return self._faults

    def __reduce__(self) -> tuple[Callable[..., MaskfabError], tuple[object, ...]]:
        return type(self), (self._faults,)


class OpeningError(InputError):
    """An opening is malformed."""


class SourceError(InputError):
    """A file that was to be read is missing, damaged or of another kind."""


class OutputError(InputError):
    """Results cannot be put where the user wants them."""


class UnknownNameError(InputError, KeyError):
    """A result is asked for a number or a die that it does not have."""

    def __str__(self) -> str:
        return str(self.args[0])


class InternalError(MaskfabError):
    """An invariant of maskfab itself was broken."""


class AtFault(Exception):  # noqa: N818 - no error of its own: the fault that it follows from is told
    """A value that is at fault itself is read; what reads it has nothing to judge."""


class Faults:
    """Faults of one input, gathered so that all are told at once.

        faults = Faults()
        with faults:
            check_lens(camera)
        with faults:
            check_scene(scene)
        faults.refuse()

    A block ends at its first refusal, and in silence where it reads a value that is known to be at fault.
    """

    def __init__(self) -> None:
        self._found: list[MaskfabError] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def __iter__(self) -> Iterator[MaskfabError]:
        return iter(self._found)

    def add(self, fault: MaskfabError) -> None:
        """Keep a fault, or those that it consists of; what was told of a place is not told again."""
        told = {(known.code, known.where or known.what) for known in self._found}
        self._found += [one for one in fault.faults if (one.code, one.where or one.what) not in told]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(error, InputError):
            self.add(error)
        return isinstance(error, InputError | AtFault)

    def refuse(self) -> None:
        """Raise what was found: nothing for none, one as it is, several as one."""
        if len(self._found) > 1:
            raise ManyFaultsError(self._found)
        if self._found:
            raise self._found[0]
