"""The report on paper: a browser that is installed prints its page, whose style of print needs no hand.

Equal pages give equal bytes from one browser: the dates that it puts in are all one day. Links to the files beside the
page are left out, for a browser would write where they lay when it printed.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from maskfab.base import provenance
from maskfab.base.errors import OutputError
from maskfab.base.folders import APPENDIX, NUMBERS, PAGE, PRINT, RESULT_MARK, VIEW

BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge", "microsoft-edge",
)  # fmt: skip
"""Programs that print a page without a window, by their names; the first that is installed is taken."""
_FLAGS = ("--headless", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run", "--no-pdf-header-footer")
_PATIENCE_S = 180.0
_BESIDE = re.compile(rf'href="(?:{"|".join(map(re.escape, (APPENDIX, NUMBERS, VIEW)))})[^"]*"')
_DATE = re.compile(rb"\(D:\d{14}[^)]*\)")
_CURE = f"Install Chromium, Chrome or Edge, or leave --pdf out and print {PAGE} from any browser: it is laid out for A4"


def browser() -> str:
    """Path of the browser that prints."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise OutputError("MF438", f"none of {', '.join(BROWSERS)} is on the PATH", where="--pdf", cure=_CURE)
    return found


def print_report(folder: Path, program: str) -> None:
    """Print the page of a finished folder into it, and add it to the manifest. Raises OutputError MF439 if the browser
    does not print."""
    page = _BESIDE.sub("", (folder / PAGE).read_text(encoding="utf-8"))
    (folder / PRINT).write_bytes(_printed(page, program))
    mark = folder / RESULT_MARK
    manifest = json.loads(mark.read_text(encoding="utf-8"))
    manifest["files"].append(vars(provenance.file_record(folder, folder / PRINT, "report")))
    mark.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")


def _printed(page: str, program: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="maskfab-print-") as aside:
        source, paper = Path(aside) / PAGE, Path(aside) / PRINT
        source.write_text(page, encoding="utf-8")
        # A browser of root's has no sandbox; the page holds no scripts, and nothing is fetched.
        rights = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        home = f"--user-data-dir={Path(aside) / 'home'}"
        command = [program, *_FLAGS, *rights, home, f"--print-to-pdf={paper}", source.as_uri()]
        try:
            done = subprocess.run(
                command, check=False, capture_output=True, stdin=subprocess.DEVNULL, timeout=_PATIENCE_S
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise _not_printed(program, str(error)) from error
        if not paper.exists():
            raise _not_printed(program, done.stderr.decode(errors="replace").strip()[-200:])
        return _DATE.sub(_one_day, paper.read_bytes())


def _one_day(date: re.Match[bytes]) -> bytes:
    """A date of as many bytes, so that every place in the file stays where its table says."""
    return b"(D:19700101000000" + b"Z".ljust(len(date[0]) - 18, b" ") + b")"


def _not_printed(program: str, why: str) -> OutputError:
    return OutputError("MF439", f"{program} did not print {PAGE}: {why}", where="--pdf", cure=_CURE)
