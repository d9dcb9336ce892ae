"""report.json: the machine's twin of the report. The page a person reads is rendered from this document alone."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any, get_args

import numpy as np

from maskfab.base import __version__
from maskfab.base.errors import InternalError
from maskfab.base.folders import TIMES
from maskfab.base.model import Camera, Die, Plate, Process, Quantity, Report, StopShape, Tiling, WrittenFile
from maskfab.base.units import NM_PER_UM
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import Feasibility
from maskfab.mask.formats.exr import stop_facts
from maskfab.optics.scene.plan import AT_MOST, plan_document
from maskfab.report.documents.die import (
    closed_object,
    design_schema,
    display_document,
    display_schema,
    or_null,
    photographs_schema,
)
from maskfab.report.documents.measured import measured_schema
from maskfab.report.rows.bands import ProcessSpread
from maskfab.report.rows.scene import PointView, SceneOptics
from maskfab.report.rows.text import quantity_document
from maskfab.report.rows.verdicts import Verdicts

SCHEMA_VERSION = 5

Document = dict[str, Any]

EXPECTED = ("optics", "written", "photographs")
"""Models whose time is told with a die; that of its scene is told with the scene's plan."""

NO_DISPLAYS: Mapping[str, Feasibility] = MappingProxyType({})
NO_DESIGNS: Mapping[str, Document] = MappingProxyType({})
NO_SPREAD = ProcessSpread()


def to_document(
    report: Report,
    plate: Plate,
    camera: Camera,
    scenes: Sequence[SceneOptics] = (),
    displays: Mapping[str, Feasibility] = NO_DISPLAYS,
    designs: Mapping[str, Document] = NO_DESIGNS,
    photographs: Document | None = None,
    measured: Mapping[str, Document] = NO_DESIGNS,
    expected_s: Mapping[str, Mapping[str, float]] = NO_DESIGNS,
    spread: ProcessSpread = NO_SPREAD,
    process: Process | None = None,
) -> Document:
    """The report.json of one run, of plain Python types throughout.

    ``scenes``, ``displays``, ``designs`` and ``measured`` are those of dies that have one; a design is a document of
    :func:`maskfab.report.documents.die.design_document`, ``photographs`` one of
    :func:`maskfab.report.documents.die.photographs_document`, and a measurement one of
    :meth:`maskfab.report.documents.measured.Beside.of_die`. ``expected_s`` is the time that models of a die are
    expected to take, by die and model. ``process`` is that of the mask writer, as stated,
    and ``spread`` what bands are over.

    Two runs of one job make equal documents; the times that they took are told beside it.

    Raises:
        InternalError: MF901 if the report's dies are not the plate's, or a number is NaN or infinite.
    """
    drawn, reported = [die.name for die in plate.dies], list(report.dies)
    if sorted(drawn) != sorted(reported):
        raise InternalError("MF901", f"the report has the dies {reported}, the plate {drawn}")
    of_die = {scene.die.name: scene for scene in scenes}
    document: Document = {
        "schema_version": SCHEMA_VERSION,
        "maskfab_version": __version__,
        "title": report.title,
        "job_hash": report.job_hash,
        # Which findings a run made itself differs between equal runs, as their times do.
        "provenance": TIMES,
        "verdict": "pass" if report.passed else "fail",
        "verdicts": Verdicts.of(report.checks, displays, len(plate.dies)).to_dict(),
        "seeds": dict(report.seeds),
        "camera": _camera(camera),
        **({} if process is None else {"process": asdict(process)}),
        **({"spread": asdict(spread)} if spread else {}),
        **({} if photographs is None else {"photographs": photographs}),
        "dies": [
            _die(die, report.dies[die.name], of_die.get(die.name), displays.get(die.name), designs.get(die.name))
            | ({"measured": measured[die.name]} if die.name in measured else {})
            | ({"expected_seconds": expected_s[die.name]} if die.name in expected_s else {})
            for die in plate.dies
        ],
        "plate": [quantity_document(quantity) for quantity in report.plate],
        "checks": [quantity_document(quantity) for quantity in report.checks],
        "files": [_file(file) for file in report.files],
    }
    plain: Document = _plain(document, "report")
    return plain


