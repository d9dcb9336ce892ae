"""Uses: keys of a job that each verb depends on, and the names of all others that a job states.

A verb declares what it uses; whatever else a job states is named in the verb's answer, or refused. So a key that is new
in the schema is named by every verb until one says that it uses it.

A table stands for all its keys; where a verb uses some of a table, or where keys are still to come, keys are listed one
by one. Names and titles ask for nothing, and every verb goes by them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType

from maskfab.jobfile.section import Section
from maskfab.jobfile.sections import JobSpec

Keys = tuple[str, ...]

INNER = frozenset({"openings", "maps", "curves", "shops"})
"""Tables that a resolved job holds and nobody writes."""


def _of(table: str, keys: str) -> Keys:
    """Keys of one table."""
    return tuple(f"{table}.{key}" for key in keys.split())


_NAMES: Keys = ("job", "die.name", "die.label")
_LENS = _of("camera", "focal stop wavelengths pixel")
_CAMERA: Keys = (*_LENS, "camera.window")
_DIES: Keys = ("die", "plate.die_size")
_LAYOUT: Keys = (*_DIES, *_of("plate", "template blank writable die_pitch columns"), "export.grid")
_BLANK = _of("plate", "optical_density film_phase glass")
_FIT: Keys = ("emitters", *_of("wires", "line space clearance lines transparent"))
_PLACES = _of("scene", "accuracy depth focus field gap aberrations")
_LIGHT = _of("scene", "spectrum illuminant")
_OPTICS: Keys = (*_PLACES, *_LIGHT, *_of("scene", "distortion saturation"))
_SENSOR = _of("sensor", "full_well read_noise bits black_level mosaic")
_PHOTOGRAPHS: Keys = (*_DIES, *_LENS, *_SENSOR, "exposure")
_EDGES: Keys = (*_of("process", "corner_radius cd_bias roughness"), "order.bias")
_STANDS: Keys = ("plate.glass.chrome", *_of("order", "parity chrome"))
_OFFERS = _of(
    "order",
    "glass thickness film optical_density cd registration defects protection corner_touches quantity",
)
_HOUSE: Keys = (*_LAYOUT, *_OFFERS, *_of("order", "tone parity chrome bias"), *_BLANK[::2], "export", "process.cd_bias")

USES: Mapping[str, Keys] = MappingProxyType({
    "run": (
        *_CAMERA, *_LAYOUT, *_BLANK, *_OPTICS, *_SENSOR, *_EDGES, *_of("process.spread", "bias radius"),
        *_of("order", "tone parity chrome cd"),
        *("limits", "emitters", "wires", "light", "exposure", "export", "report"),
    ),
    "run for a house": _OFFERS,
    "package": (*_HOUSE, "order"),
    "order": (*_LAYOUT, *_BLANK[::2], *_of("export", "shop chrome"), "order", "process.cd_bias"),
    "shops": (*_HOUSE, "order"),
    "check": (*_LAYOUT, "emitters", "wires", "light"),
    "check --shop": _HOUSE,
    "render": (*_LAYOUT, *_FIT),
    "plan": (*_CAMERA, *_DIES, *_BLANK, *_OPTICS),
    "simulate": _PHOTOGRAPHS,
    "learn": _PHOTOGRAPHS,
    "simulate a scene": (*_PLACES, *_LIGHT, "plate.glass", "camera.window"),
    "simulate --protocol": _DIES,
    "restore": (*_DIES, *_LENS, *_STANDS),
    "study": (*_DIES, "study"),
    "study of optics": _CAMERA,
    "bench": (*_LAYOUT, *_CAMERA),
    "measure": (*_DIES, *_of("camera", "focal stop pixel"), *_SENSOR, *_STANDS, "process.cd_bias", "order.bias",
                "export.shop"),
    "measure --edge": (*_DIES, *_of("camera", "focal stop pixel"), *_STANDS),
    "measure by lines": ("camera.wavelengths",),
    "measure without --line": _LIGHT,
    "measure without a die": ("camera.pixel",),
    "design": ("design", *_LENS),
    "design by its own light": (*_of("sensor", "read_noise bits black_level"),
                                *_of("exposure", "snr white luminance time quantum_efficiency")),
    "design for a scene": (*_PLACES, "plate.glass"),
    "design that fits": (*_FIT, "plate.die_size"),
    "design over a spread": _of("process.spread", "bias centre"),
    "pareto": ("pareto", *_LENS, *_FIT, "plate.die_size",
               *_of("design", "name method dots pitch tiling tiling_seed seed rules families map weights protocol")),
    "verify --against": (*_LAYOUT, *_CAMERA, *_BLANK, *_of("order", "tone parity chrome bias"), "limits",
                         *_of("export", "shop max_vertices")),
    "sweep": ("limits",),
    "sweep open ratio": _DIES,
    "sweep mtf": (*_DIES, *_CAMERA),
    "sweep restoration": (*_DIES, *_CAMERA),
    "sweep features": (*_DIES, *_EDGES),
    "sweep psf as written": (*_DIES, *_CAMERA, *_EDGES),
    "sweep mtf as written": (*_DIES, *_CAMERA, *_EDGES),
    "sweep scatter": (*_DIES, *_CAMERA, *_EDGES),
    "sweep surrogate": (*_DIES, *_LENS),
    "sweep footprint": (*_DIES, "emitters"),
    "sweep display": (*_DIES, *_FIT),
    "sweep scene": (*_CAMERA, *_DIES, *_BLANK, *_OPTICS),
    "sweep photographs": _PHOTOGRAPHS,
})  # fmt: skip
"""By verb; and what it uses more where it is asked in one way, or instead."""


def unused(spec: JobSpec, *uses: str) -> tuple[str, ...]:
    """Names of all that a job states and a verb does not depend on, in the order of the job; see :func:`named`.

    Args:
        spec: of the job.
        uses: keys and tables that are used.
    """
    return tuple(dict.fromkeys(_unused(spec, "", frozenset((*_NAMES, *uses)))))


def covered(path: str, uses: Collection[str]) -> bool:
    """Whether a key, such as ``process.spread.bias``, is one of the keys, or of the tables, that are used."""
    parts = path.split(".")
    return not {".".join(parts[:end]) for end in range(1, len(parts) + 1)}.isdisjoint((*_NAMES, *uses))


def named(path: str, *, table: bool = False) -> str:
    """A key as messages name it: ``gap of [scene]``, ``[process.spread]``, ``gutter of [[die]]``."""
    if table:
        return f"[[{path}]]" if path == "die" else f"[{path}]"
    section, _, key = path.rpartition(".")
    return f"{key} of {named(section, table=True)}" if section else f"[{key}]"


def in_words(names: tuple[str, ...]) -> tuple[str, ...]:
    """The sentence that names what a verb does not use; none without names."""
    return (f"Not used of the job: {', '.join(names)}.",) if names else ()


def _unused(section: Section, path: str, used: frozenset[str]) -> Iterator[str]:
    for key, field in type(section).model_fields.items():
        here, value = f"{path}.{key}".lstrip("."), getattr(section, key)
        if here in used or here in INNER or value is None:
            continue
        tables = [each for each in (value if isinstance(value, tuple) else (value,)) if isinstance(each, Section)]
        if not field.is_required() and value == field.default:
            continue
        if not tables:
            yield named(here)
        elif not any(each.startswith(f"{here}.") for each in used - frozenset(_NAMES)):
            yield named(here, table=True)
        else:
            for each in tables:
                yield from _unused(each, here, used)
