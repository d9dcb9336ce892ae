"""The golden set: what users get from every verb, recorded, and compared with what they got before.

    python tests/golden_set.py record    write the record, tests/golden/
    python tests/golden_set.py compare   run the same cases again and print what differs; exit 1 if anything does

A case is one command in a folder of its own, see ``golden_cases.py``. Its record holds the exit code, what stands on
stdout, and the SHA-256 of every file written. The package is asked through ``python -m maskfab`` and through its public
names alone, so that the set outlives any move of modules.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from threading import Timer
from typing import Any

import golden_inputs
from golden_cases import CASES, DROPPED, KEYED, MEASURED, UNORDERED, Case

ROOT = Path(__file__).resolve().parents[1]
RECORD = Path(__file__).resolve().parent / "golden"
LONGEST_TEXT = 240
"""Characters of a text that is recorded whole; of a longer one, beginning and hash."""
LONGEST_S = 1800
"""Seconds after which a case is ended."""
DEEPEST = 6
"""Levels of a document that are recorded part by part; what lies deeper is hashed."""
WHOLE = 600
"""Characters of a document that is recorded as it is."""
_NUMBER = re.compile(r" *\d[\d.]*(e[+-]\d+)?")
"""What a measured text has in place of #: numbers, with the spaces that align them."""


@dataclass(frozen=True)
class Outcome:
    """A case that was run.

    Attributes:
        record: what is kept of it.
        seconds: processor time, children included.
        complaint: the end of stderr.
    """

    record: dict[str, Any]
    seconds: float
    complaint: str


def main() -> int:
    """Record or compare, as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["record", "compare"])
    parser.add_argument("--only", nargs="+", metavar="NAME", help="cases, or groups such as run/")
    parser.add_argument("--quick", action="store_true", help="the cheap cases: a minute of processor time")
    parser.add_argument("--slow", action="store_true", help="the slow cases too")
    parser.add_argument("--jobs", type=int, default=2, help="cases side by side")
    parser.add_argument("--work", type=Path, help="folder to work in, which stays; its cases/NAME/work shows the files")
    asked = parser.parse_args()
    chosen = [case for case in CASES if _is_asked(case, asked)]
    if not chosen:
        parser.error("no case has such a name")
    with tempfile.TemporaryDirectory(prefix="golden-") as temporary:
        work = (asked.work or Path(temporary)).resolve()
        shutil.rmtree(work / "cases", ignore_errors=True)
        outcomes = run_all(chosen, work, asked.jobs)
    print(f"{len(outcomes)} cases, {sum(done.seconds for done in outcomes.values()):.0f} s of processor time")
    records = {name: done.record for name, done in outcomes.items()}
    if asked.what == "record":
        whole = not (asked.only or asked.quick)
        write(records, anew=whole, unasked={case.name for case in CASES if case.slow and not asked.slow})
        return 0
    return compare(records)


def _is_asked(case: Case, asked: argparse.Namespace) -> bool:
    in_pace = (asked.slow or not case.slow) and (case.quick or not asked.quick)
    if asked.only:
        return case.name in asked.only or (in_pace and f"{case.name.split('/')[0]}/" in asked.only)
    return in_pace


# Running


def run_all(cases: list[Case], work: Path, jobs: int) -> dict[str, Outcome]:
    """Outcomes of cases, and the running of those that they go on from."""
    by_name = {case.name: case for case in CASES}
    needed: dict[str, Case] = {}

    def need(case: Case) -> None:
        if case.after:
            need(by_name[case.after])
        needed[case.name] = case

    for case in cases:
        need(case)
    done: dict[str, Outcome] = {}
    running: dict[Future[Outcome], str] = {}
    with ThreadPoolExecutor(jobs) as pool:
        waiting = list(needed.values())
        while waiting or running:
            for case in [case for case in waiting if not case.after or case.after in done]:
                waiting.remove(case)
                running[pool.submit(run, case, work)] = case.name
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                name = running.pop(future)
                done[name] = future.result()
                print(f"{done[name].seconds:6.1f} s  exit {done[name].record['exit']}  {name}", flush=True)
                if done[name].record["exit"] not in by_name[name].exits:
                    print(done[name].complaint, flush=True)
    return {case.name: done[case.name] for case in cases}


def run(case: Case, work: Path) -> Outcome:
    """Run a case in a new folder, with an empty store of kept findings."""
    place = work / "cases" / case.name
    folder = place / "work"
    if case.after:
        shutil.copytree(work / "cases" / case.after / "work", folder, symlinks=True)
    else:
        folder.mkdir(parents=True)
    store = place / "store"
    if case.store:
        shutil.copytree(work / "cases" / case.after / "store", store)
    for name in case.inputs:
        golden_inputs.lay(name, folder)
    for file, old, new in case.edits:
        text = (folder / file).read_text(encoding="utf-8")
        assert old in text, (case.name, old)
        (folder / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    before = {path: _digest(path.read_bytes()) for path in _files(folder)}
    with (place / "stdout").open("wb") as out, (place / "stderr").open("wb") as err:
        process = subprocess.Popen(
            _command(case), cwd=folder, env=_environment(work, place, store), stdin=subprocess.DEVNULL, stdout=out,
            stderr=err,
        )  # fmt: skip
        watch = Timer(LONGEST_S, process.kill)
        watch.start()
        _, status, used = os.wait4(process.pid, 0)
        watch.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
    clean = Cleaner(case, {str(folder): "{work}", str(place): "{place}", str(ROOT): "{checkout}"})
    record: dict[str, Any] = {"exit": process.returncode, "stdout": clean.text((place / "stdout").read_bytes())}
    files: dict[str, Any] = {}
    for path in _files(folder):
        if before.get(path) != _digest(path.read_bytes()):
            name = KEYED.sub("KEY", path.relative_to(folder).as_posix())
            files[name] = [*files.get(name, []), clean.file(path)] if "KEY" in name else clean.file(path)
    for name in (name for name in files if "KEY" in name):
        files[name].sort()
    if files:
        record["files"] = files
    if gone := sorted(path.relative_to(folder).as_posix() for path in before if not path.exists()):
        record["gone"] = gone
    complaint = (place / "stderr").read_text(errors="replace")[-1500:]
    return Outcome(record, used.ru_utime + used.ru_stime, complaint)


def _command(case: Case) -> list[str]:
    """The case's words, for this Python; ``-P``, so that no file of a case is imported."""
    words = shlex.split(case.command)
    if words[0] == "python":
        return [sys.executable, *(word.replace("{tests}", str(Path(__file__).parent)) for word in words[1:])]
    return [sys.executable, "-P", "-m", "maskfab", *words, *(() if case.text else ("--json",))]


