"""The exception tree, its stable codes, and the exit code of each branch.

    MaskfabError
     ├─ InputError          exit 2: the user can correct it
     │   ├─ JobError        MF1xx  the job file
     │   │   ├─ MissingPackageError  MF152  a package of an extra that is not installed
     │   │   └─ ManyFaultsError  MF153  several faults of one input; ``faults`` has each as an error of its own
     │   ├─ OpeningError    MF2xx  an opening
     │   ├─ SourceError     MF3xx  a file that is read
     │   ├─ OutputError     MF4xx  the place results go to
     │   └─ UnknownNameError  MF432  a name that results are looked up by; a KeyError too
     └─ InternalError       MF9xx  exit 3: a fault of maskfab

Every error says what is wrong, the value with its unit, the limit, where it stands, and the cure. A refusal is written
so that code, place and cure stand on one line, and long texts have names:

    if width < line:
        what = f"a stop of {width:g} um is narrower than the wavelength of {line:g} um"
        raise JobError("MF104", what, where=where, cure='Give the diameter of the lens, such as "4 mm"')

"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from errno import ENOMEM
from functools import partial
from types import MappingProxyType, TracebackType
from typing import Self

CATALOGUE: Mapping[str, str] = MappingProxyType(
    {
        "MF101": "A job or opening file is not valid TOML.",
        "MF102": "A job or opening file has a key that maskfab does not know.",
        "MF103": "A quantity has no unit, or a unit of the wrong kind.",
        "MF104": "A length, wavelength or ratio is zero, negative, NaN, infinite or out of its range.",
        "MF105": "A key is missing or has a value of the wrong type.",
        "MF106": "dots x dot + gutter differs from the stated pitch.",
        "MF107": "A length does not lie on the grid of the data, 1 nm unless export.grid says otherwise.",
        "MF108": "A die, a panel or a mark is larger than the space available.",
        "MF109": "Two dies, or two different openings, maps or tables of curves, have one name.",
        "MF110": "Mask shops would refuse a name, or the plate's font lacks a character.",
        "MF111": "A random tiling needs a seed.",
        "MF112": "A wavelength is outside 200 to 2000 nm.",
        "MF113": "The PSF window is wider than its alias-free range.",
        "MF114": "The lens stop is larger than the panel in front of it.",
        "MF115": "The request needs more memory or time than one job may take.",
        "MF116": "The emitters' ratio is not three positive numbers.",
        "MF117": "A gap, a width or a gutter is wider than the pixel or its closed area.",
        "MF118": "The emitter rules share only a grid that is too fine to compute on.",
        "MF119": "Emitters drawn by hand lie over an opening, lack a colour, or do not fit the dots.",
        "MF120": "The wires requested cannot be drawn.",
        "MF121": "A picture cannot be shown on this display, or viewed from this distance.",
        "MF122": "A tiling does not match the map, openings or seeds that the job gives.",
        "MF123": "The design rules contradict each other, or no opening that meets them was found.",
        "MF124": "A plate template cannot be used as it is.",
        "MF125": "No plate template has that name.",
        "MF126": "A plate's template and the job contradict each other, or marks and dies would overlap.",
        "MF127": "A writing process rounds or moves edges by more than the dots or the gutter allow.",
        "MF128": "An order contradicts the plate, or asks for what the job does not state.",
        "MF131": "The lens stop is wider than any lens of that focal length.",
        "MF132": "A lens stop's outline crosses itself, or holds no area.",
        "MF133": "A command does not support lens stops of that shape.",
        "MF134": "Photographs need a camera of three wavelengths.",
        "MF135": "The dots are too coarse or too fine for photographs with this camera.",
        "MF140": "A sensor's numbers contradict each other, or its mosaic does not fill the picture.",
        "MF141": "A light level has no light, or white overflows the sensor's full well.",
        "MF142": "Photographs are so large that restoring them takes more memory than maskfab allows itself.",
        "MF143": "Brackets cannot be taken: of a scene without light above white, or with more light than the level's.",
        "MF145": "A claim of a study is about something that the study does not have.",
        "MF146": "A study shows nothing, or has no scenes.",
        "MF147": "Masks that are to take the place of openings have another size, or no opening's name.",
        "MF148": "A learned restorer was trained for another die, camera, sensor or light.",
        "MF150": "A budget is shorter than the least work that is useful.",
        "MF151": "Answers about a display contradict each other.",
        "MF152": "A package that this needs is not installed.",
        "MF153": "A job has several faults; each is told with its own code, place and cure.",
        "MF154": "A job is written for a later version of maskfab.",
        "MF156": "A length or wavelength makes no sense in its unit.",
        "MF157": "The work was ended from outside before it was done.",
        "MF159": "Dots that a gradient is asked of are no tensor of openings, or the panel has no place for them.",
        "MF160": "A sweep's field does not state its values once, or a sweep has no case, or too many.",
        "MF161": "A sweep asks for a quantity that no case has.",
        "MF162": "Two cases of a sweep are one and the same.",
        "MF163": "A number of a case is not finite.",
        "MF164": "A scheduler does not answer, or its workers run another version of maskfab.",
        "MF185": "The ISO speed that a file says it was taken at contradicts the sensor of the job.",
        "MF201": "The rows of an opening's grid differ in length or number.",
        "MF202": "An opening has values other than clear and opaque.",
        "MF203": "An opening has no clear dot.",
        "MF204": "The open ratio cannot be reached on this dot grid.",
        "MF205": "A polygon of an imported opening does not lie on the dot grid.",
        "MF206": "An opening's stated facts contradict its grid.",
        "MF207": "A picture of a display shows no lattice of rows and columns.",
        "MF208": "Fewer than two by two periods of a display are in a picture.",
        "MF209": "A picture of a display is too blurred, or too coarse, for its edges.",
        "MF210": "A picture of a display is clipped.",
        "MF211": "The square cell of a display, or the pixels in it, cannot be told from a picture.",
        "MF301": "A file is missing.",
        "MF302": "A file is empty.",
        "MF303": "A file is truncated or damaged.",
        "MF304": "A file's content does not match its suffix, or is not text.",
        "MF305": "A layout has more than one top cell.",
        "MF306": "A layout has no such layer.",
        "MF307": "A layout has no such cell.",
        "MF308": "maskfab does not read files of this kind.",
        "MF309": "There is no geometry in the place that is analysed.",
        "MF310": "A drawing has open lines or fills instead of closed polygons.",
        "MF311": "A drawing has arcs, splines or bulges.",
        "MF312": "A polygon crosses or covers itself.",
        "MF313": "A file has more shapes, levels, layers or pixels than the limit, or is too large in size.",
        "MF314": "The pixel size of an image is unknown.",
        "MF315": "A Gerber or CIF file has a command that maskfab does not read.",
        "MF316": "Reading a file takes too long, or two readers disagree about it.",
        "MF317": "A drawing has shapes that some programs hide or place differently.",
        "MF318": "A picture does not state its tone (which value is white).",
        "MF322": "Processing a file takes more time or memory than the limit for its size.",
        "MF323": "The polygon library fails on a file.",
        "MF324": "A mask file that was just written cannot be read back, or shows nothing of a die.",
        "MF325": "The system refuses memory that the work needs.",
        "MF326": "The shapes of a file cover one place too many times over.",
        "MF327": "The process that reads a file gives an answer that cannot be used.",
        "MF329": "Page, table and report.json of a run do not tell the same numbers.",
        "MF330": "A capture is not linear: it holds 8 bits, code values of a display, or is compressed with loss.",
        "MF331": "Captures of one stack differ in their size, mosaic, camera or sensitivity.",
        "MF332": "Exposure times are missing, all equal, or contradict the light of the captures.",
        "MF333": "The black and white levels of a capture contradict each other or its counts.",
        "MF334": "Captures hold no light that can be measured: all is full, or dark.",
        "MF335": "The gain of a sensor cannot be told from these captures.",
        "MF336": "Captures that are to be merged do not show the same light.",
        "MF337": "A crop does not lie in the capture.",
        "MF338": "Captures of a point light show a second one.",
        "MF339": "A captured light is like none of the dies that it may have come through.",
        "MF340": "No straight edge between two even fields was found in a picture.",
        "MF341": "An edge stands at an angle at which pixels meet it in too few places.",
        "MF342": "Too little of an edge is in the picture.",
        "MF343": "Values about an edge are clipped.",
        "MF351": "A point spread function is wider than the photograph that it is to restore.",
        "MF352": "A point spread function, or a job, is of another pixel than the photographs.",
        "MF353": "A photograph or a point spread function has a number of colours, or of files, that does not fit.",
        "MF354": "Photographs that are to be compared do not show one scene.",
        "MF355": "The patches of a colour chart cannot tell a camera's colours.",
        "MF356": "The patches of a colour chart lie in another order than its table states.",
        "MF367": "Processes that worked at a task were killed from outside, one after the other.",
        "MF401": "The output directory cannot be written.",
        "MF402": "The output directory is not empty.",
        "MF403": "The directory is not the result of a finished maskfab run.",
        "MF404": "The output place was changed by another program during the run.",
        "MF405": "The old result was changed by another program while it was replaced.",
        "MF406": "A package would take the place of another revision, or of other contents of its own.",
        "MF407": "A file of a finished run was edited, is damaged, or is of another version.",
        "MF409": "A finished run has no mask file whose polygons can be shown.",
        "MF410": "A cell has no chrome, so there is no solid to write.",
        "MF411": "An STL would be larger than its limit.",
        "MF412": "A die has more cells or vertices than this solid format supports.",
        "MF413": "Polygons cannot be drawn with these options.",
        "MF414": "A layer name is invalid in this format, or used twice.",
        "MF415": "A file would exceed its size limit.",
        "MF416": "A die needs more cell references than the shop allows.",
        "MF417": "A design rule is not valid.",
        "MF420": "No shop profile has that name or path.",
        "MF421": "A shop profile is malformed.",
        "MF422": "A file is not a package made by maskfab.",
        "MF423": "A package is unsafe to unpack.",
        "MF430": "maskfab does not write files of this kind.",
        "MF432": "The results have no number or die of that name.",
        "MF436": "Corners that touch cannot have so wide or narrow a gap or neck in a mesh.",
        "MF437": "Two corners of a mesh become one in a format's float32.",
        "MF438": "No program that prints a page is installed.",
        "MF439": "The browser did not print the report.",
        "MF901": "maskfab failed: an internal error, not your input.",
    }
)

_LACK_OF_MEMORY = ("bad_alloc", "failed to map segment", "Cannot allocate memory")
"""Words of C++, of the loader of libraries and of the C library."""

_LONGEST = 4000
"""Characters of each part of an error."""


class MaskfabError(Exception):
    """Root of every error that maskfab raises on purpose.

    Args:
        code: a key of :data:`CATALOGUE`.
        what: what is wrong, with the value and its unit and the limit it breaks.
        where: file and key (``layouts/x.toml: camera.focal``), or empty.
    """

    exit_code = 3

    def __init__(self, code: str, what: str, *, where: str = "", cure: str = "") -> None:
        what, where, cure = (
            text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} [...] {text[-_LONGEST // 2 :]}"
            for text in (what, where, cure)
        )
        self.code = code
        self.summary = CATALOGUE[code]
        self.what = what
        self.where = where
        self.cure = cure
        place = f" ({where})" if where else ""
        remedy = f" {cure}" if cure else ""
        super().__init__(f"{code} {what}{place}.{remedy}")

    @property
    def faults(self) -> tuple[MaskfabError, ...]:
        """All that is wrong, each as an error of its own; of most errors the error itself."""
        return (self,)

    def reword(self, word: Callable[[str], str]) -> None:
        """Put what it says in the words of another caller; an error keeps its traceback."""
        MaskfabError.__init__(self, self.code, word(self.what), where=word(self.where), cure=word(self.cure))

    def to_dict(self) -> dict[str, object]:
        """Plain data: code, what, where and cure, and those of every fault."""
        facts = [{"code": e.code, "what": e.what, "where": e.where, "cure": e.cure} for e in (self, *self.faults)]
        return {**facts[0], "faults": facts[1:]}

    def __reduce__(self) -> tuple[Callable[..., MaskfabError], tuple[object, ...]]:
        return partial(type(self), where=self.where, cure=self.cure), (self.code, self.what)


def is_lack_of_memory(error: BaseException) -> bool:
    """Whether an exception says that the system refuses memory, in the words of whichever library asked for it."""
    return (
        isinstance(error, MemoryError)
        or (isinstance(error, OSError) and error.errno == ENOMEM)
        or any(words in str(error) for words in _LACK_OF_MEMORY)
    )


class InputError(MaskfabError):
    """The user's input is at fault; nothing was written."""

    exit_code = 2


