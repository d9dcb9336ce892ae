"""Messages of processes that read foreign files: plain data, so that whatever a file makes of such a process, no code
comes from it. What an answer is, only who asks says (see :mod:`maskfab.files.plain_data`).

A message is one letter and what follows from it: an answer as typed data; progress, an error of maskfab, or a fault of
another kind as JSON.
"""

from __future__ import annotations

import io
import json
import traceback
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from maskfab.errors import (
    CATALOGUE,
    InputError,
    InternalError,
    JobError,
    MaskfabError,
    OpeningError,
    OutputError,
    SourceError,
)
from maskfab.files.plain_data import from_data, to_data

_ANSWER, _PROGRESS, _ERROR, _FAULT = b"A", b"P", b"E", b"F"
_ERRORS: Mapping[str, type[MaskfabError]] = MappingProxyType(
    {
        each.__name__: each
        for each in (InputError, JobError, OpeningError, SourceError, OutputError, InternalError, MaskfabError)
    }
)
_LONGEST = 10_000
"""Characters of what a fault says, and of where it happened."""


def answer_message(answer: object, kind: Any) -> bytes:
    """An answer of a kind that :func:`maskfab.files.plain_data.to_data` takes."""
    return _ANSWER + to_data(answer, kind)


def progress_message(stage: str, done: int, total: int) -> bytes:
    """Where the work stands."""
    return _PROGRESS + json.dumps([stage, done, total]).encode()


def error_message(error: Exception) -> bytes:
    """Any exception; those that are not maskfab's in words."""
    where = traceback.format_exc()[-_LONGEST:]
    if isinstance(error, MaskfabError):
        kind = type(error).__name__
        told = [kind if kind in _ERRORS else InputError.__name__, error.code, error.what, error.where, error.cure]
        return _ERROR + json.dumps([*told, where]).encode()
    return _FAULT + json.dumps([f"{type(error).__name__}: {error}"[:_LONGEST], where]).encode()


def read_message(message: bytes, kind: Any, path: Path, progress: Callable[[str, int, int], None]) -> tuple[Any, ...]:
    """The answer, alone in a tuple; nothing yet for progress, which is passed on.

    Args:
        message: of a process that nobody trusts.
        kind: of the answer.
        path: of the file that it reads.
        progress: told where the work stands.

    Raises:
        MaskfabError: that of the process; InternalError MF901 for a fault of another kind.
        SourceError: MF327 if the message is none.
    """
    raised: MaskfabError
    try:
        letter, content = message[:1], message[1:]
        if letter == _ANSWER:
            return (from_data(_as_stored(content), kind),)
        told = json.loads(content)
        if letter == _PROGRESS:
            stage, done, total = told
            _require(isinstance(stage, str) and len(stage) <= _LONGEST and {type(done), type(total)} == {int})
            progress(stage, done, total)
            return ()
        _require(letter in (_ERROR, _FAULT) and all(isinstance(each, str) for each in told))
        if letter == _ERROR:
            name, code, what, where, cure, trace = told
            _require(code in CATALOGUE)
            raised = _ERRORS[name](code, what, where=where, cure=cure)
        else:
            fault, trace = told
            raised = InternalError("MF901", fault, cure="Please report this with the file")
    except Exception as error:
        raise unusable(path, error) from error
    raised.add_note(trace[-_LONGEST:])
    raise raised


def unusable(path: Path, why: Exception) -> SourceError:
    """MF327 for what is no message, or too long."""
    what = f"the process that reads {path.name} gives an answer that cannot be used ({type(why).__name__})"
    cure = "Do not trust the file; if you know its source, write it again"
    return SourceError("MF327", what, where=str(path), cure=cure)


def _as_stored(data: bytes) -> bytes:
    """The data of an archive in which nothing is packed, and so nothing unpacks to more than it takes."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
    _require(all(member.compress_type == zipfile.ZIP_STORED for member in members))
    _require(sum(member.file_size for member in members) <= len(data))
    return data


def _require(held: bool) -> None:
    if not held:
        raise ValueError