def report_text(document: Mapping[str, Any]) -> str:
    """The document as JSON text: equal documents give equal bytes, keys in the contract's order.

    Raises:
        InternalError: MF901 if a number is NaN or infinite, neither of which JSON can say.
    """
    return json.dumps(_plain(document, "report"), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def schema() -> Document:
    """The JSON Schema (draft 2020-12) of report.json."""
    text, number, integer = {"type": "string"}, {"type": "number"}, {"type": "integer"}
    quantities = {"type": "array", "items": {"$ref": "#/$defs/quantity"}}
    pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    scalar = {"type": ["number", "string", "null"]}
    quantity = closed_object(
        {
            "name": text,
            "symbol": text,
            "value": scalar,
            "unit": text,
            "uncertainty": {"type": ["number", "null"], "description": "half width of the error bar; null if exact"},
            "method": text,
            "limit": scalar | {"description": "what `passed` was judged against; null if nothing is required"},
            "passed": {"type": ["boolean", "null"]},
            "wavelength_nm": number,
            "level_db": number | {"description": "signal-to-noise ratio of white behind the published display"},
            "at_most": {"const": True, "description": "the truth may lie far below the value, not above it"},
            "between": pair | {"description": "edges of a band, in `unit`"},
            "die": text,
        },
        optional=("wavelength_nm", "level_db", "at_most", "between", "die"),
    )
    die = closed_object(
        {
            "name": text,
            "label": text,
            "opening": text,
            "dot_um": number,
            "pitch_um": number,
            "dpi": number,
            "gutter_um": number,
            "tiling": {"enum": [tiling.value for tiling in Tiling]},
            "seed": {"type": ["integer", "null"]},
            "cells": pair | {"items": integer, "description": "columns, rows"},
            "centre_um": pair | {"description": "x, y from the plate's centre, y upwards"},
            "quantities": quantities
            | {"description": "of the plate's own standard: on the axis, in focus at infinity, without a gap"},
            "scene": _scene_schema(quantities),
            "display": display_schema(),
            "design": design_schema(),
            "measured": measured_schema(),
            "expected_seconds": closed_object(dict.fromkeys(EXPECTED, number), optional=EXPECTED)
            | {"description": "of one thread of the machine of the reference numbers, for each model of the die"},
        },
        optional=("scene", "display", "design", "measured", "expected_seconds"),
    )
    camera = closed_object(
        {
            "focal_um": number,
            "stop": closed_object(
                {
                    "shape": {"enum": list(get_args(StopShape))},
                    "diameter_um": number | {"description": "side of the square about the axis that holds it"},
                    "stop_width_um": number,
                    "stop_height_um": number,
                    "stop_inner_um": number,
                    "stop_corners_um": {"type": "string", "description": "x and y of every corner"},
                },
                optional=("stop_width_um", "stop_height_um", "stop_inner_um", "stop_corners_um"),
            ),
            "wavelengths_nm": {"type": "array", "items": number},
            "pixel_um": number,
            "window_um": number,
        }
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "maskfab report",
        **closed_object(
            {
                "schema_version": {"const": SCHEMA_VERSION},
                "maskfab_version": text,
                "title": text,
                "job_hash": text,
                "provenance": {"type": "string", "description": "file that tells which findings earlier runs had kept"},
                "verdict": {"enum": ["pass", "fail"], "description": "whether no check failed"},
                "verdicts": _verdicts_schema(),
                "seeds": {"type": "object", "additionalProperties": integer},
                "camera": camera,
                "process": closed_object(
                    {
                        "corner_radius_um": number,
                        "cd_bias_um": number,
                        "roughness": or_null(closed_object({"sigma_um": number, "correlation_um": number})),
                    }
                )
                | {"description": "of the mask writer, as stated: numbers as written are of it, and bands about it"},
                "spread": closed_object({"bias_um": number, "radius_um": number})
                | {"description": "standard deviations over the displays made, that bands are over"},
                "photographs": photographs_schema(),
                "dies": {"type": "array", "items": die},
                "plate": quantities,
                "checks": quantities,
                "files": {
                    "type": "array",
                    "items": closed_object({"path": text, "format": text, "bytes": integer, "sha256": text}),
                },
            },
            optional=("photographs", "process", "provenance", "spread"),
        ),
        "$defs": {"quantity": quantity},
    }


def _verdicts_schema() -> Document:
    count, verdicts = {"type": "integer"}, [verdict.value for verdict in Verdict]
    of_checks = {"checks": count, "failed": count, "passed": {"type": ["boolean", "null"]}}
    of_dies = dict.fromkeys(("dies", "fits", "does_not_fit", "unknown"), count)
    tally = closed_object(of_checks) | {"description": "null: nothing was checked"}
    return closed_object(
        {
            "files": tally,
            "optics": tally,
            "display": closed_object(
                {**of_dies, "verdict": {"enum": [*verdicts, None]}, "circuits": {"type": "string"}},
                optional=("circuits",),
            )
            | {"description": "the worst answer of all dies; null: the job asks for no display"},
        }
    )


def _scene_schema(quantities: Document) -> Document:
    text, number, integer, flag = ({"type": kind} for kind in ("string", "number", "integer", "boolean"))
    distance = {"type": ["number", "null"], "description": "from the lens; null is infinity"}
    pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    band = closed_object({"name": text, "low_nm": number, "high_nm": number})
    view = closed_object(
        {"image_um": pair, "object_um": distance, "wavelength_nm": number, "change": number, "residual": number}
    )
    ingredient = closed_object(
        {
            "name": text,
            "modelled": flag,
            "error_if_left_out": number,
            "counted": number,
            "method": text,
            "safety": number,
        }
    )
    plan = {
        **dict.fromkeys(("path", "precision"), text),
        "grey_rim": flag,
        "step_um": number,
        **dict.fromkeys(("samples", "pixel_margin", "wavelengths", "depths", "places"), integer),
        "phase_tolerance": number,
        "samples_per_dot": integer,
        **dict.fromkeys(("predicted_flops", "predicted_seconds", "predicted_bytes", "error"), number),
        "errors": {"const": AT_MOST, "description": "what `error` and those of `ingredients` are"},
        "nearest_object_um": distance,
        "ingredients": {"type": "array", "items": ingredient},
    }
    asked = {
        "accuracy": number,
        **dict.fromkeys(("nearest_um", "farthest_um", "focus_um"), distance),
        **dict.fromkeys(("field_um", "gap_um"), number),
        "aberrations": {"type": "array", "items": pair},
        "distortion": closed_object({"ratio": number, "height_um": number}),
        "saturation": flag,
        "bands": {"type": "array", "items": band},
    }
    return closed_object(
        {
            "asked": closed_object(asked, optional=("distortion",)),
            "plan": closed_object(plan),
            "field": {"type": "array", "items": {"type": "array", "items": view}},
            "depth": {"type": "array", "items": view},
            "quantities": quantities,
        }
    )


def _camera(camera: Camera) -> Document:
    return {
        "focal_um": camera.focal_um,
        "stop": {"shape": camera.stop.shape, "diameter_um": camera.stop.diameter_um, **stop_facts(camera.stop)},
        "wavelengths_nm": camera.wavelengths_nm,
        "pixel_um": camera.pixel_um,
        "window_um": camera.window_um,
    }


def _die(
    die: Die,
    quantities: Sequence[Quantity],
    scene: SceneOptics | None,
    display: Feasibility | None,
    design: Document | None,
) -> Document:
    panel = die.panel
    rows, columns = panel.orientations.shape
    extra = {} if scene is None else {"scene": _scene(scene)}
    if display is not None:
        extra["display"] = display_document(display)
    if design is not None:
        extra["design"] = design
    return {
        "name": die.name,
        "label": die.label,
        "opening": panel.opening.name,
        "dot_um": panel.dot_nm / NM_PER_UM,
        "pitch_um": panel.cell_size.pitch_um,
        "dpi": panel.cell_size.dpi,
        "gutter_um": panel.gutter_nm / NM_PER_UM,
        "tiling": panel.tiling.value,
        "seed": panel.seed,
        "cells": (columns, rows),
        "centre_um": tuple(coordinate / NM_PER_UM for coordinate in die.centre_nm),
        "quantities": [quantity_document(quantity) for quantity in quantities],
        **extra,
    }


def _scene(optics: SceneOptics) -> Document:
    scene = optics.scene
    return {
        "asked": {
            "accuracy": optics.plan.accuracy,
            "nearest_um": _distance(scene.nearest_um),
            "farthest_um": _distance(scene.farthest_um),
            "focus_um": _distance(scene.focus_um),
            "field_um": scene.field_um,
            "gap_um": scene.gap_um,
            "aberrations": scene.aberrations,
            **({} if scene.distortion is None else {"distortion": asdict(scene.distortion)}),
            "saturation": scene.saturation,
            "bands": [
                {"name": band.name, "low_nm": band.range_nm[0], "high_nm": band.range_nm[1]} for band in scene.bands
            ],
        },
        "plan": {key: value for key, value in plan_document(optics.die.name, optics.plan).items() if key != "die"},
        "field": [[_view(view) for view in row] for row in optics.field],
        "depth": [_view(view) for view in optics.depth],
        "quantities": [quantity_document(quantity) for quantity in optics.quantities],
    }


def _view(view: PointView) -> Document:
    return {
        "image_um": view.image_um,
        "object_um": _distance(view.object_um),
        "wavelength_nm": view.psf.wavelength_nm,
        "change": view.change,
        "residual": view.residual,
    }


def _distance(length_um: float) -> float | None:
    return None if math.isinf(length_um) else length_um


def _file(file: WrittenFile) -> Document:
    return {"path": file.path, "format": file.format, "bytes": file.bytes, "sha256": file.sha256}


def _plain(value: Any, where: str) -> Any:
    """The value in the types JSON knows; a number it has no word for is refused with its place."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        raise InternalError("MF901", f"{where} is {value}, not a finite number")
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InternalError("MF901", f"{where} is a {type(value).__name__}, which JSON has no word for")
