"""An entry of a registry: a calibration with its scope, status and provenance, and the path derived from its key."""

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
"""A label can be used as a KEY and in tables: it must not look like an option or a formula, nor contain separators of
a
KEY (``@`` and ``/``) or of a list."""
TAG: Final = "^[a-z0-9][a-z0-9._-]*$"

Text: TypeAlias = Annotated[str, Meta(min_length=1, max_length=1000)]
Length: TypeAlias = Annotated[float, Meta(gt=0)]
Label: TypeAlias = Annotated[str, Meta(max_length=40, pattern=LABEL)]
Tag: TypeAlias = Annotated[str, Meta(max_length=40, pattern=TAG)]
Stated = Meta(extra_json_schema={"minProperties": 1})
"""A block without content is omitted."""


class Status(StrEnum):
    """Status of an entry, which decides whether it may be used."""

    DRAFT = "draft"
    APPROVED = "approved"
    HELD = "held"
    RETIRED = "retired"

    @property
    def is_usable(self) -> bool:
        """Whether the entry may be used: it is approved, or held against replacement."""
        return self in USABLE


USABLE: Final = frozenset({Status.APPROVED, Status.HELD})


class Alias(Record):
    """Another make and model that the same camera writes into EXIF or XMP.

    Attributes:
        make, model: as the camera writes them.
    """

    make: Text
    model: Text

    def __post_init__(self) -> None:
        require_declared(self)


class Sensor(Record):
    """The physical sensor, as far as it is known.

    Attributes:
        width_mm, height_mm: size of the part that the image shows, in mm.
        pitch_um: pixel pitch of the image in µm.

    Raises:
        InputError: a value is not finite and positive, or no value is stated.
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
    """Period of validity, both days included; None is open.

    Attributes:
        first, last: first and last day; None for an open end.

    Raises:
        InputError: no day is stated, or the last is before the first.
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
        """Return whether it is valid on a day."""
        return (self.first is None or self.first <= day) and (self.last is None or day <= self.last)

    def overlaps(self, other: Validity) -> bool:
        """Return whether two periods have a day in common."""
        return (self.first or date.min) <= (other.last or date.max) and (other.first or date.min) <= (
            self.last or date.max
        )


class EntryFields(Record):
    """Fields of an entry.

    Attributes:
        calibration: K in the canonical pixel origin, and distortion; its camera is the entry's key, with a hashed
            serial number and without firmware (see ``firmware``).
        status: only approved and held entries are used.
        reason: reason for the status.
        firmware: firmware versions that the entry applies to; None for all.
        aliases: other names of the camera.
        sensor: physical sensor.
        validity: days on which it may be used; None for every day.
        tolerance: largest relative difference of fx of other K's of this camera; None to use the policy's (3 % in
            ``fleet``).
        supersedes: id of the entry that it replaced.
        override: reason for using a K that contradicts known facts about the camera.
        rig: membership in a rig, with the pose; None for a single camera.
        label: name of the unit, "P4R-03"; only for the entry of a unit. Like tags and notes, it does not affect which
            K is used, and is not covered by an approval.
        tags: short words for searching.
        extensions: ``x-`` fields of the file, unchanged; one inside a block is named ``block/x-name``.
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
    """An entry of a registry.

    Raises:
        InputError: the calibration cannot be an entry: make, model or image size is missing, K is only an estimate,
            its provenance is not traceable, or a value is out of bounds.
    """

    _lifted: ClassVar[str | None] = "calibration"

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Return the flat form of the file; see :mod:`calibrary.registry.entry_form`."""
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
        """Reject an invalid label or tag, with a clearer message than that of the schema's pattern."""
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
        """Make a draft entry from a calibration of a file or solver.

        A known firmware of the camera is kept in the provenance: the calibration was made with it, but may apply to
        others.

        Raises:
            InputError: make or model is unknown, or K is only an estimate.
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
        """Path below the registry's root, derived from the key alone."""
        return path_of(self.calibration.camera, self.firmware)

    @property
    def id(self) -> str:
        """Path without ``cameras/`` and ``.yaml``."""
        return id_of(self.path)

    @property
    def unit(self) -> str | None:
        """Folder of the unit, common to all its entries; None for an entry of all units of the model."""
        return unit_folder(self.path) if self.calibration.camera.serial is not None else None

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user."""
        return self.calibration.notes

    @property
    def is_usable(self) -> bool:
        """Whether the status allows use."""
        return self.status.is_usable
