"""Pictures of PSFs, taken from the page of a report."""

from __future__ import annotations

from html.parser import HTMLParser

_SECTION = "die-"
_WORDS = "PSF at "
_INERT = ("data:image/svg+xml,", "data:image/png;base64,", "data:image/webp;base64,")


def psf_pictures(page: str) -> dict[str, tuple[str, str]]:
    """Address and words of the first PSF of every die's section, by the die's name.

    Only pictures that lie in the page itself are taken.
    """
    reader = _Reader()
    reader.feed(page)
    return reader.found


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, tuple[str, str]] = {}
        self._die: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = dict(attrs)
        if tag == "section":
            name = told.get("id") or ""
            self._die = name.removeprefix(_SECTION) if name.startswith(_SECTION) else None
        elif tag == "img" and self._die is not None and self._die not in self.found:
            words, address = told.get("alt") or "", told.get("src") or ""
            if words.startswith(_WORDS) and address.startswith(_INERT):
                self.found[self._die] = address, words
