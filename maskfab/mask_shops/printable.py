"""Text for papers: a house's profile and a job's names are somebody else's."""

from __future__ import annotations


def printable(text: str) -> str:
    """The text with a space for each character that a printer or a terminal would obey.

    No font has them, XML forbids them, and drawings as PDF fail over them.
    """
    return "".join(letter if letter.isprintable() else " " for letter in text)
