"""An entry of a registry: a calibration with its scope, status, provenance and verdict, and the path from its key."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import date
from enum import StrEnum
from itertools import combinations_with_replacement
from typing import Annotated, Any, ClassVar, Final, Self, TypeAlias, cast

from msgspec import Struct, field

from calibrary.calibration import Calibration, Covariance, Grade, Provenance
from calibrary.errors import InputError, ParseError
from calibrary.records import (
    Json,
    Limits,
    Meta,
    Record,
    force_setattr,
    narrow,
    replace,
    require_declared,
    require_within,
    to_json,
)
from calibrary.registry.firmware import FirmwareRange, begins_with
from calibrary.registry.paths import id_of, path_of, unit_folder
from calibrary.rig import RigMember
from calibrary.strictyaml import YamlValue

UNSTATED: Final = Provenance(kind="unstated")
"""Provenance of an entry with a file that states none."""

VERDICT_BLOCK: Final = "x-board-calibration"
"""Block that a calibration from a board or a flight adds to its entry: its verdict, and how it was made."""

BLOCKS_WITH_EXTENSIONS: Final = ("camera", "sensor", "quality", "provenance")
"""Blocks that may contain ``x-`` fields, in addition to the file itself; K and distortion may not."""

ORDER: Final = ("schema", "digest", "camera", "label", "tags", "intrinsics", "distortion", "sensor",
    "grade", "quality", "rig", "provenance", "aliases", "validity", "tolerance", "supersedes", "override", "notes",
    "extras")  # fmt: skip
"""Order of the blocks in a file; blocks not listed here follow at the end."""

PARAMETERS: Final = ("fx", "fy", "cx", "cy", "skew")
"""Intrinsics in the order of the file."""

_TEXT: Final = Meta(min_length=1, max_length=1000)
_SIDE: Final = Meta(ge=1, le=1_000_000)
_AMOUNT: Final = Meta(ge=0)
_DAY: Final = "[0-9]{4}-[0-9]{2}-[0-9]{2}"
_TIME: Final = "T[0-9]{2}:[0-9]{2}(:[0-9]{2}([.][0-9]+)?)?(Z|[+-][0-9]{2}:[0-9]{2})?"

LIMITS: Final[Limits] = {
    **{f"camera.{name}": _TEXT for name in ("make", "model", "sub_camera", "lens", "capture_mode", "serial")},
    "camera.focal_mm": Meta(gt=0, le=100_000),
    "camera.image_size": _SIDE,
    **{f"quality.{name}": _AMOUNT for name in ("rms_px", "points", "views", "std", "kappa2")},
    "quality.coverage": Meta(ge=0, le=1),
    "provenance.kind": Meta(pattern="^[a-z][a-z0-9-]*$"),
    "provenance.reference_size": _SIDE,
    "provenance.sha256": Meta(pattern="^[0-9a-f]{64}$"),
    "provenance.date": Meta(pattern=f"^{_DAY}({_TIME})?$"),
}

NO_SOURCES: Final = ("registry", "seed", "unstated")
"""Kinds of provenance that do not state a source."""

TRACED_BY: Final[Mapping[str, tuple[str, ...]]] = {
    "checkerboard": ("sources", "tool"),
    "board": ("sources", "tool"),
    "calibration-file": ("source", "sha256"),
    "matrix-file": ("source", "sha256"),
    "image-metadata": ("source", "tag"),
    "adjustment": ("source", "tool"),
    "manual": ("operator",),
    "catalogue": ("source",),
}
"""Fields required for a traceable calibration, by the kind of its provenance; the date may be unknown."""


def _take_extensions(document: dict[str, Json]) -> dict[str, Json]:
    """Remove the ``x-`` fields from the document and (copied) blocks, and return them."""
    found = {name: document.pop(name) for name in [*document] if name.startswith("x-")}
    for block in BLOCKS_WITH_EXTENSIONS:
        if isinstance(inner := document.get(block), dict):
            found |= {f"{block}/{name}": value for name, value in inner.items() if name.startswith("x-")}
            document[block] = {name: value for name, value in inner.items() if not name.startswith("x-")}
    return found


def _require_entry_values(calibration: Calibration) -> None:
    """Raise an error if a calibration could not be read back from an entry's file.

    Raises:
        InputError: a value is out of bounds, or the provenance lacks a source or a field required for its kind.
    """
    require_within(calibration, LIMITS)
    made = calibration.provenance
    if made == UNSTATED:
        return
    if made.kind in NO_SOURCES:
        raise InputError(f"{made.kind!r} does not name a source", place="provenance.kind")
    missing = [name for name in TRACED_BY.get(made.kind, ()) if not getattr(made, name)]
    if missing:
        raise InputError(f"lacks {', '.join(missing)}", place="provenance")


def _traced(kind: str, names: tuple[str, ...], members: Mapping[str, Any]) -> dict[str, Any]:
    """Return the schema of the fields required for one kind of provenance."""
    stated = {
        name: {"type": "array", "minItems": 1} if members[name]["type"] == "array" else {"type": "string"}
        for name in names
    }
    return {
        "if": {"properties": {"kind": {"const": kind}}},
        "then": {"required": list(names), "properties": stated},
    }


def digest(calibration: Calibration, sensor: Sensor | None = None, rig: RigMember | None = None) -> str:
    """Return ``sha256:`` and 64 digits of the numbers, independent of their order and spelling in the file.

    It is computed from compact JSON with sorted keys, with each number as the shortest text of its double.
    """
    K, quality = calibration.intrinsics, calibration.quality
    lens = calibration.distortion
    covariance = quality.covariance if quality is not None else None
    block: dict[str, Json] = {
        "image_size": list(K.image_size),
        "intrinsics": _numbers({"fx": K.fx, "fy": K.fy, "cx": K.cx, "cy": K.cy, "skew": K.skew}),
        "distortion": {lens.model: _numbers(lens.coefficients)} if lens is not None else None,
        "sensor": _numbers(_sides(sensor)) if sensor is not None else None,
        "std": _numbers(quality.std) if quality is not None else {},
        "covariance": _numbers(_pairs(covariance)) if covariance is not None else None,
    }
    if quality is not None and quality.proven is not None:
        # Entries from before it was stated keep their digest.
        block["proven"] = to_json(quality.proven)
    if rig is not None:
        # The digest of an entry without a rig stays the same as before rigs were introduced.
        block["rig"] = to_json(rig)
    text = json.dumps(block, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def _numbers(values: Mapping[str, float]) -> dict[str, Json]:
    # Minus zero equals zero, but its text differs, and so would the digest of equal numbers.
    return {name: float(value) + 0.0 for name, value in values.items()}


def _sides(sensor: Sensor) -> dict[str, float]:
    sides = {"width_mm": sensor.width_mm, "height_mm": sensor.height_mm, "pitch_um": sensor.pitch_um}
    return {name: value for name, value in sides.items() if value is not None}


def _pairs(covariance: Covariance) -> dict[str, float]:
    """Return each element by the names of its row and column, so that the order of the names does not matter."""
    pairs = combinations_with_replacement(covariance.names, 2)
    return {",".join(sorted(pair)): value for pair, value in zip(pairs, covariance.upper, strict=True)}


Document: TypeAlias = "dict[str, YamlValue]"

OF_FORMER_LAYOUT: Final = (
    "is a line of an earlier layout, in which files said what is approved: take it out, or bring the whole registry to "
    "this one ('calibrary registry init FOLDER --migrate')"
)
CURRENT: Final = 1


def _from_first_cut(document: Document) -> Document:
    """Migrate version 0: one firmware, one note, no digest. It is called entry-1, but has no digest."""
    changed: Document = {**document, "schema": "calibrary/entry-1"}
    camera = document.get("camera")
    if isinstance(camera, dict) and isinstance(firmware := camera.get("firmware"), str):
        changed["camera"] = {**camera, "firmware": {"min": firmware, "max": firmware}}
    if "notes" in document and not isinstance(notes := document["notes"], list):
        changed["notes"] = [notes] if notes is not None else []
    return changed


MIGRATIONS: Final[Mapping[int, Callable[[Document], Document]]] = {0: _from_first_cut}
"""Conversions of a document to the next version, by its version."""


def migrated(value: YamlValue, *, source: str) -> Document:
    """Return the document in the current version; other documents are left to the schema's error message.

    Raises:
        ParseError: it is not a map, states no version, or one newer than this program.
    """
    if not isinstance(value, dict):
        raise ParseError("is not a map of an entry's fields", source=source)
    if "status" in value:
        raise ParseError(OF_FORMER_LAYOUT, source=source, place="status")
    found = _version(value, source)
    if found > CURRENT:
        raise ParseError(
            f"is of schema version {found}, and this calibrary reads versions up to {CURRENT}; "
            "upgrade it (pip install --upgrade calibrary)",
            source=source,
            place="schema",
        )
    for step in range(found, CURRENT):
        value = MIGRATIONS[step](value)
    return value


def _version(document: Document, source: str) -> int:
    name = document.get("schema")
    matched = re.fullmatch(r"calibrary/entry-(\d{1,9})", name) if isinstance(name, str) else None
    if matched is None:
        found = f"{name!r:.60}, expected" if "schema" in document else "missing; expected"
        raise ParseError(
            f"schema is {found} 'calibrary/entry-{CURRENT}': is this a registry's entry?", source=source
        )
    stated = int(matched[1])
    return 0 if stated == 1 and "digest" not in document else stated


LABEL: Final = "^[^-\\s=+@/,;'\"][^@/,;\\u0000-\\u001f\\u007f]*$"
"""A label can be used as a KEY and in tables: it must not look like an option or a formula, nor contain the separators
of a KEY (``@`` and ``/``) or of a list."""
TAG: Final = "^[a-z0-9][a-z0-9._-]*$"

Text: TypeAlias = Annotated[str, Meta(min_length=1, max_length=1000)]
Length: TypeAlias = Annotated[float, Meta(gt=0)]
Label: TypeAlias = Annotated[str, Meta(max_length=40, pattern=LABEL)]
Tag: TypeAlias = Annotated[str, Meta(max_length=40, pattern=TAG)]
Stated = Meta(extra_json_schema={"minProperties": 1})
"""A block without content is omitted."""


class Status(StrEnum):
    """Whether an entry may be used; no file says so, but the statements on it."""

    DRAFT = "draft"
    APPROVED = "approved"
    RETIRED = "retired"

    @property
    def is_usable(self) -> bool:
        """Whether the entry may be used."""
        return self in USABLE


USABLE: Final = frozenset({Status.APPROVED})

USUAL_TOLERANCE: Final = 0.03
"""Relative difference of fx between K's of one camera, if neither the entry nor the policy states one."""


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

    @classmethod
    def between(cls, first: date | None, last: date | None) -> Self | None:
        """The days from ``first`` to ``last``, both included; None if neither is stated."""
        return cls(first=first, last=last) if first is not None or last is not None else None

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
        status: only approved entries are used; a draft is proposed. It is not in the file: the statements decide.
        reason: why it was approved or retired, as stated.
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
    _unwritten: ClassVar[frozenset[str]] = frozenset({"status", "reason"})

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Convert the fields of an entry to the form of its file."""
        calibration = cast("dict[str, Any]", document.pop("calibration"))
        camera, intrinsics, quality = (calibration[name] for name in ("camera", "intrinsics", "quality"))
        camera["firmware"] = document.pop("firmware")
        del calibration["K"], intrinsics["image_size"]
        if quality is not None:
            std = {name: float(value) for name, value in quality["std"].items()}
            known = [name for name in PARAMETERS if name in std]
            quality["std"] = {name: std[name] for name in [*known, *sorted(std.keys() - {*PARAMETERS})]}
        if self.calibration.provenance == UNSTATED:
            calibration["provenance"] = None
        extensions = cast("dict[str, Json]", document.pop("extensions"))
        members = document | calibration | {"digest": digest(self.calibration, self.sensor, self.rig)}
        ordered = {name: members.pop(name) for name in ORDER} | members
        for path, value in extensions.items():
            block, _, key = path.rpartition("/")
            cast("dict[str, Json]", ordered[block] if block else ordered)[key] = value
        return ordered

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        """Convert the form of the file to the fields of an entry; values of a wrong type are left unchanged.

        Raises:
            InputError: a value is missing or out of bounds. The schema gives a better message.
        """
        extensions = _take_extensions(document)
        document.pop("digest", None)
        calibration = {name: document.pop(name) for name in Calibration.__struct_fields__ if name in document}
        made = calibration.get("provenance")
        if isinstance(made, dict) and made.get("kind") in NO_SOURCES:
            raise InputError("does not name a source", place="provenance.kind")
        calibration["provenance"] = made if made is not None else {"kind": UNSTATED.kind}
        if calibration.get("grade") in (Grade.PRIOR.value, Grade.SEED.value):
            raise InputError("is a guess", place="grade")
        if isinstance(camera := calibration.get("camera"), dict):
            document["firmware"] = camera.pop("firmware", None)
            if not camera.get("make") or not camera.get("model") or camera.get("image_size") is None:
                raise InputError("expected make, model and image_size", place="camera")
            if isinstance(intrinsics := calibration.get("intrinsics"), dict):
                if "image_size" in intrinsics:
                    raise InputError("the image size is stated in camera only", place="intrinsics.image_size")
                calibration["intrinsics"] = intrinsics | {"image_size": camera["image_size"]}
        return document | {"calibration": calibration, "extensions": extensions}

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
        """Return the schema of the file's form from that of the fields; the parts are changed in place."""
        members, lifted = schema["properties"], defs.pop("Calibration")["properties"]
        del members["calibration"], members["extensions"], lifted["K"]
        camera, provenance = defs["CameraKey"], defs["Provenance"]
        camera["properties"]["firmware"] = members.pop("firmware")
        camera["required"] = ["make", "model", "image_size"]
        for name in camera["required"]:
            camera["properties"][name]["type"] = camera["properties"][name]["type"][0]
        del defs["Intrinsics"]["properties"]["image_size"]
        defs["Intrinsics"]["required"].remove("image_size")
        members["digest"] = {
            "type": "string",
            "pattern": "^sha256:[0-9a-f]{64}$",
            "description": "over image_size, intrinsics, distortion, sensor and uncertainty",
        }
        members |= lifted
        members["grade"] = {"enum": [grade.value for grade in Grade if grade.is_metric]}
        defs.pop("Grade")
        members["provenance"] = {"anyOf": [lifted["provenance"], {"type": "null"}]}
        narrow({"properties": members}, defs, LIMITS)
        provenance["properties"]["kind"]["not"] = {"enum": list(NO_SOURCES)}
        provenance["allOf"] = [
            _traced(kind, names, provenance["properties"]) for kind, names in TRACED_BY.items()
        ]
        for part in (schema, camera, defs["Sensor"], defs["Quality"], provenance):
            part["patternProperties"] = {"^x-": {}}
        return schema | {
            "required": ["schema", "camera", "intrinsics", "grade"],
            "properties": {name: members[name] for name in [*ORDER, *(members.keys() - {*ORDER})]},
        }

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
        _require_entry_values(self.calibration)
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

    @property
    def as_draft(self) -> Self:
        """The entry as its file says it, which holds no status."""
        return replace(self, status=Status.DRAFT, reason=None)

    @property
    def made_for(self) -> str | None:
        """Firmware with which the calibration was made, else the range of the entry, in words; None if unknown."""
        ranged = str(self.firmware) if self.firmware is not None else None
        return self.calibration.provenance.firmware or ranged

    def is_of_firmware(self, version: str) -> bool:
        """Whether it was made with a firmware, or one whose number begins with it; else whether its range covers it."""
        made_with = self.calibration.provenance.firmware
        if made_with == version:
            return True
        if made_with is not None:
            # Text that is not a version number, such as the name of an editor, leaves the decision to the range.
            with suppress(InputError):
                if begins_with(made_with, version):
                    return True
        try:
            return self.firmware is not None and self.firmware.covers(version)
        except InputError:
            return False