def _environment(work: Path, place: Path, store: Path) -> dict[str, str]:
    """Nothing of the user's but the path of programs."""
    for folder in (work / "matplotlib", place / "home", place / "temporary"):
        folder.mkdir(parents=True, exist_ok=True)
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
    return {
        **dict.fromkeys(threads, "1"),
        "PATH": os.environ.get("PATH", ""),
        "PYTHONPATH": str(ROOT),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HOME": str(place / "home"),
        "TMPDIR": str(place / "temporary"),
        "MASKFAB_CACHE": str(store),
        # To list the fonts takes seconds, and one list serves all.
        "MPLCONFIGDIR": str(work / "matplotlib"),
        "TZ": "UTC",
        "LANG": "C.UTF-8",
        "LC_ALL": "C.UTF-8",
        "COLUMNS": "120",
        "NO_COLOR": "1",
    }


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


# What is kept of an answer


@dataclass(frozen=True)
class Cleaner:
    """Takes out of answers what no two runs share, by the rules of ``golden_cases.py``.

    Attributes:
        case: whose answers they are.
        places: folders that are written as words.
    """

    case: Case
    places: dict[str, str]

    def text(self, content: bytes) -> Any:
        """Record of what stood on stdout: an outline of a document, or the lines of a text."""
        told = self._without_places(content).decode(errors="replace")
        try:
            document = json.loads(told)
        except ValueError:
            if self.case.shape:
                told = _NUMBER.sub("#", told)
            if len(told) <= self.case.longest_text:
                return told.splitlines()
            return {"sha256": _digest(told.encode()), "begins": told[:LONGEST_TEXT].splitlines()}
        kept = self._document(document)
        outlined = outline(kept)
        if kept != document or not isinstance(outlined, dict) or len(told) <= WHOLE:
            return outlined
        return {"": f"sha256 {_digest(told.encode())}", **outlined}

    def file(self, path: Path) -> Any:
        """Record of a file: size and SHA-256; of a package, each of its members."""
        if path.name in DROPPED or path.name in self.case.timed:
            return "not compared"
        if path.suffix == ".zip":
            with zipfile.ZipFile(path) as package:
                return {
                    member.filename: self._content(member.filename, package.read(member))
                    for member in package.infolist()
                }
        return self._content(path.name, path.read_bytes())

    def _content(self, name: str, content: bytes) -> str:
        content = self._without_places(content)
        if name.endswith(".json"):
            document = json.loads(content)
            kept = self._document(document)
            if kept != document:
                content = json.dumps(kept, indent=1, ensure_ascii=False).encode()
                return f"{_digest(content)} without what differs in every run"
        if self.case.shape:
            return "not compared"
        return f"{_digest(content)} {len(content)} bytes"

    def _without_places(self, content: bytes) -> bytes:
        for place, word in self.places.items():
            content = content.replace(place.encode(), word.encode())
        return content

    def _document(self, value: Any, at: str = "") -> Any:
        """The document without what is measured or belongs to the installation."""
        if isinstance(value, dict):
            return {
                key: "measured" if MEASURED.fullmatch(f"{at}.{key}") else self._document(part, f"{at}.{key}")
                for key, part in value.items()
            }
        if isinstance(value, list):
            parts = [self._document(part, f"{at}[]") for part in value]
            return sorted(parts, key=json.dumps) if UNORDERED.fullmatch(at) else parts
        if self.case.shape and isinstance(value, str) and not at.endswith((".code", ".name")):
            return _NUMBER.sub("#", value)
        if self.case.shape and isinstance(value, int | float) and not isinstance(value, bool):
            return "number"
        return value