class JobError(InputError):
    """The job file asks for something that cannot be made."""


class MissingPackageError(JobError):
    """Work is asked for that needs a package which is not installed."""


class ManyFaultsError(JobError):
    """Several faults of one input, told at once.

    Args:
        faults: two or more, in the order in which they are told.
    """

    def __init__(self, faults: Sequence[MaskfabError]) -> None:
        places = {fault.where.partition(": ")[0] for fault in faults}
        where = places.pop() if len(places) == 1 else ""
        super().__init__("MF153", f"{len(faults)} faults", where=where, cure="Write what each of them says")
        self._faults = tuple(faults)
        self.args = ("\n".join([str(self), *(f"  {fault}" for fault in faults)]),)

    def reword(self, word: Callable[[str], str]) -> None:
        """Put every fault in the words of another caller."""
        for fault in self._faults:
            fault.reword(word)
        ManyFaultsError.__init__(self, self._faults)

    @property
    def faults(self) -> tuple[MaskfabError, ...]:
        """The faults, one or more lines of the message each."""
        return self._faults

    def __reduce__(self) -> tuple[Callable[..., MaskfabError], tuple[object, ...]]:
        return type(self), (self._faults,)


class OpeningError(InputError):
    """An opening is malformed."""


class SourceError(InputError):
    """A file that was to be read is missing, damaged or of another kind."""


