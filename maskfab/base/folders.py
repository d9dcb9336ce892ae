"""Output directories that appear whole or not at all, and take the place of nothing but an earlier result.

An earlier result is known by its manifest, which has every file's name and SHA-256; only what the manifest knows is
removed. New and old exchange their names: at once where the system can, through a third name elsewhere, from which a
result is put back if a process was killed meanwhile.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

from maskfab.base import __version__
from maskfab.base.effort import FormatCost
from maskfab.base.errors import OutputError
from maskfab.base.files import Aside, free_name, locked, make, not_writable, partial, stale, writing
from maskfab.base.provenance import sha256_of_file

OLD = ".old"
"""Ending of the third name; the folder of that name holds the second under its own."""
_HERE, _EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of renameat2(2)."""
_UNKNOWN = frozenset({errno.ENOSYS, errno.EINVAL, errno.EPERM, errno.EOPNOTSUPP})
"""Errors of systems that cannot exchange names; EPERM is a sandbox's word for a call that it does not know."""


def exchange(one: Path, other: Path) -> None:
    """Exchange the names of two folders of one parent; OSError where that fails, and both keep theirs."""
    if not _at_once(one, other):
        _by_turns(one, other)


def _at_once(one: Path, other: Path) -> bool:
    """Whether the system could exchange them in one step."""
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):
        return False
    if call(_HERE, ctypes.c_char_p(os.fsencode(one)), _HERE, ctypes.c_char_p(os.fsencode(other)), _EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNKNOWN:
        return False
    raise OSError(number, os.strerror(number), str(other))


def _by_turns(one: Path, other: Path) -> None:
    """Exchange them by three renames; a process that is killed in between leaves what :data:`OLD` names."""
    holder = make(other, OLD, os.mkdir)
    held = holder.path / other.name
    try:
        os.rename(other, held)
        try:
            os.rename(one, other)
        except OSError:
            _back(held, other)
            raise
        os.rename(held, one)
    finally:
        with suppress(OSError):  # where a name could not be given back, or the result not get another
            os.rmdir(holder.path)
        holder.close()


def _back(held: Path, other: Path) -> None:
    """Give a folder its name again, or a name that everybody sees if somebody has taken its own."""
    try:
        os.rename(held, other)
    except OSError:
        move(held, other, "old")
        raise


def move(folder: Path, beside: Path, word: str) -> Path:
    """Give a folder a name beside another that nobody has, and return it."""
    for name in free_name(beside, word):
        try:
            os.mkdir(name)
        except FileExistsError:
            continue
        os.rename(folder, name)
        return name
    raise AssertionError


RESULT_MARK = "manifest.json"
"""The file that every finished output directory has."""
TIMES = "timing.json"
"""The file beside it that tells how long the work took, and which findings the run made itself and which earlier ones
had kept: no two runs have it alike, and no manifest hashes it."""
REPORT, PAGE, OVERVIEW = "report.json", "report.html", "overview.png"
"""The numbers of a run, the page that a person signs, and the picture of the plate."""
APPENDIX, NUMBERS, VIEW = "appendix.html", "numbers.csv", "view.html"
"""Beside that page: every row, figure and method; every number of every die as a table; and the plate to look into."""
PRINT = "report.pdf"
"""The page on paper, where a run was asked for it."""
JOB_COPY = "job.json"
"""The resolved job of a run."""
_Trace = tuple[int, int, int]


@dataclass(frozen=True)
class Account:
    """Where one finding of a run comes from.

    Attributes:
        what: function that found it, in words.
        die: that it is of; None if it is of several.
        kept: whether an earlier run found it.
        since: when it was found, UTC by ISO 8601.
        entry: of the cache, by its key.
        refused: why an entry of an earlier run was not used, and this was found again; None if none was refused.
    """

    what: str
    die: str | None
    kept: bool
    since: str
    version: str
    entry: str
    refused: str | None = None


def write_mark(folder: Path, job_hash: str | None) -> None:
    """Write the manifest of all files of a folder, and of their job if any, by which an earlier result is known."""
    files = [
        {"path": path.name, "bytes": path.stat().st_size, "sha256": sha256_of_file(path)}
        for path in sorted(folder.iterdir())
    ]
    mark = {"maskfab_version": __version__, "job_hash": job_hash, "files": files}
    text = json.dumps(mark, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    (folder / RESULT_MARK).write_text(text, encoding="utf-8")


@dataclass(frozen=True)
class Finished:
    """A finished output directory as it was found.

    Attributes:
        digest: SHA-256 of its manifest, in which are those of its files.
        own: its files as the manifest knows them, the manifest last: name, and by which a change would show.
        strange: names of what it holds besides, or holds otherwise.
    """

    digest: str
    own: Mapping[str, _Trace]
    strange: tuple[str, ...]


def read_manifest(folder: Path) -> Mapping[str, Any]:
    """The manifest of a finished output directory; MF403 without one, or where it lacks what every version writes."""
    try:
        manifest = json.loads((folder / RESULT_MARK).read_text(encoding="utf-8"))
        listed = manifest["files"]
        complete = "maskfab_version" in manifest and all({"path", "sha256", "bytes"} <= file.keys() for file in listed)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        what = f"{folder} has no readable {RESULT_MARK}: {error}"
        raise OutputError("MF403", what, cure="Name the --out of a finished maskfab run") from error
    if not complete:
        raise OutputError("MF403", f"{folder / RESULT_MARK} lacks a version or hashes", cure="Run the job again")
    return dict(manifest)


def times_text(
    job_hash: str,
    seconds: Mapping[str, float],
    accounts: Iterable[Account] = (),
    formats: Iterable[FormatCost] | None = (),
) -> str:
    """The content of :data:`TIMES`; earlier versions said nothing of formats, which are None for them."""
    document: dict[str, Any] = {"job_hash": job_hash, "seconds": dict(seconds), "findings": [*map(asdict, accounts)]}
    if formats is not None:
        document["formats"] = [*map(asdict, formats)]
    return json.dumps(document, indent=1) + "\n"


def finished(folder: Path) -> Finished | None:
    """Known content of an output directory; None if it is not a finished result of maskfab."""
    try:
        content = (folder / RESULT_MARK).read_bytes()
        manifest = json.loads(content)
        hashes = (
            {row["path"]: row.get("sha256") for row in manifest["files"]} if "maskfab_version" in manifest else None
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if hashes is None:
        return None
    digest = hashlib.sha256(content).hexdigest()
    hashes[RESULT_MARK] = digest
    own: dict[str, _Trace] = {}
    strange = []
    for path in sorted(folder.iterdir(), key=lambda path: (path.name == RESULT_MARK, path.name)):
        trace = _trace(path)
        if path.is_symlink() or not path.is_file():
            strange.append(path.name)
        elif hashes.get(path.name) == sha256_of_file(path) or (path.name == TIMES and _is_times(path, manifest)):
            own[path.name] = trace
        else:
            strange.append(path.name)
    return Finished(digest, own, tuple(strange))


def _trace(path: Path) -> _Trace:
    status = path.lstat()
    return status.st_ino, status.st_size, status.st_mtime_ns


def _is_times(path: Path, manifest: Mapping[str, object]) -> bool:
    """Whether a file says what :func:`times_text` writes, and nothing else; earlier versions gave no account."""
    try:
        text = path.read_text(encoding="utf-8")
        document = json.loads(text)
        seconds = {str(stage): float(took) for stage, took in document["seconds"].items()}
        accounts = [Account(**row) for row in document.get("findings", ())]
        formats = [FormatCost(**row) for row in document["formats"]] if "formats" in document else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False
    job_hash = str(manifest.get("job_hash"))
    if "findings" not in document:
        return text == json.dumps({"job_hash": job_hash, "seconds": seconds}, indent=1) + "\n"
    return text == times_text(job_hash, seconds, accounts, formats)


def discard(folder: Path, target: Path, result: Finished | None) -> Path | None:
    """Remove a result that another has replaced, and nothing else.

    Args:
        folder: where it lies now.
        target: the name that it had.
        result: what is in it; None if it is none, or no longer.

    Returns:
        Where the rest lies, beside ``target``; None if there is none.

    Raises:
        OSError: if the rest cannot be moved.
    """
    for name, trace in () if result is None or result.strange else result.own.items():
        with suppress(OSError):
            # The manifest is last, and stays with whatever has come meanwhile.
            if _trace(folder / name) == trace and (name != RESULT_MARK or os.listdir(folder) == [name]):
                (folder / name).unlink()
    try:
        folder.rmdir()
    except FileNotFoundError:
        return None
    except OSError:
        return move(folder, target, "kept")
    return None


_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS})
_TAKEN = frozenset({errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR})
"""Errors of the system for giving a folder the name of what is not an empty folder."""
_NEW, _TURN = ".partial", ".turn"
"""Endings of the hidden names of what is not finished, which may be removed whole, and of one result while it exchanges
names with another: of whichever has it then, nothing may be removed that its manifest does not know.
"""
_PATIENCE_S = 60.0
"""For another process that replaces the same result; it takes as long as reading it twice."""


@dataclass(frozen=True)
class Place:
    """Where an output directory is to appear, and what was there when the work began.

    Attributes:
        asked: the path as it was given.
        path: the folder itself, behind whatever links lead there.
        digest: SHA-256 of the manifest of the result that is to be replaced; None if nothing may be.
    """

    asked: Path
    path: Path
    digest: str | None


def check_target(target: Path, *, force: bool) -> Place:
    """Refuse an output directory before any work starts; first put back what a killed process had taken away.

    Args:
        target: it may exist only if it is empty, or if ``force`` lets an earlier result be replaced.
        force: replace that, once the new one is complete; anything else is never replaced.

    Raises:
        OutputError: MF401 if the place cannot be written, MF402 if it is occupied.
    """
    path = Path(os.path.realpath(target))
    with writing(target):  # of a name that is too long, or a folder that may not be read
        put_back(path)
        if path.is_symlink():
            what = f"{target} is a link that leads nowhere"
            raise OutputError("MF401", what, cure="Remove that link, or give --out another folder")
        if path.exists() and not path.is_dir():
            raise OutputError("MF401", f"{target} is a file, not a directory", cure="Give --out the path of a folder")
        if os.path.ismount(path):
            cure = f"Choose a folder in it: --out {target / 'result'}"
            raise OutputError("MF401", f"{target} is a disk of its own, which no folder can replace", cure=cure)
        digest = None
        if path.is_dir() and any(path.iterdir()):
            digest = _replaceable(target, finished(path), force=force).digest
        parent = path.parent
        while not parent.exists():
            parent = parent.parent
        if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
            raise OutputError(
                "MF401", f"{parent} cannot be written", cure="Choose another --out, or mend its permissions"
            )
        return Place(target, path, digest)


def _replaceable(target: Path, result: Finished | None, *, force: bool) -> Finished:
    if result is None:
        what = f"the directory {target} is not empty and holds no maskfab result"
        raise OutputError("MF402", what, cure="Name a new or empty folder")
    if not force:
        what = f"the output directory {target} is not empty"
        raise OutputError("MF402", what, cure="Add --force to replace it, or choose another")
    if result.strange:
        what = f"the output directory {target} holds {result.strange[0]!r}, which maskfab did not write, or not so"
        raise OutputError("MF402", what, cure="Move it elsewhere, or choose another --out")
    return result


@contextmanager
def staged(place: Place) -> Iterator[Path]:
    """A directory to write into; it becomes ``place`` on success, and is removed on failure.

    Where something has come there meanwhile, or an earlier result was changed, both stay, under names that are told.

    Raises:
        OutputError: MF401 if the place cannot be written or has no room left, MF404 if it is no longer as it was.
    """
    target = place.path
    with writing(place.asked):
        target.parent.mkdir(parents=True, exist_ok=True)
        _sweep(target)
        aside = make(target, _NEW, os.mkdir)
    try:
        yield aside.path
        _put(aside, place)
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise not_writable(place.asked, error) from error
        raise
    finally:
        _clear(aside, place)
        aside.close()


def _put(aside: Aside, place: Place) -> None:
    """Give the finished directory its name, in place of nothing, of an empty folder, or of the result found before."""
    if Path(os.path.realpath(place.asked)) != place.path:
        _stop(aside, place, "leads elsewhere by now")
    begun = time.monotonic()
    try:
        while not _renamed(aside, place):
            if place.digest is None:
                _stop(aside, place, "is no longer empty")
            if time.monotonic() - begun > _PATIENCE_S:
                _stop(aside, place, "is held by another process")
            # Locked, so that nobody else replaces it, or takes it for a leftover while it has the hidden name.
            try:
                descriptor = locked(place.path)
            except (BlockingIOError, FileNotFoundError):
                time.sleep(0.01)
                continue
            except OSError:
                descriptor = None
            try:
                _replace(aside, place)
            finally:
                if descriptor is not None:
                    os.close(descriptor)
            return
    except OSError as error:
        raise not_writable(place.asked, error) from error


def _renamed(aside: Aside, place: Place) -> bool:
    """Whether nothing but an empty folder was in the way."""
    try:
        os.rename(aside.path, place.path)
    except OSError as error:
        if error.errno in _TAKEN:
            return False
        raise
    return True


def _replace(aside: Aside, place: Place) -> None:
    """Exchange old for new, and remove the old one unless something came until nobody can reach it under its name."""
    if _unchanged(place.path, place) is not None:
        new, aside = aside, _in_turn(aside)
        os.rename(new.path, aside.path)
        exchange(aside.path, place.path)
        result = _unchanged(aside.path, place)
        if result is not None:
            rest = discard(aside.path, place.path, result)
            if rest is not None:
                what = (
                    f"the new result lies in {place.asked}; the old one was changed while it was replaced, and the "
                    f"rest of it lies in {rest}"
                )
                raise OutputError("MF405", what, cure="Keep what you need of it, and delete the rest")
            return
        exchange(aside.path, place.path)
    _stop(aside, place, "no longer holds what was to be replaced, or more than that")


def _unchanged(folder: Path, place: Place) -> Finished | None:
    """The result that was result before, if it is that one and all that there is."""
    result = None if folder.is_symlink() else finished(folder)
    return None if result is None or result.strange or result.digest != place.digest else result


def _stop(aside: Aside, place: Place, why: str) -> NoReturn:
    beside = move(aside.path, place.path, "new")
    raise OutputError(
        "MF404", f"{place.asked} {why}: it stays as it is, and the new result lies in {beside}",
        cure="Move one of them to where you want it",
    )  # fmt: skip


def _in_turn(aside: Aside) -> Aside:
    return replace(aside, path=aside.path.with_suffix(_TURN))


def _clear(aside: Aside, place: Place) -> None:
    """Remove what an interruption leaves under the hidden names: the new result, finished or not, or the old one."""
    turn = _in_turn(aside)
    if turn.is_there():
        os.rename(turn.path, aside.path)
    else:
        _discard_old(turn.path, place.path)
    if aside.is_there():
        shutil.rmtree(aside.path, ignore_errors=True)


def _sweep(target: Path) -> None:
    """Remove what killed processes have left: unfinished directories, and results that had been replaced."""
    for left in stale(target, _NEW):
        shutil.rmtree(left, ignore_errors=True)
    for left in stale(target, _TURN):
        _discard_old(left, target)
    for holder in stale(target, OLD):
        _discard_old(holder / target.name, target)
        with suppress(OSError):
            holder.rmdir()


def _discard_old(folder: Path, target: Path) -> None:
    with suppress(OSError):
        discard(folder, target, finished(folder))


def put_back(target: Path) -> None:
    """Give a result its name again if a process was killed while it replaced it, where that takes several renames."""
    if target.parent.is_dir():
        for holder in stale(target, OLD):
            with suppress(OSError):
                os.rename(holder / target.name, target)  # which succeeds in place of nothing, or of an empty folder
                holder.rmdir()
                return


def check_file(target: Path, *, force: bool, option: str = "--out") -> None:
    """Refuse to write a file that an option names over another, or where nothing can be written (MF401, MF402)."""
    with writing(target):
        if target.is_dir():
            raise OutputError("MF401", f"{target} is a directory", cure=f"Give {option} the path of a file")
        if target.exists() and not target.is_file():
            what = f"{target} is a device, which no file can replace"
            raise OutputError("MF401", what, cure=f"Give {option} the path of an ordinary file")
        if target.exists() and not force:
            raise OutputError(
                "MF402", f"{target} exists", cure=f"Add --force to replace it, or choose another {option}"
            )
        path = Path(os.path.realpath(target))
        if path.is_symlink():
            what = f"{target} is a link that leads nowhere"
            raise OutputError("MF401", what, cure=f"Remove that link, or give {option} another path")
        parent = path.parent
        if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
            raise OutputError(
                "MF401", f"{target} cannot be written", cure="Choose a directory that exists and is writable"
            )


def write_text(target: Path, text: str, *, replace: bool = True) -> None:
    """Write a text in UTF-8 as :func:`write_bytes` does."""
    write_bytes(target, text.encode(), replace=replace)


def write_bytes(target: Path, content: bytes, *, replace: bool = True) -> None:
    """Write a file so that it is never half-written; raises as :func:`maskfab.base.files.partial`."""
    with partial(target, replace=replace) as aside:
        aside.write_bytes(content)