def outline(value: Any, depth: int = 0) -> Any:
    """A document with its long parts hashed: each quantity is one line, with its value."""
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        return f"{value[:60]} ... sha256 {_digest(value.encode())[:16]}"
    if not isinstance(value, dict | list):
        return value
    text = json.dumps(value, ensure_ascii=False)
    if depth and len(text) <= 100:
        return value
    if isinstance(value, dict):
        if depth and "value" in value:
            return f"{json.dumps(value['value'], ensure_ascii=False)[:60]} {_digest(text.encode())[:16]}"
        if depth < DEEPEST:
            return {key: outline(part, depth + 1) for key, part in value.items()}
    elif depth < DEEPEST and len(value) <= 4 and any(isinstance(part, list | str) for part in value):
        return [outline(part, depth + 1) for part in value]
    elif depth < DEEPEST and 0 < len(value) <= 400 and all(isinstance(part, dict) for part in value):
        return dict(zip(_names(value), (outline(part, depth + 1) for part in value), strict=True))
    return f"sha256 {_digest(text.encode())[:16]}, {len(value)} parts, {len(text)} characters"


def _names(parts: list[dict[str, Any]]) -> Iterator[str]:
    """A name for each part, by what it calls itself."""
    times: Counter[str] = Counter()
    for part in parts:
        name = next((str(part[key]) for key in ("name", "die", "path", "design", "code") if key in part), "")[:80]
        times[name] += 1
        yield name if name and times[name] == 1 else f"{name}#{times[name]}"


# The record


def write(records: dict[str, Any], *, anew: bool, unasked: set[str]) -> None:
    """Write records, one file for each group of cases.

    Args:
        records: of cases by name.
        anew: forget records of cases that there are no longer.
        unasked: names of cases that keep their old record all the same.
    """
    RECORD.mkdir(exist_ok=True)
    old = recorded()
    kept = {name: record for name, record in old.items() if not anew or name in unasked}
    groups: dict[str, dict[str, Any]] = {}
    for name, record in sorted({**kept, **records}.items()):
        groups.setdefault(name.split("/")[0], {})[name] = record
    for path in RECORD.glob("*.json"):
        path.unlink()
    for group, content in groups.items():
        _write(RECORD / f"{group}.json", content)
    _write(RECORD / "environment.json", environment())


def _write(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def recorded() -> dict[str, Any]:
    """Records by the names of their cases."""
    found: dict[str, Any] = {}
    for path in sorted(RECORD.glob("*.json")):
        if path.name != "environment.json":
            found |= json.loads(path.read_text(encoding="utf-8"))
    return found


def environment() -> dict[str, str]:
    """What the bytes of files depend on besides the package."""
    names = {
        re.split(r"[^\w.-]", line)[0].lower() for line in metadata.requires("maskfab") or () if "extra" not in line
    }
    return {
        "machine": platform.machine(),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in sorted(names)},
    }


def compare(records: dict[str, Any]) -> int:
    """Print what differs from the record; 1 if anything does."""
    then, now = json.loads((RECORD / "environment.json").read_text(encoding="utf-8")), environment()
    for name in sorted(then.keys() | now.keys()):
        if then.get(name) != now.get(name):
            print(f"recorded with {name} {then.get(name)}, compared with {now.get(name)}: bytes may differ for that")
    before = recorded()
    different = 0
    for name, record in records.items():
        if name not in before:
            print(f"{name}: is not in the record")
            different += 1
            continue
        lines = list(differences(before[name], record))
        different += bool(lines)
        if lines:
            print(f"{name}: {len(lines)} differences")
            print("\n".join(f"    {line}" for line in lines[:25]))
    print(f"{different} of {len(records)} cases differ" if different else f"all {len(records)} cases are equal")
    return int(bool(different))


def differences(before: Any, after: Any, at: str = "") -> Iterator[str]:
    """A line for each place where two records differ."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in [*before, *(key for key in after if key not in before)]:
            place = f"{at} / {key}" if at else key
            if key not in after:
                yield f"{place}: {_short(before[key])} is gone"
            elif key not in before:
                yield f"{place}: {_short(after[key])} is new"
            else:
                yield from differences(before[key], after[key], place)
        if before == after and list(before) != list(after):
            yield f"{at}: another order, {_short(list(after))}"
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for index, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differences(one, other, f"{at}[{index}]")
    elif before != after:
        yield f"{at}: {_short(before)} -> {_short(after)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}..."


if __name__ == "__main__":
    sys.exit(main())