class OutputError(InputError):
    """Results cannot be put where the user wants them."""


class UnknownNameError(InputError, KeyError):
    """A result is asked for a number or a die that it does not have."""

    def __str__(self) -> str:
        return str(self.args[0])


class InternalError(MaskfabError):
    """An invariant of maskfab itself was broken."""


class AtFault(Exception):  # noqa: N818 - no error of its own: the fault that it follows from is told
    """A value that is at fault itself is read; what reads it has nothing to judge."""


class Faults:
    """Faults of one input, gathered so that all are told at once.

        faults = Faults()
        with faults:
            check_lens(camera)
        with faults:
            check_scene(scene)
        faults.refuse()

    A block ends at its first refusal, and in silence where it reads a value that is known to be at fault.
    """

    def __init__(self) -> None:
        self._found: list[MaskfabError] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def __iter__(self) -> Iterator[MaskfabError]:
        return iter(self._found)

    def add(self, fault: MaskfabError) -> None:
        """Keep a fault, or those that it consists of; what was told of a place is not told again."""
        told = {(known.code, known.where or known.what) for known in self._found}
        self._found += [one for one in fault.faults if (one.code, one.where or one.what) not in told]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(error, InputError):
            self.add(error)
        return isinstance(error, InputError | AtFault)

    def refuse(self) -> None:
        """Raise what was found: nothing for none, one as it is, several as one."""
        if len(self._found) > 1:
            raise ManyFaultsError(self._found)
        if self._found:
            raise self._found[0]
