"""The built manual as a reader meets it: opened from its files in both browsers, without a network."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from browser import DESK, DRAWN, FAULTS, TELEPHONE, Browser, faults

import maskfab as mf

pytestmark = pytest.mark.slow
ROOT = Path(mf.__file__).parents[1]
NAVIGATION = ("<a md-", "<a headerlink>")
"""Where every word is a link, and the sign of a heading's own link, which is no word."""
CUT = """
return [...document.querySelectorAll("pre > code, .output")]
  .filter((each) => each.scrollWidth > each.clientWidth)
  .filter((each) => innerWidth >= 1280 || getComputedStyle(each).overflowX !== "auto")
  .map((each) => `${each.scrollWidth - each.clientWidth} px cut: ${each.textContent.trim().slice(0, 40)}`);
"""
"""Code and answers that are not seen whole: on a desk at once, on a telephone by moving them in their own box."""


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The manual as ``make docs`` builds it, its notebooks executed."""
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("manual") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    subprocess.run(command, cwd=ROOT, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, check=True)
    return folder


@pytest.fixture(scope="module")
def pages(site) -> list[Path]:
    """All but the one that a server shows for a page that is not there."""
    found = sorted(page for page in site.rglob("*.html") if page.name != "404.html")
    assert len(found) > 30
    return found


def read(wrong: list[str]) -> list[str]:
    """Faults that hold for a manual."""
    return [each for each in wrong if not each.startswith(tuple(f"a link in colour alone: {of}" for of in NAVIGATION))]


def wrong_with(browser: Browser, page: Path) -> list[str]:
    wrong = read(faults(browser, page))
    for size in (DESK, TELEPHONE):
        browser.show_as(size)
        wrong += browser.run(CUT)
    return wrong


def test_every_page_opens_anywhere(browser, pages, site):
    told = {str(page.relative_to(site)): wrong_with(browser, page) for page in pages}
    assert {name: wrong for name, wrong in told.items() if wrong} == {}


@pytest.mark.parametrize("size", [DESK, TELEPHONE], ids=["desk", "telephone"])
def test_search_answers_from_files(browser, site, size):
    browser.open(site / "how-to/run.html", size)
    browser.run("""
      const asked = document.querySelector("[data-md-component=search-query]");
      document.querySelector("#__search").click();
      asked.focus();
      asked.value = "gutter";
      for (const kind of ["input", "keyup"]) asked.dispatchEvent(new Event(kind, { bubbles: true }));
    """)
    found = browser.until("return [...document.querySelectorAll('.md-search-result__link')].map((each) => each.href)")
    assert len(found) > 3
    assert all(Path(unquote(urlsplit(address).path)).is_file() for address in found)
    assert {urlsplit(address).scheme for address in found} == {"file"}
    assert read(browser.run(FAULTS)[0]) == []
    browser.open(found[-1], size)
    assert browser.until("return document.querySelectorAll('mark[data-md-highlight]').length")
    assert read(browser.run(FAULTS)[0]) == []
    assert browser.complaints() == []


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_reader_chooses_the_scheme(browser, site, dark):
    browser.open(site / "tutorial/python.html", dark=dark)
    for number, scheme in enumerate(("slate" if dark else "default", "default", "slate")):
        browser.run(f"document.querySelector('#__palette_{number}').click()")
        browser.run(DRAWN)
        assert browser.run("return document.body.dataset.mdColorScheme") == scheme
        assert read(browser.run(FAULTS)[0]) == []
