"""Browsers without a window, each started once: they open a page, tell what its scripts made of it, and picture it.

Chromium is led by its debugging pipe, Firefox by Marionette over a local socket; both speak JSON. A test asks for a
browser by the fixtures of ``conftest.py``, which skip where there is none.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import re
import select
import shutil
import socket
import subprocess
import sys
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Self
from urllib.parse import unquote

import pytest

PATIENCE_S = 60
Size = tuple[int, int]
DESK, TELEPHONE = (1280, 900), (390, 844)
READY = "return document.readyState === 'complete' && document.fonts.status === 'loaded'"
LOOK = """
const page = document, frame = { contentWindow: window }, wide = innerWidth;
return {
  wide: page.documentElement.scrollWidth,
  scripts: page.scripts.length
    + [...page.querySelectorAll("*")].filter(each => each.getAttributeNames().some(name => name.startsWith("on")))
      .length,
  broken: [...page.images].filter(each => !each.complete || !each.naturalWidth).length,
  fetched: performance.getEntriesByType("resource").filter(each => !each.name.startsWith("data:")).length,
  MORE
};
"""
"""What is seen of a page in its window."""


FAULTS = r"""
for (const each of document.querySelectorAll("details")) each.open = true;
for (const each of document.getAnimations()) each.finish();
const faults = new Set(), root = document.documentElement, wide = innerWidth;
const named = (each) => `<${[each.localName, each.id && `#${each.id}`, each.className].filter(Boolean).join(" ")}>`;
if (root.scrollWidth > wide) {
  for (const each of document.querySelectorAll("body *")) {
    let held = each.parentElement;
    while (held && !/auto|scroll|hidden|clip/.test(getComputedStyle(held).overflowX)) held = held.parentElement;
    const far = each.getBoundingClientRect().right > wide + 1 && (!held || held === document.body || held === root);
    if (far && each.parentElement.getBoundingClientRect().right <= wide + 1) {
      faults.add(`wider than the window: ${named(each)}`);
    }
  }
  if (!faults.size) faults.add(`the page scrolls sideways: ${root.scrollWidth} px`);
}
for (const each of document.images) {
  if (each.getAttribute("src") && (!each.complete || !each.naturalWidth)) faults.add(`no picture: ${each.alt}`);
}
const spelt = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
const known = new Map();
const numbers = (colour) => {
  if (!known.has(colour)) {
    spelt.clearRect(0, 0, 1, 1);
    spelt.fillStyle = colour;
    spelt.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = spelt.getImageData(0, 0, 1, 1).data;
    known.set(colour, [r, g, b, a / 255]);
  }
  return known.get(colour);
};
const over = ([r, g, b, a], below) => [r, g, b].map((each, n) => each * a + below[n] * (1 - a));
const behind = (each) => {
  if (!each) return numbers("Canvas");
  const style = getComputedStyle(each), own = numbers(style.backgroundColor);
  return own[3] === 1 ? own : over(own, behind(each.parentElement));
};
const opacity = (each) => each ? getComputedStyle(each).opacity * opacity(each.parentElement) : 1;
const light = (colour) => {
  const [r, g, b] = colour.map((each) => {
    const part = each / 255;
    return part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const judged = new Set(), walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const text = walker.currentNode.data.trim(), owner = walker.currentNode.parentElement;
  if (!text || owner.closest("script, style, noscript, template, svg")) continue;
  const style = getComputedStyle(owner), seen = opacity(owner);
  const kind = `${style.color} ${seen} ${named(owner)} ${named(owner.parentElement)}`;
  if (judged.has(kind) || !owner.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
  judged.add(kind);
  const [r, g, b, a] = numbers(style.color), below = behind(owner);
  const [one, other] = [light(over([r, g, b, a * seen], below)), light(below)];
  const ratio = (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
  if (ratio < 4.5) faults.add(`contrast ${ratio.toFixed(2)} of ${named(owner)} "${text.slice(0, 30)}"`);
}
for (const each of document.querySelectorAll(".bad, .good")) {
  const told = getComputedStyle(each, "::before").content.replace("none", "") + each.textContent;
  const row = each.closest("tr")?.textContent || "";
  if (!/[✓✗]|\p{L}/u.test(told) && !/[✓✗]/.test(row)) faults.add(`in colour alone: ${named(each)} "${told}"`);
}
for (const each of document.links) {
  const style = getComputedStyle(each), lined = style.textDecorationLine.includes("underline");
  if (each.textContent.trim() && !lined) faults.add(`a link in colour alone: ${named(each)}`);
}
const links = [...document.links].map((each) => each.getAttribute("href"));
return [[...faults], [...new Set(links)], judged.size];
"""
"""What is wrong with a page as it is shown, the addresses that it links to, and how many kinds of text were judged."""


class GoneError(Exception):
    """A page left while its script ran, or the browser itself."""


class Browser:
    """A running browser with one page."""

    names: tuple[str, ...]

    def __init__(self, program: str, home: Path) -> None:
        self._complaints: list[str] = []
        self.program, self.home = program, home
        home.mkdir()

    @classmethod
    def started(cls, folder: Path) -> Self:
        """One whose files lie in a folder; skips where none is installed, or it does not start."""
        program = next(filter(None, map(shutil.which, cls.names)), None)
        if program is None:
            pytest.skip(f"none of {', '.join(cls.names)} is installed")
        return cls(program, folder / cls.__name__)

    def open(self, page: str | Path, size: Size = DESK, *, dark: bool = False, paper: bool = False) -> None:
        """Load a page, a file or an address, in a window of that inner size, in pixels."""
        self._set("about:blank")
        self._complaints.clear()
        self.show_as(size, dark=dark, paper=paper)
        self._set(page.as_uri() if isinstance(page, Path) else page)
        self.until(READY)

    def until(self, script: str) -> Any:
        """The first true answer of a script that is asked again and again, from page to page."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            with suppress(GoneError):
                if answer := self.run(script):
                    return answer
            time.sleep(0.01)
        raise AssertionError(f"never true within {PATIENCE_S} s: {script}")

    def inside(self, expression: str) -> Any:
        """What an expression is worth to the page's own scripts, whose names no script from outside sees."""
        return self.run(f"""
            const script = document.createElement("script");
            script.textContent = `document.documentElement.dataset.told = JSON.stringify({expression})`;
            document.body.append(script);
            script.remove();
            return JSON.parse(document.documentElement.dataset.told);
        """)

    def seen(self, page: str | Path, size: Size = DESK, more: str = "", *, paper: bool = False) -> dict[str, Any]:
        """What is seen of a page, given as a file or as its text.

        Args:
            more: properties of an object in JavaScript, of a ``page`` in a ``frame`` so ``wide``.
        """
        if isinstance(page, str):
            file = self.home.with_suffix(".html")
            file.write_text(page, encoding="utf-8")
            page = file
        self.open(page, size, paper=paper)
        told: dict[str, Any] = self.run(LOOK.replace("MORE", more))
        return told

    def show_as(self, size: Size, *, dark: bool = False, paper: bool = False) -> None:
        """Size of the window, scheme, and whether the style of print is shown."""
        raise NotImplementedError

    def complaints(self) -> list[str]:
        """Errors of scripts, and addresses beyond files and data that were asked for, since a page was opened."""
        return list(self._complaints)

    def run(self, script: str) -> Any:
        """What a script in the page returns, as JSON has it; a promise is waited for.

        Raises:
            GoneError: the page was left meanwhile.
        """
        raise NotImplementedError

    def picture(self, *, whole: bool = False) -> bytes:
        """PNG of the window, or of the whole page."""
        raise NotImplementedError

    def close(self) -> None:
        """End it."""
        raise NotImplementedError

    def _set(self, address: str) -> None:
        raise NotImplementedError

    def _ended(self, why: str) -> None:
        self.close()
        pytest.skip(f"{self.program} {why}")


class Chromium(Browser):
    """Led by the DevTools protocol, whose messages end in a null byte."""

    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    _FLAGS = (
        "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
        "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--hide-scrollbars",
        "--proxy-server=127.0.0.1:9", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        "--remote-debugging-pipe",
    )  # fmt: skip

    def __init__(self, program: str, home: Path) -> None:
        super().__init__(program, home)
        self._asked, self._rest, self._session = 0, b"", ""
        self._told: list[dict[str, Any]] = []
        (theirs_in, self._out), (self._in, theirs_out) = os.pipe(), os.pipe()
        # It reads from 3 and writes to 4, which subprocess cannot hand over.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (theirs_in, theirs_out)]
        lead = "import os, sys; [os.dup2(int(sys.argv[n]), n + 2) for n in (1, 2)]; os.execv(sys.argv[3], sys.argv[3:])"
        command = [sys.executable, "-S", "-E", "-c", lead, *map(str, ends), program, *self._FLAGS]
        self._process = subprocess.Popen(
            [*command, f"--user-data-dir={home}", "about:blank"], pass_fds=ends, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        for end in (theirs_in, theirs_out, *ends):
            os.close(end)
        try:
            targets = self._ask("Target.getTargets")["targetInfos"]
            target = next(each["targetId"] for each in targets if each["type"] == "page")
            self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            for domain in ("Page", "Runtime", "Network", "Log"):
                self._ask(f"{domain}.enable")
        except (GoneError, OSError, StopIteration) as error:
            self._ended(f"does not start here: {error}")

    def show_as(self, size: Size, *, dark: bool = False, paper: bool = False) -> None:
        wide, high = size
        self._ask("Emulation.setDeviceMetricsOverride", width=wide, height=high, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._ask("Emulation.setEmulatedMedia", media="print" if paper else "", features=[scheme])

    def run(self, script: str) -> Any:
        told = self._ask(
            "Runtime.evaluate", expression=f"(async () => {{{script}}})()", returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in told:
            raise AssertionError(told["exceptionDetails"].get("exception", {}).get("description", told))
        return told["result"].get("value")

    def picture(self, *, whole: bool = False) -> bytes:
        told = self._ask("Page.captureScreenshot", format="png", captureBeyondViewport=whole, **self._clip(whole))
        return base64.b64decode(told["data"])

    def _clip(self, whole: bool) -> dict[str, Any]:
        if not whole:
            return {}
        wide, high = self.run("return [innerWidth, document.documentElement.scrollHeight]")
        return {"clip": {"x": 0, "y": 0, "width": wide, "height": high, "scale": 1}}

    def printed(self, page: Path) -> bytes:
        """A page on paper, as PDF."""
        self.open(page)
        return base64.b64decode(self._ask("Page.printToPDF", preferCSSPageSize=True, printBackground=False)["data"])

    def close(self) -> None:
        with suppress(GoneError, OSError):
            self._session = ""
            self._ask("Browser.close")
        for end in (self._in, self._out):
            os.close(end)
        _wait(self._process)

    def _set(self, address: str) -> None:
        self._ask("Page.navigate", url=address)
        while not any(told.get("method") == "Page.loadEventFired" for told in self._told):
            self._told.append(self._read())
        self._told.clear()

    def _ask(self, method: str, **given: Any) -> Any:
        self._asked += 1
        session = {"sessionId": self._session} if self._session else {}
        question = {"id": self._asked, "method": method, "params": given, **session}
        os.write(self._out, json.dumps(question).encode() + b"\0")
        while True:
            told = self._read()
            if told.get("id") == self._asked:
                if "error" in told:
                    raise GoneError(told["error"]["message"])
                return told["result"]
            self._told.append(told)

    def _read(self) -> dict[str, Any]:
        """The next message; what went wrong is remembered."""
        while b"\0" not in self._rest:
            if not select.select([self._in], [], [], PATIENCE_S)[0]:
                raise GoneError(f"no word within {PATIENCE_S} s")
            if not (more := os.read(self._in, 1 << 20)):
                raise GoneError("it ended")
            self._rest += more
        first, self._rest = self._rest.split(b"\0", 1)
        told: dict[str, Any] = json.loads(first)
        given, method = told.get("params", {}), told.get("method")
        if method == "Runtime.exceptionThrown":
            self._complaints.append(str(given["exceptionDetails"].get("exception", given).get("description")))
        elif method == "Log.entryAdded" and given["entry"]["level"] in ("error", "warning"):
            self._complaints.append(given["entry"]["text"])
        elif method == "Network.requestWillBeSent" and not _inert(given["request"]["url"]):
            self._complaints.append(given["request"]["url"])
        return told


class Firefox(Browser):
    """Led by Marionette: the length of a message, a colon, and its JSON."""

    names = ("firefox", "firefox-esr")
    _WATCH = """
        const told = [];
        Services.obs.addObserver({ observe(channel) {
          // What the browser asks for on its own is no page's.
          const own = channel.QueryInterface(Ci.nsIHttpChannel).loadInfo?.triggeringPrincipal.isSystemPrincipal;
          if (!own) told.push(channel.URI.spec);
        } }, "http-on-opening-request");
        window.maskfabAsked = told;
    """
    _COMPLAINTS = """
        const said = Services.console.getMessageArray().filter(each => each instanceof Ci.nsIScriptError
          && !(each.flags & each.warningFlag) && /^(file|data|blob):/.test(each.sourceName));
        return said.map(each => each.errorMessage).concat(window.maskfabAsked);
    """
    _SHOW = """
        const page = gBrowser.selectedBrowser, [wide, high, dark, paper] = arguments;
        for (const [name, length] of [["width", wide], ["height", high]]) {
          for (const each of [name, `min-${name}`, `max-${name}`]) page.style.setProperty(each, `${length}px`);
        }
        Services.prefs.setIntPref("layout.css.prefers-color-scheme.content-override", dark ? 0 : 1);
        page.browsingContext.mediumOverride = paper ? "print" : "";
    """

    def __init__(self, program: str, home: Path) -> None:
        super().__init__(program, home)
        # Nothing is asked of a network: what a page asked for would be told all the same.
        settings = {
            "network.proxy.type": 1, "network.proxy.http": "127.0.0.1", "network.proxy.http_port": 9,
            "network.proxy.ssl": "127.0.0.1", "network.proxy.ssl_port": 9, "marionette.port": 0,
            "browser.startup.page": 0, "browser.shell.checkDefaultBrowser": False, "app.update.enabled": False,
            "fission.autostart": False, "dom.ipc.processPrelaunch.enabled": False, "ui.useOverlayScrollbars": 1,
        }  # fmt: skip
        lines = (f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in settings.items())
        (home / "user.js").write_text("".join(lines))
        self._asked, self._rest = 0, b""
        self._shown: tuple[Any, ...] = (*DESK, False, False)
        self._process = subprocess.Popen(
            [program, "--headless", "--marionette", "--remote-allow-system-access", "--profile", str(home)],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
            env={**os.environ, "HOME": str(home), "MOZ_CRASHREPORTER_DISABLE": "1"},
        )  # fmt: skip
        self._line: socket.socket | None = None
        try:
            self._line = socket.create_connection(("127.0.0.1", self._port()), timeout=PATIENCE_S)
            self._read()
            self._ask("WebDriver:NewSession", capabilities={"alwaysMatch": {"pageLoadStrategy": "normal"}})
            self._chrome(self._WATCH)
        except (GoneError, OSError) as error:
            self._ended(f"does not start here: {error}")

    def show_as(self, size: Size, *, dark: bool = False, paper: bool = False) -> None:
        self._shown = *size, dark, paper
        self._chrome(self._SHOW, *self._shown)
        self.until(f"return innerWidth === {size[0]} && innerHeight === {size[1]}")

    def run(self, script: str) -> Any:
        return self._ask("WebDriver:ExecuteScript", script=script, args=[], sandbox=None)["value"]

    def complaints(self) -> list[str]:
        told: list[str] = self._chrome(self._COMPLAINTS)
        return told

    def picture(self, *, whole: bool = False) -> bytes:
        return base64.b64decode(self._ask("WebDriver:TakeScreenshot", full=whole, hash=False)["value"])

    def close(self) -> None:
        with suppress(GoneError, OSError):
            if self._line is not None:
                self._ask("Marionette:Quit", flags=["eForceQuit"])
                self._line.close()
        _wait(self._process)

    def _set(self, address: str) -> None:
        self._chrome("Services.console.reset(); window.maskfabAsked.length = 0")
        self._ask("WebDriver:Navigate", url=address)
        self._chrome(self._SHOW, *self._shown)  # of a page from elsewhere the context is another

    def _port(self) -> int:
        told, end = self.home / "MarionetteActivePort", time.monotonic() + PATIENCE_S
        while time.monotonic() < end and self._process.poll() is None:
            with suppress(OSError, ValueError):
                return int(told.read_text())
            time.sleep(0.05)
        raise GoneError("it opened no port")

    def _chrome(self, script: str, *given: Any) -> Any:
        """What a script of the browser's own returns."""
        self._ask("Marionette:SetContext", value="chrome")
        try:
            return self._ask("WebDriver:ExecuteScript", script=script, args=given, sandbox=None)["value"]
        finally:
            self._ask("Marionette:SetContext", value="content")

    def _ask(self, method: str, **given: Any) -> Any:
        assert self._line is not None
        self._asked += 1
        question = json.dumps([0, self._asked, method, given]).encode()
        self._line.sendall(str(len(question)).encode() + b":" + question)
        _, number, wrong, answer = self._read()
        assert number == self._asked
        if wrong is not None:
            raise (AssertionError if wrong["error"] == "javascript error" else GoneError)(wrong["message"])
        return answer

    def _read(self) -> Any:
        assert self._line is not None
        while b":" not in self._rest:
            self._more()
        length, self._rest = self._rest.split(b":", 1)
        while len(self._rest) < int(length):
            self._more()
        told, self._rest = self._rest[: int(length)], self._rest[int(length) :]
        return json.loads(told)

    def _more(self) -> None:
        assert self._line is not None
        if not (more := self._line.recv(1 << 20)):
            raise GoneError("it ended")
        self._rest += more


DRAWN = "return new Promise((tell) => requestAnimationFrame(() => requestAnimationFrame(tell)))"
SHOWN = tuple((size, dark) for size in (DESK, TELEPHONE) for dark in (False, True))
"""Window and scheme in which pages are tried."""


def faults(browser: Browser, page: Path) -> list[str]:
    """What is wrong with a page on a desk and on a telephone, in light and in dark, and with what it links to.

    It must not scroll sideways, every text has a contrast of 4.5 or more (WCAG 2.2, 1.4.3), no verdict and no link is
    told by colour alone (1.4.1), every picture is there, every link within it and to files beside it leads somewhere,
    no script fails, and nothing is asked of a network.
    """
    found: dict[str, list[str]] = {}
    browser.open(page)
    for size, dark in SHOWN:
        browser.show_as(size, dark=dark)
        browser.run(DRAWN)  # lest a script of the page has yet to follow the scheme
        wrong, links, judged = browser.run(FAULTS)
        assert judged > 3, "a page without words"
        wrong += [f"leads nowhere: {link}" for link in links if not _leads(page, link)]
        for each in wrong:
            found.setdefault(each, []).append(f"{size[0]}{' dark' if dark else ''}")
    return [f"{each} ({', '.join(where)})" for each, where in found.items()] + browser.complaints()


def _leads(page: Path, link: str) -> bool:
    """Whether an address from a page is from elsewhere, or a file that is there, with the place that is meant."""
    if re.match(r"\w+:", link):
        return True
    name, _, place = link.partition("#")
    file = page.parent / unquote(name) if name else page
    if not file.is_file():
        return False
    # The page of a plate reads its places by itself.
    return not place or "=" in place or f'id="{unquote(place)}"' in _text(file)


@cache
def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def _inert(address: str) -> bool:
    return address.startswith(("file:", "data:", "blob:", "about:"))


def _wait(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
