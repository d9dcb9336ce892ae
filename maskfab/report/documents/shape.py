"""Shape of documents: types whose fields give a document in its order, its schema, and what is checked of it when read.

A document is written whole and read in part: fields that no reader needs are :func:`written`, and may then be missing.
What may be absent from a document, :func:`optional`, is never null in it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, Union, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo

from maskfab.base.errors import InputError
from maskfab.job.values import check_name

Document: TypeAlias = dict[str, Any]
Record: TypeAlias = Mapping[str, Any]
"""A document, or part of one, that is only read."""

DRAFT = "https://json-schema.org/draft/2020-12/schema"
WORST = "mtf_worst_"
"""At the start of the names of MTFs in their worst direction, before the frequency in cycles per millimetre."""
_WRITTEN: Document = {"written": True}
_SCALARS = {float: "number", int: "integer", str: "string", bool: "boolean", NoneType: "null"}


@dataclass(frozen=True)
class OneOf:
    """Mark of a type whose values are these alone."""

    values: tuple[object, ...]


Text = Annotated[str, Field(max_length=20_000)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
WholePair = Annotated[list[int], Field(min_length=2, max_length=2)]


def _name_of_a_die(name: str) -> str:
    try:
        return check_name(name)
    except InputError as error:
        raise ValueError("this is no name that a die of a job can have") from error


DieName = Annotated[str, Field(max_length=100), AfterValidator(_name_of_a_die)]


def document_text(document: Mapping[str, Any]) -> str:
    """A document as the text of its file; equal ones have equal bytes."""
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


class Part(BaseModel):
    """An object of a document, its properties in their order; a schema refers to one that has a ``definition``."""

    model_config = ConfigDict(allow_inf_nan=False, strict=True)
    definition: ClassVar[str | None] = None

    @model_validator(mode="before")
    @classmethod
    def _what_may_be_absent_is_not_null(cls, read: object) -> object:
        if isinstance(read, Mapping):
            for name, field in cls.model_fields.items():
                if _is_optional(field) and read.get(name, ...) is None:
                    raise ValueError(f"{name} is null")
        return read

    @classmethod
    def document(cls, source: object = None, **stated: Any) -> Document:
        """Properties in order: those stated, and a source's attributes by name; what may be absent is, where None."""
        values = {name: stated[name] if name in stated else getattr(source, name, None) for name in cls.model_fields}
        return {
            name: value
            for name, value in values.items()
            if value is not None or not _is_optional(cls.model_fields[name])
        }

    @classmethod
    def schema_document(cls) -> Document:
        """JSON Schema of an object of these properties alone."""
        fields = cls.model_fields.items()
        return {
            "type": "object",
            "properties": {name: _schema(field) for name, field in fields},
            "required": [name for name, field in fields if not _is_optional(field)],
            "additionalProperties": False,
        }


def optional(words: str | None = None) -> Any:
    """A field that a document may lack."""
    return Field(default=None, description=words)


def written(words: str | None = None) -> Any:
    """A field that every document has, and no reader needs."""
    return Field(default=None, description=words, json_schema_extra=_WRITTEN)


def _is_optional(field: FieldInfo) -> bool:
    return not field.is_required() and field.json_schema_extra is not _WRITTEN


def _schema(annotation: Any) -> Document:
    """Schema of a type: lengths that leave no choice, and no marks of what is checked where a document is read."""
    if isinstance(annotation, FieldInfo):
        field = annotation
        schema = _schema(Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation)
        return schema if field.description is None else {**schema, "description": field.description}
    if get_origin(annotation) is Annotated:
        kind, *marks = get_args(annotation)
        for mark in marks:
            if isinstance(mark, OneOf):
                return {"const": mark.values[0]} if len(mark.values) == 1 else {"enum": list(mark.values)}
        limits = [*marks, *(part for mark in marks if isinstance(mark, FieldInfo) for part in mark.metadata)]
        least, most = (
            next((getattr(limit, name) for limit in limits if hasattr(limit, name)), None)
            for name in ("min_length", "max_length")
        )
        return {**_schema(kind), **({} if least is None or least != most else {"minItems": least, "maxItems": most})}
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation is Any:
        return {}
    if annotation in _SCALARS:
        return {"type": _SCALARS[annotation]}
    if origin is Literal:
        return _schema(Annotated[str, OneOf(parts)])
    if origin is list:
        return {"type": "array", "items": _schema(parts[0])}
    if origin is dict:
        return {"type": "object", "additionalProperties": _schema(parts[1])}
    if origin in (Union, UnionType):
        schemas = [_schema(part) for part in parts]
        if all(schema.keys() == {"type"} for schema in schemas):
            return {"type": [schema["type"] for schema in schemas]}
        return {"anyOf": schemas}
    assert issubclass(annotation, Part)
    return {"$ref": f"#/$defs/{annotation.definition}"} if annotation.definition else annotation.schema_document()


class QuantityPart(Part):
    """A quantity, as :func:`maskfab.report.text.quantity_document` writes it."""

    definition = "quantity"

    name: Text
    symbol: str = written()
    value: float | str | None
    unit: str = written()
    uncertainty: float | None = Field(description="half width of the error bar; null if exact")
    method: str = written()
    limit: float | str | None = written("what `passed` was judged against; null if nothing is required")
    passed: bool | None
    wavelength_nm: float = optional()
    level_db: float = optional("signal-to-noise ratio of white behind the published display")
    at_most: Literal[True] = optional("the truth may lie far below the value, not above it")
    between: Pair = optional("edges of a band, in `unit`")
    die: str = optional()

    @model_validator(mode="after")
    def _open_ratio_is_a_share(self) -> QuantityPart:
        if self.name == "open_ratio" and not isinstance(self.value, float):
            raise ValueError("the open ratio is no number")
        return self

    @model_validator(mode="after")
    def _worst_mtf_is_at_a_frequency(self) -> QuantityPart:
        if self.name.startswith(WORST):
            try:
                float(self.name.removeprefix(WORST))
            except ValueError as error:
                raise ValueError(f"{self.name[:40]!r} names no frequency") from error
        return self


def titled_schema(title: str, part: type[Part]) -> Document:
    """The JSON Schema (draft 2020-12) of a whole document."""
    return {
        "$schema": DRAFT,
        "title": title,
        **part.schema_document(),
        "$defs": {QuantityPart.definition: QuantityPart.schema_document()},
    }
