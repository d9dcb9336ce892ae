"""A browser without a window, which loads a page, tells what its scripts have made of it, and prints it on paper."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)
PATIENCE_S = 60


def installed() -> str:
    """The browser's path; skips where there is none."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed")
    return browser


def dumped(browser: str, page: Path, home: Path, *flags: str) -> str:
    """Text of a page after its scripts; skips where the browser itself does not work."""
    text, _ = _said(browser, page, home, "--dump-dom", *flags)
    if "</html>" not in text:
        pytest.skip(f"{browser} shows no page here")
    return text


def printed(browser: str, page: Path, home: Path) -> tuple[bytes, str]:
    """A page on paper, as PDF, and what the browser's log says; skips where the browser itself does not print."""
    paper = home.with_suffix(".pdf")
    _, log = _said(
        browser, page, home, "--no-pdf-header-footer", f"--print-to-pdf={paper}", "--enable-logging=stderr", "--v=0"
    )
    if not paper.exists():
        pytest.skip(f"{browser} prints no page here")
    return paper.read_bytes(), log


def _said(browser: str, page: Path, home: Path, *flags: str) -> tuple[str, str]:
    command = [browser, *FLAGS, *flags, f"--user-data-dir={home}", page.as_uri()]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, start_new_session=True
    ) as process:
        try:
            told, log = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            # Its helpers hold the pipe open, so the whole of its own group goes.
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            pytest.skip(f"{browser} showed no page within {PATIENCE_S} s")
    return told.decode(errors="replace"), log.decode(errors="replace")