BEFORE: Final = {"pass": "fixed", "provisional": "start", "refuse": "none"}
"""Today's word for each of those that verdicts had."""


class Seal(Struct, frozen=True, kw_only=True):
    """The verdict on a calibration, sealed in its entry.

    The seal names the digest of the numbers that were judged, so that it says nothing of another K in its place.

    Attributes:
        verdict: fixed, start or none.
        reasons: names of the rules behind it.
    """

    verdict: str
    reasons: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether the calibration may be kept fixed; any other is a start at most."""
        return self.verdict == "fixed"

    @property
    def is_usable(self) -> bool:
        """Whether the calibration may be used at all."""
        return self.verdict in {"fixed", "start"}

    def __str__(self) -> str:
        why = f" ({', '.join(self.reasons)})" if self.reasons and not self.passed else ""
        said = "may be kept fixed" if self.passed else "is a start only" if self.is_usable else "was refused"
        return f"its calibration {said}{why}"


def seal(
    calibration: Calibration, verdict: str, reasons: list[str], how: Mapping[str, YamlValue]
) -> dict[str, YamlValue]:
    """Return the entry's block on a calibration: the verdict on its numbers, and how it was made."""
    return {"verdict": verdict, "reasons": [*reasons], "digest": digest(calibration), **how}


def sealed(entry: Entry) -> Seal | None:
    """Return the verdict on an entry's calibration; None if nobody judged it, or another K was judged.

    A verdict in the calibration's notes counts as well: entries had no other before they were sealed.
    """
    block = entry.extensions.get(VERDICT_BLOCK)
    said = block if isinstance(block, dict) and "verdict" in block else {}
    if "digest" in said and said["digest"] != digest(entry.calibration):
        said = {}
    verdict = entry.calibration.shortfall or said.get("verdict")
    reasons = said.get("reasons")
    return (
        Seal(
            verdict=BEFORE.get(str(verdict), str(verdict)),
            reasons=tuple(map(str, reasons)) if isinstance(reasons, list) else (),
        )
        if verdict is not None
        else None
    )


def noted(entry: Entry) -> Calibration:
    """Return an entry's calibration, whose notes state the verdict if it did not pass."""
    found, calibration = sealed(entry), entry.calibration
    if found is None or found.passed or calibration.shortfall is not None:
        return calibration
    said = (
        f"{found.verdict}: {Calibration.SHORT}",
        *(f"{rule}: of its calibration" for rule in found.reasons),
    )
    return replace(calibration, notes=(*said, *calibration.notes))
