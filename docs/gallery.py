"""Pictures of the gallery, each made by the command that stands under it: ``python docs/gallery.py [NAME...]``."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

_DOCS = Path(__file__).parent
FOLDER = _DOCS / "gallery"


@dataclass(frozen=True)
class Entry:
    """A picture and what makes it.

    Attributes:
        name: of the picture, NAME.png.
        title: in a few words.
        look: one sentence on what to look for.
        python: lines that write the picture; or
        sh: commands that do.
        cheap: made in a second or so.
        browser: a page that Chromium photographs.
    """

    name: str
    title: str
    look: str
    python: str = ""
    sh: str = ""
    cheap: bool = False
    browser: bool = False

    @property
    def shown(self) -> str:
        """The lines as the page shows them."""
        return f"```{'python' if self.python else 'sh'}\n{(self.python or self.sh).strip()}\n```"

    @property
    def picture(self) -> str:
        """The picture in the page."""
        return f"![{self.title}](gallery/{self.name}.png)"

    def make(self, place: Path) -> Path:
        """Run the lines in an empty folder in which only ``layouts`` lies.

        Returns:
            The picture.

        Raises:
            subprocess.CalledProcessError: for lines that fail.
            FileNotFoundError: for lines that leave no picture of the name.
        """
        (place / "layouts").symlink_to(_DOCS.parent / "layouts")
        lines = [sys.executable, "-c", self.python] if self.python else ["bash", "-ec", self.sh]
        subprocess.run(lines, cwd=place, check=True, env=_environment(place))
        picture = place / f"{self.name}.png"
        if not picture.exists():
            raise FileNotFoundError(picture)
        return picture


def entries() -> list[Entry]:
    """All of the gallery in its order."""
    return [Entry(**entry) for entry in tomllib.loads((FOLDER / "entries.toml").read_text("utf-8"))["entry"]]


def _environment(place: Path) -> dict[str, str]:
    """``maskfab`` as this interpreter has it first on the path; figures without a screen, Chromium in no sandbox."""
    tools = place / ".tools"
    tools.mkdir()
    programs = {"maskfab": f'exec "{sys.executable}" -m maskfab "$@"'}
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser:
        # A page that draws itself is photographed once it has, however busy the machine.
        flags = "--no-sandbox --disable-gpu --hide-scrollbars --virtual-time-budget=5000"
        programs["chromium"] = f'exec "{browser}" {flags} "$@"'
    for name, line in programs.items():
        (tools / name).write_text(f"#!/bin/sh\n{line}\n")
        (tools / name).chmod(0o755)
    root = str(_DOCS.parent)
    return os.environ | {"PATH": f"{tools}:{os.environ['PATH']}", "MPLBACKEND": "agg", "PYTHONPATH": root}


def on_page_markdown(markdown: str, **_: object) -> str:
    """Put the pictures in the place of their mark."""
    shown = "\n".join(f"## {one.title}\n\n{one.look}\n\n{one.picture}\n\n{one.shown}\n" for one in entries())
    return markdown.replace("<!-- pictures of gallery/entries.toml -->", shown)


def light(picture: Path) -> bytes:
    """The picture in 256 colours where it has more, on white: about a fifth of the bytes."""
    import numpy as np
    from matplotlib.image import imread

    from maskfab.report.figures.sheet import few_colours, png

    shown = np.asarray(imread(picture))[::-1]
    if shown.ndim == 3 and shown.shape[2] == 4:
        shown = shown[..., :3] * shown[..., 3:] + (1 - shown[..., 3:])
    if shown.ndim == 2:
        return picture.read_bytes()
    reduced = png(*few_colours((255 * shown).round().astype(np.uint8)))
    return min(reduced, picture.read_bytes(), key=len)


if __name__ == "__main__":
    asked = sys.argv[1:]
    for entry in entries():
        if not asked or entry.name in asked:
            with TemporaryDirectory() as folder:
                (FOLDER / f"{entry.name}.png").write_bytes(light(entry.make(Path(folder))))
            print(entry.name, flush=True)
