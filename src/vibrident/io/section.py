"""What the sections of the calibration file have in common: strict, and the types of their keys."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


class FileSection(BaseModel):
    """A section: no other keys than its own, no conversion of types."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _column(value: int | str) -> int | str:
    if value == "" or (isinstance(value, int) and value < 1):
        raise ValueError("not a column")
    return value


# A field's description is the "expected" of its error message.
Column = Annotated[int | str, AfterValidator(_column), Field(description="a column number from 1, or a header name")]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, description="a finite number above 0")]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, description="a finite number, 0 or above")]
Number = Annotated[float, Field(allow_inf_nan=False, description="a finite number")]
Text = Annotated[str, Field(min_length=1, description="text in quotes, not empty")]
