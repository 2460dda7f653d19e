"""The source of a calibration, and the grade of K that follows from it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Final, Literal, get_type_hints

from msgspec import Struct

from calibrary.image_size import ImageSize
from calibrary.records import Meta, Record, require_declared


class Grade(StrEnum):
    """Origin of the intrinsics, best first. Only the first four may be used as a K by a solver.

    >>> [grade.value for grade in calibrary.Grade if grade.is_metric]
    ['calibrated', 'adjusted', 'design', 'derived']
    """

    CALIBRATED = "calibrated"
    ADJUSTED = "adjusted"
    DESIGN = "design"
    DERIVED = "derived"
    PRIOR = "prior"
    SEED = "seed"

    @property
    def rank(self) -> int:
        """0 for the best grade, increasing."""
        return _GRADES.index(self)

    @property
    def is_metric(self) -> bool:
        """Whether a solver may use intrinsics of this grade as a K."""
        return self is not Grade.PRIOR and self is not Grade.SEED

    @property
    def is_measured(self) -> bool:
        """Whether K was measured on a camera, and not derived from what its maker states."""
        return self is Grade.CALIBRATED or self is Grade.ADJUSTED

    @property
    def meaning(self) -> str:
        """Explanation of the grade, for the legend of a report."""
        return GRADE_MEANINGS[self]


_GRADES: Final = tuple(Grade)

GRADE_MEANINGS = {
    Grade.CALIBRATED: "measured on this unit, with a calibration target or by the manufacturer",
    Grade.ADJUSTED: "estimated by the bundle adjustment of a reconstruction",
    Grade.DESIGN: "design value of the manufacturer for the camera model",
    Grade.DERIVED: "focal length divided by pixel pitch or sensor size",
    Grade.PRIOR: "from the 35 mm equivalent, or from a listed sensor width that nothing confirms",
    Grade.SEED: "generic start for a self-calibration",
}


class SourceFile(Record):
    """A file that a calibration was made from.

    Attributes:
        name: file name without the folder.
        sha256: SHA-256 of the content, 64 hexadecimal digits.
    """

    name: str
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]

    def __post_init__(self) -> None:
        require_declared(self)


class About(Struct, frozen=True, kw_only=True):
    """What people see of a field of the provenance, and where its value may go.

    A field without one is listed on pages under its own name, searched, and part of how the calibration was made; it
    has no flag, and stays in the registry.

    Attributes:
        label: name on pages; by default the field's own.
        listed: whether pages list it; another field speaks for those that they do not.
        traces: whether it says which file K is from, and not how the calibration was made.
        flag: what the flag takes by which a user states it where the source does not; None for no flag.
    """

    label: str | None = None
    listed: bool = True
    traces: bool = False
    flag: Literal["name", "day"] | None = None


class Provenance(Record):
    """The source of a calibration.

    A new field is one line here and one under ``Attributes:``; an :class:`About` in its annotation says what is special
    about it. Pages, search, the flags that state it, and what may leave a registry follow from that.

    Attributes:
        kind: "image-metadata", "calibration-file", "matrix-file", "seed", "registry", …
        source: file name (without the folder, which says nothing about the camera).
        tag: tag or key inside the source.
        reference_size: (width, height) px that the source refers to, if it differs from the image's own size.
        adaptation: conversion from the reference size to the image size, in words.
        assumptions: assumptions that were made.
        sha256: SHA-256 of the source's content, if it was a separate file.
        sources: source files, if the calibration was made from several, such as the images of a board.
        tool: program that made the calibration, with its version.
        date: date of the calibration, ISO 8601.
        operator: person who made the calibration.
        firmware: firmware of the camera at that time, as the camera writes it.
        focus: focus setting of the lens, in words: "locked at infinity", "1.5 m".

    >>> source = calibrary.read("survey/DJI_0001.JPG").provenance
    >>> source.tag, source.date
    ('drone-dji:DewarpData', '2019-03-05')
    """

    kind: Annotated[str, About(traces=True, listed=False)]
    source: Annotated[str | None, About(traces=True)] = None
    tag: Annotated[str | None, About(traces=True)] = None
    reference_size: Annotated[ImageSize | None, About(traces=True, listed=False)] = None
    adaptation: Annotated[str | None, About(label="adapted by", traces=True)] = None
    assumptions: Annotated[tuple[str, ...], About(label="assumed", traces=True)] = ()
    sha256: Annotated[str | None, About(traces=True)] = None
    sources: Annotated[tuple[SourceFile, ...], About(traces=True, listed=False)] = ()
    tool: Annotated[str | None, About(label="program", flag="name")] = None
    date: Annotated[str | None, About(label="calibrated on", flag="day")] = None
    operator: Annotated[str | None, About(flag="name")] = None
    firmware: str | None = None
    focus: str | None = None


def _declared(hint: Any) -> About:
    return next((one for one in getattr(hint, "__metadata__", ()) if isinstance(one, About)), About())


_HINTS: Final = get_type_hints(Provenance, include_extras=True)

ABOUT: Final[Mapping[str, About]] = {name: _declared(_HINTS[name]) for name in Provenance.__struct_fields__}
"""What is declared about each field, in declared order."""


HOW_MADE: Final = tuple(name for name, one in ABOUT.items() if not one.traces)
"""Fields that tell how the calibration was made; the others trace the file that K is from."""


def label(name: str) -> str:
    """Return the name of a field on pages."""
    return ABOUT[name].label or name.replace("_", " ")


def facts(made: Provenance, *, traced: bool = True) -> tuple[tuple[str, str], ...]:
    """Return the fields that pages list as (name, text), in declared order.

    Args:
        made: the provenance.
        traced: include the fields that trace the file K is from.
    """
    found = []
    for name, one in ABOUT.items():
        value = getattr(made, name)
        if name == "source":
            value = value or made.kind
        if not one.listed or (one.traces and not traced):
            continue
        if value:
            text = "; ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            found.append((label(name), text))
    return tuple(found)
