"""A browser without a window, which loads a page, tells what its scripts have made of it, and prints it on paper."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

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
LOOK = """
addEventListener("load", () => {
  const told = {};
  for (const frame of document.querySelectorAll("iframe")) {
    const page = frame.contentDocument, wide = frame.clientWidth;
    told[wide] = {
      wide: page.documentElement.scrollWidth,
      scripts: page.scripts.length
        + [...page.querySelectorAll("*")].filter(each => each.getAttributeNames().some(name => name.startsWith("on")))
          .length,
      broken: [...page.images].filter(each => !each.complete || !each.naturalWidth).length,
      fetched: frame.contentWindow.performance.getEntriesByType("resource")
        .filter(each => !each.name.startsWith("data:")).length,
      MORE
    };
  }
  const pre = document.createElement("pre");
  pre.id = "told";
  pre.textContent = JSON.stringify(told);
  document.body.append(pre);
});
"""
"""What is seen of each frame, by its width, once all are there: the browser's answer is the page after that event."""


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


def seen(folder: Path, pages: Iterable[tuple[tuple[int, int], str]], more: str = "") -> dict[int, dict[str, Any]]:
    """What a browser sees of pages, by the width of the window that each is shown in; skips where there is none.

    Args:
        folder: empty.
        pages: each with width and height of its window, which differ in width.
        more: properties of an object in JavaScript, of a ``page`` in a ``frame`` so ``wide``.
    """
    frames = "".join(
        f'<iframe style="border: 0; width: {wide}px; height: {high}px" srcdoc="{html.escape(page)}"></iframe>'
        for (wide, high), page in pages
    )
    look, file = LOOK.replace("MORE", more), folder / "page.html"
    file.write_text(f"<!DOCTYPE html><body>{frames}<script>{look}</script></body>", encoding="utf-8")
    found = re.search(r'<pre id="told">(.*?)</pre>', dumped(installed(), file, folder / "home"), re.DOTALL)
    assert found, "the page came to no end"
    return {int(wide): told for wide, told in json.loads(html.unescape(found[1])).items()}


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
