"""Colours of the parts of a STEP file, added as text.

The library's own writer numbers them in the order of addresses in memory, which differs between runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_END = b"ENDSEC;\nEND-ISO-10303-21;"
_TAIL = 200


@dataclass(frozen=True)
class Shade:
    """A colour.

    Attributes:
        rgb: red, green and blue, 0 to 1.
        transparency: 0 is opaque.
    """

    rgb: tuple[float, float, float]
    transparency: float = 0.0


def add_colours(path: Path, model: Any, shades: Mapping[str, Shade]) -> None:
    """Give every solid the colour of its product.

    Args:
        path: a file that the library has written without colours, its entities numbered as the model's.
        model: what was written.
        shades: by the product's name; others get none.
    """
    lines, number = [], model.NbEntities()
    for name, solids, context in _parts(model):
        if name not in shades:
            continue
        shade = shades[name]
        styled = [number + 2 + n for n in range(len(solids))]
        lines.append(
            f"#{number + 1} = MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',"
            f"({','.join(f'#{each}' for each in styled)}),#{context});"
        )
        first = number + 2 + len(solids)
        lines += [f"#{n} = STYLED_ITEM('colour',(#{first}),#{solid});" for n, solid in zip(styled, solids, strict=True)]
        style = list(_style(first, shade))
        lines += style
        number = first + len(style) - 1
    with path.open("r+b") as file:
        size = file.seek(0, 2)
        start = max(0, size - _TAIL)
        file.seek(start)
        end = file.read().rindex(_END)
        file.seek(start + end)
        file.write(("\n".join(lines) + "\n").encode() + _END + b"\n")


def _style(n: int, shade: Shade) -> Iterator[str]:
    red, green, blue = shade.rgb
    yield f"#{n} = PRESENTATION_STYLE_ASSIGNMENT((#{n + 1}));"
    yield f"#{n + 1} = SURFACE_STYLE_USAGE(.BOTH.,#{n + 2});"
    more = f",#{n + 6}" if shade.transparency else ""
    yield f"#{n + 2} = SURFACE_SIDE_STYLE('',(#{n + 3}{more}));"
    yield f"#{n + 3} = SURFACE_STYLE_FILL_AREA(#{n + 4});"
    yield f"#{n + 4} = FILL_AREA_STYLE('',(#{n + 5}));"
    yield f"#{n + 5} = FILL_AREA_STYLE_COLOUR('',#{n + (8 if more else 6)});"
    if more:
        yield f"#{n + 6} = SURFACE_STYLE_RENDERING_WITH_PROPERTIES(.NORMAL_SHADING.,#{n + 8},(#{n + 7}));"
        yield f"#{n + 7} = SURFACE_STYLE_TRANSPARENT({shade.transparency:.6f});"
    yield f"#{n + (8 if more else 6)} = COLOUR_RGB('',{red:.6f},{green:.6f},{blue:.6f});"


def _parts(model: Any) -> Iterator[tuple[str, list[int], int]]:
    """Product name, numbers of the solids and number of their context, for every product with solids."""
    from OCP.StepShape import StepShape_ManifoldSolidBrep, StepShape_ShapeDefinitionRepresentation

    entities = [model.Value(n) for n in range(1, model.NbEntities() + 1)]
    # One Python object stands for one entity as long as it lives, so identity tells its number.
    number = {id(entity): n for n, entity in enumerate(entities, 1)}
    for entity in entities:
        if not isinstance(entity, StepShape_ShapeDefinitionRepresentation):
            continue
        shape = entity.UsedRepresentation()
        items = [shape.ItemsValue(n) for n in range(1, shape.NbItems() + 1)]
        solids = [number[id(item)] for item in items if isinstance(item, StepShape_ManifoldSolidBrep)]
        if solids:
            product = entity.Definition().PropertyDefinition().Definition().ProductDefinition()
            yield product.Formation().OfProduct().Name().ToCString(), solids, number[id(shape.ContextOfItems())]
