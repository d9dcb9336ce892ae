"""A table of a job file or of a profile."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A table of a job file: frozen, and refused if it has an unknown key or a value of the wrong type."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
