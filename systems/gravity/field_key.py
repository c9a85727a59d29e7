"""`FieldKey`: a gravity field as the key of a cache, for what takes long to compute of a field."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as dc_field

from proxops.systems.gravity.gravity_field import Field, GravityField


@dataclass(frozen=True)
class FieldKey:
    """Two keys of `GravityField` are equal if shape, mass and contrast are.

    The key of any other field equals keys of that same object only.
    """

    identity: tuple
    field: Field = dc_field(compare=False)

    @classmethod
    def of(cls, field: Field) -> FieldKey:
        """Makes the key of a field. It keeps the field, so that no other gets its identity."""
        if isinstance(field, GravityField):
            return cls((field.shape.sha256, field.mass, field.contrast), field)
        return cls((id(field),), field)
