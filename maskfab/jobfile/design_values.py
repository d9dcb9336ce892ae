"""Values of [design]: its method, and the objectives of a descent by name."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

Method = Literal["search", "relax"]
METHODS: tuple[str, ...] = get_args(Method)
Symmetry = Literal["d4", "mirror", "rot180"]
Kissing = Literal["allowed", "cell", "neighbours"]
ObjectiveName = Literal["invertibility", "top_residual", "expected_error", "boundary_leak", "mtf_auc", "area"]
Weight = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
