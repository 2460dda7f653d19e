"""One entry of a registry: a calibration, whom it is for, who answers for it, and the path that follows."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from datetime import date
from enum import StrEnum
from typing import Annotated, Any, ClassVar, Final, TypeAlias

from msgspec import field

from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.records import Json, Meta, Record, force_setattr, replace
from calibrary.records.limits import require_declared
from calibrary.registry import entry_form
from calibrary.registry.entry_form import BLOCKS_WITH_EXTENSIONS, UNSTATED
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.paths import id_of, path_of, unit_folder
from calibrary.rig import RigMember

__all__ = [
    "UNSTATED",
    "USABLE",
    "Alias",
    "Entry",
    "EntryFields",
    "Sensor",
    "Status",
    "Validity",
]


LABEL: Final = "^[^-\\s=+@/,;'\"][^@/,;\\u0000-\\u001f\\u007f]*$"
"""A label is written where a KEY is, and in tables: it does not begin as a flag or a formula does, nor contain what
divides a KEY (``@`` and ``/``) or a list."""
TAG: Final = "^[a-z0-9][a-z0-9._-]*$"

Text: TypeAlias = Annotated[str, Meta(min_length=1, max_length=1000)]
Length: TypeAlias = Annotated[float, Meta(gt=0)]
Label: TypeAlias = Annotated[str, Meta(max_length=40, pattern=LABEL)]
Tag: TypeAlias = Annotated[str, Meta(max_length=40, pattern=TAG)]
Stated = Meta(extra_json_schema={"minProperties": 1})
"""A block that says nothing is left out."""


class Status(StrEnum):
    """Whether an entry may be used."""

    DRAFT = "draft"
    APPROVED = "approved"
    HELD = "held"
    RETIRED = "retired"

    @property
    def is_usable(self) -> bool:
        """Whether the entry may be used: a person approved it, or holds it against replacement."""
        return self in USABLE


USABLE: Final = frozenset({Status.APPROVED, Status.HELD})


class Alias(Record):
    """Another make and model that the same camera goes by in EXIF or XMP.

    Attributes:
        make, model: as they write them.
    """

    make: Text
    model: Text

    def __post_init__(self) -> None:
        require_declared(self)


class Sensor(Record):
    """The physical sensor behind the frame, as far as it is known.

    Attributes:
        width_mm, height_mm: of the part that the frame shows.
        pitch_um: of the frame's pixels.

    Raises:
        InputError: a number is not finite and positive, or there is none at all.
    """

    width_mm: Length | None = None
    height_mm: Length | None = None
    pitch_um: Length | None = None

    def __post_init__(self) -> None:
        for name in ("width_mm", "height_mm", "pitch_um"):
            value = getattr(self, name)
            if value is None:
                continue
            if not 0 < float(value) < math.inf:
                raise InputError(f"the sensor's {name} is {value}, expected a positive number")
            force_setattr(self, name, float(value))
        if self.width_mm is None and self.height_mm is None and self.pitch_um is None:
            raise InputError("the sensor states nothing, expected width_mm, height_mm or pitch_um")


class Validity(Record):
    """From one day to another, both included; None is open.

    Attributes:
        first, last: the days, None for an open end.

    Raises:
        InputError: neither day is stated, or the last comes before the first.
    """

    first: date | None = field(name="from", default=None)
    last: date | None = field(name="until", default=None)

    def __post_init__(self) -> None:
        if self.first is None and self.last is None:
            raise InputError("the validity states no day, expected its first day, its last day or both")
        if self.first is not None and self.last is not None and self.last < self.first:
            raise InputError(
                f"valid from {self.first} until {self.last}, expected the first day before the last"
            )

    def __str__(self) -> str:
        days = [f"from {self.first}"] if self.first is not None else []
        return " ".join([*days, f"until {self.last}"] if self.last is not None else days)

    def holds(self, day: date) -> bool:
        """Whether it is valid on a day."""
        return (self.first is None or self.first <= day) and (self.last is None or day <= self.last)

    def overlaps(self, other: Validity) -> bool:
        """Whether some day lies in both."""
        return (self.first or date.min) <= (other.last or date.max) and (other.first or date.min) <= (
            self.last or date.max
        )


class EntryFields(Record):
    """What an entry states.

    Attributes:
        calibration: K in the canonical origin, distortion apart; its camera names the entry's key, with the
            serial number hashed and no firmware (``firmware`` says of which it is).
        status: only approved and held entries are used.
        reason: why it has this status.
        firmware: of which firmware it is; None is of every one.
        aliases: what else the camera calls itself.
        sensor: behind the frame.
        validity: the days it may be used on; None is every day.
        tolerance: how far a K of this camera may lie from this one, as a share of fx; None leaves it to the
            policy (3 % under ``fleet``).
        supersedes: the id of the entry it took the place of.
        override: why K is used although it contradicts what is known of the camera.
        rig: which rig the camera is fixed in, and where; None for a camera by itself.
        label: what its keeper calls the unit, "P4R-03"; of one unit only. Like the tags and notes, it decides nothing
            about which K is used and is not part of what is approved.
        tags: short words to find entries by.
        extensions: the file's ``x-`` fields as they are; one inside a block goes by ``block/x-name``.
    """

    calibration: Calibration
    status: Status = Status.DRAFT
    reason: str | None = None
    firmware: Annotated[FirmwareRange, Stated] | None = None
    aliases: tuple[Alias, ...] = ()
    sensor: Annotated[Sensor, Stated] | None = None
    validity: Annotated[Validity, Stated] | None = None
    tolerance: Annotated[float, Meta(gt=0, le=1)] | None = None
    supersedes: Text | None = None
    override: Text | None = None
    rig: RigMember | None = None
    label: Label | None = None
    tags: tuple[Tag, ...] = ()
    extensions: Mapping[str, Any] = {}


class Entry(EntryFields, tag_field="schema", tag="calibrary/entry-1"):
    """One camera of a registry.

    Raises:
        InputError: the calibration cannot be an entry: make, model or image size is missing, K is a guess, its
            provenance cannot be traced, or a value is out of the bounds of an entry's file.
    """

    _lifted: ClassVar[str | None] = "calibration"

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """An entry is written flat, as :mod:`calibrary.registry.entry_form` says."""
        return entry_form.written(document, self)

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        return entry_form.read(document)

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
        return entry_form.schema(schema, defs)

    def __post_init__(self) -> None:
        camera, grade = self.calibration.camera, self.calibration.grade
        if not (camera.make or "").strip() or not (camera.model or "").strip():
            raise InputError(f"{camera} lacks make or model, expected both: a registry finds cameras by them")
        if camera.image_size != self.calibration.intrinsics.image_size:
            raise InputError("the camera's image size differs from that of K")
        if camera.firmware is not None:
            raise InputError("an entry's firmware is a range of its own, not part of its camera")
        if not grade.is_metric:
            raise InputError(f"a K of grade {grade.value} is a guess, and a registry takes no guesses")
        self._require_words()
        require_declared(self)
        force_setattr(self, "tags", tuple(sorted(set(self.tags))))
        entry_form.require_entry_values(self.calibration)
        for name in self.extensions:
            block, _, key = name.rpartition("/")
            if not key.startswith("x-") or (block and not self._has(block)):
                raise InputError(
                    f"{name!r:.60} is not a field of this entry, expected x-… or, in a block it has, block/x-…"
                )

    def _require_words(self) -> None:
        """Refuse a label or tag that is none, in words that say more than their pattern does."""
        label = self.label
        if label is not None and (
            re.search(LABEL, label) is None or label != " ".join(label.split()) or not label.isprintable()
        ):
            expected = "a name such as P4R-03, without @ / , ; and not beginning with - = + or a quote"
            raise InputError(f"{label!r:.60} is not a label, expected {expected}", place="label")
        wrong = next((tag for tag in self.tags if not re.fullmatch(TAG, tag)), None)
        if wrong is not None:
            expected = "small letters, digits and . _ -"
            raise InputError(f"{wrong!r:.60} is not a tag, expected {expected}", place="tags")

    def _has(self, block: str) -> bool:
        absent = {
            "sensor": self.sensor is None,
            "quality": self.calibration.quality is None,
            "provenance": self.calibration.provenance == UNSTATED,
        }
        return block in BLOCKS_WITH_EXTENSIONS and not absent.get(block, False)

    @classmethod
    def of(cls, calibration: Calibration, *, firmware: FirmwareRange | None = None) -> Entry:
        """A draft of an entry from a calibration as files and solvers give it.

        The camera's firmware, if it is known, goes into the provenance: it was made with that one, which does
        not say that it is of no other.

        Raises:
            InputError: make or model is not known, or K is a guess.
        """
        camera, provenance = calibration.camera, calibration.provenance
        made_with = provenance.firmware or camera.firmware
        return cls(
            calibration=replace(
                calibration,
                camera=replace(camera, firmware=None, image_size=calibration.intrinsics.image_size),
                provenance=replace(provenance, firmware=made_with),
            ),
            firmware=firmware,
        )

    @property
    def path(self) -> str:
        """Where it lies below the registry's root; it follows from the key alone."""
        return path_of(self.calibration.camera, self.firmware)

    @property
    def id(self) -> str:
        """Its path without ``cameras/`` and ``.yaml``."""
        return id_of(self.path)

    @property
    def unit(self) -> str | None:
        """Its unit's folder, which all entries of the unit share; None where it is of every unit of the model."""
        return unit_folder(self.path) if self.calibration.camera.serial is not None else None

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know about it."""
        return self.calibration.notes

    @property
    def is_usable(self) -> bool:
        """Whether its status allows using it."""
        return self.status.is_usable
