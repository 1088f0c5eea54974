"""Records with some of their fields changed."""

from typing import Any, TypeVar

Record = TypeVar("Record")


def replace_unchecked(one: Record, **changes: Any) -> Record:
    """A copy of a dataclass with other values in some of its fields: `dataclasses.replace` for those without checks of
    their own, in a fifth of the time. What a copy has worked out of its fields is not passed on.

    >>> from vrte.basics.running import Run
    >>> replace_unchecked(Run(4), threads=1).threads
    1
    """
    found, held = object.__new__(type(one)), one.__dict__
    names = type(one).__dataclass_fields__  # type: ignore[attr-defined]
    found.__dict__.update({name: held[name] for name in names if name in held}, **changes)
    return found
