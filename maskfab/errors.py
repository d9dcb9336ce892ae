"""The exception tree, its stable codes, and the exit code of each branch.

    MaskfabError
     ├─ InputError          exit 2: the user can mend it
     │   ├─ JobError        MF1xx  the job file
     │   ├─ OpeningError    MF2xx  an opening
     │   ├─ SourceError     MF3xx  a file that is read
     │   └─ OutputError     MF4xx  the place results go to
     └─ InternalError       MF9xx  exit 3: our own fault

Every error says what is wrong, the value with its unit, the limit, where it stands, and the cure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

CATALOGUE: Mapping[str, str] = MappingProxyType(
    {
        "MF101": "A job or opening file is not valid TOML.",
        "MF102": "A job or opening file has a key that maskfab does not know.",
        "MF103": "A quantity has no unit, or a unit of the wrong kind.",
        "MF104": "A length, wavelength or ratio is zero, negative, NaN, infinite or out of its range.",
        "MF105": "A key is missing or has a value of the wrong type.",
        "MF106": "dots x dot + gutter differs from the stated pitch.",
        "MF107": "A length does not lie on the database grid of 1 nm.",
        "MF108": "A die or a panel is larger than the room it has.",
        "MF109": "Two dies, or two different openings, maps or tables of curves, have one name.",
        "MF110": "A name would be refused by mask houses.",
        "MF111": "A random tiling needs a seed.",
        "MF112": "A wavelength is outside 200 to 2000 nm.",
        "MF113": "The PSF window is wider than its alias-free range.",
        "MF114": "The lens stop is larger than the panel in front of it.",
        "MF115": "The request needs more memory or time than one job may take.",
        "MF116": "The emitters' ratio is not three positive numbers.",
        "MF117": "A gap, a width or a gutter is wider than the pixel or its closed area.",
        "MF118": "The rules of emitters are whole numbers only on a grid that is too fine.",
        "MF119": "Emitters given by hand overlap, leave the pixel, or break a gap.",
        "MF120": "Wires were asked for that cannot be drawn.",
        "MF121": "A picture cannot be shown on this display, or seen from this distance.",
        "MF122": "A tiling needs something that the job does not give.",
        "MF123": "What a design must keep contradicts itself, or nothing that keeps it was found.",
        "MF124": "A plate template cannot be used as it is.",
        "MF125": "There is no plate template of that name.",
        "MF126": "A plate's template and the job contradict each other, or marks and dies would overlap.",
        "MF127": "A writing process rounds or moves edges by more than the dots or the gutter bear.",
        "MF131": "The lens stop is wider than any lens of that focal length.",
        "MF132": "A lens stop's outline crosses itself, or holds no area.",
        "MF133": "A verb does not know lens stops of that shape.",
        "MF201": "The rows of an opening's grid differ in length or number.",
        "MF202": "An opening has values other than clear and opaque.",
        "MF203": "An opening is closed everywhere.",
        "MF204": "The open ratio cannot be reached on this dot grid.",
        "MF205": "A polygon of an imported opening does not lie on the dot grid.",
        "MF206": "An opening's stated facts contradict its grid.",
        "MF301": "A file is missing.",
        "MF302": "A file is empty.",
        "MF303": "A file is truncated or damaged.",
        "MF304": "A file is not what its suffix says.",
        "MF305": "A layout has more than one top cell.",
        "MF306": "A layout has no such layer.",
        "MF307": "A layout has no such cell.",
        "MF308": "maskfab does not read files of this kind.",
        "MF309": "There is no geometry where the analysis looks for it.",
        "MF310": "A drawing has open lines or fills, which are no polygons.",
        "MF311": "A drawing has arcs, splines or bulges.",
        "MF312": "A polygon crosses or covers itself.",
        "MF313": "A file has more shapes, levels or pixels than can be worked with.",
        "MF314": "The size of an image's pixels is not known.",
        "MF315": "A Gerber file has a command that maskfab does not read.",
        "MF316": "Reading a file takes too long, or its readers disagree.",
        "MF317": "A drawing has shapes that not every program shows, or shows where they are.",
        "MF318": "A picture does not say which of its values is white.",
        "MF322": "Working with a file takes more time or memory than a file like it may.",
        "MF323": "A library of polygons gives up on a file.",
        "MF401": "The output directory cannot be written.",
        "MF402": "The output directory is not empty.",
        "MF403": "The directory is not one that maskfab finished.",
        "MF404": "The place for a result changed while the work was done.",
        "MF405": "A result that was replaced was changed at that moment.",
        "MF410": "A cell has no chrome to make a solid of.",
        "MF411": "An STL would be larger than its limit.",
        "MF412": "A die has more cells or vertices than its format of solids bears.",
        "MF413": "Polygons cannot be drawn in the way that was asked for.",
        "MF414": "A layer's name cannot stand in this format, or two layers share one.",
        "MF415": "A file would be larger than it may be.",
        "MF416": "A die needs more references than it may have.",
        "MF417": "A design rule is not one that can be checked.",
        "MF418": "A layout has more shapes than design rules are checked on.",
        "MF420": "There is no shop profile of that name, or at that path.",
        "MF421": "A shop profile is malformed.",
        "MF422": "A file is no package that maskfab made.",
        "MF423": "A package is unsafe to unpack.",
        "MF901": "maskfab failed; this is our fault.",
    }
)

_LONGEST = 4000
"""Characters of each part of an error."""


class MaskfabError(Exception):
    """Root of every error that maskfab raises on purpose.

    Args:
        code: a key of :data:`CATALOGUE`.
        what: what is wrong, with the value and its unit and the limit it breaks.
        where: file and key (``layouts/x.toml: camera.focal``), or empty.
        cure: what to do about it.
    """

    exit_code = 3

    def __init__(self, code: str, what: str, *, where: str = "", cure: str = "") -> None:
        what, where, cure = (_clipped(text) for text in (what, where, cure))
        self.code = code
        self.summary = CATALOGUE[code]
        self.what = what
        self.where = where
        self.cure = cure
        place = f" ({where})" if where else ""
        remedy = f" {cure}" if cure else ""
        super().__init__(f"{code} {what}{place}.{remedy}")

    def __reduce__(self) -> tuple[Callable[..., MaskfabError], tuple[str, str]]:
        """Errors of a process of its own come here whole."""
        return partial(type(self), where=self.where, cure=self.cure), (self.code, self.what)


def _clipped(text: str) -> str:
    """What a person can read of a text into which a damaged file may have put anything."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} [...] {text[-_LONGEST // 2 :]}"


class InputError(MaskfabError):
    """The user's input is at fault; nothing was written."""

    exit_code = 2


class JobError(InputError):
    """The job file asks for something that cannot be made."""


class OpeningError(InputError):
    """An opening is malformed."""


class SourceError(InputError):
    """A file that was to be read is missing, damaged or of another kind."""


class OutputError(InputError):
    """Results cannot be put where the user wants them."""


class InternalError(MaskfabError):
    """An invariant of maskfab itself was broken."""
