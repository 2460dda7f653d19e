"""The form of an entry in its file, as opposed to the Entry in memory, and the digest of its numbers.

The file is flat, for reviewers: the members of the calibration are at the top level, the image size and the firmware
range are stated once, in ``camera``, and ``x-`` fields are in the blocks they belong to. This module also contains the
bounds of an entry's values beyond those of any calibration, and the migration of older schema versions.

The digest covers the numbers that belong together: K, distortion, image size, sensor and uncertainty. A text merge can
combine one branch's K with the other's distortion without a conflict, into a camera that was never measured. Since
both branches change the line of the digest, git reports a conflict; and if the parts are combined by hand, reading the
file fails.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

from calibrary.calibration import Calibration, Covariance, Grade, Provenance
from calibrary.errors import InputError, ParseError
from calibrary.records import Json, Meta, to_json
from calibrary.records.limits import Limits, narrow, require_within
from calibrary.rig import RigMember
from calibrary.strictyaml import YamlValue

if TYPE_CHECKING:
    from calibrary.registry.entry import Entry, Sensor

__all__ = [
    "BLOCKS_WITH_EXTENSIONS",
    "CURRENT",
    "MIGRATIONS",
    "PARAMETERS",
    "UNSTATED",
    "digest",
    "migrated",
    "read",
    "require_entry_values",
    "schema",
    "written",
]

UNSTATED: Final = Provenance(kind="unstated")
"""Provenance of an entry with a file that states none."""

BLOCKS_WITH_EXTENSIONS: Final = ("camera", "sensor", "quality", "provenance")
"""Blocks that may contain ``x-`` fields, in addition to the file itself; K and distortion may not."""

ORDER: Final = ("schema", "status", "reason", "digest", "camera", "label", "tags", "intrinsics", "distortion", "sensor",
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


def written(document: dict[str, Json], entry: Entry) -> dict[str, Json]:
    """Convert the fields of an entry to the form of its file."""
    calibration = cast("dict[str, Any]", document.pop("calibration"))
    camera, intrinsics, quality = (calibration[name] for name in ("camera", "intrinsics", "quality"))
    camera["firmware"] = document.pop("firmware")
    del calibration["K"], intrinsics["image_size"]
    if quality is not None:
        std = {name: float(value) for name, value in quality["std"].items()}
        known = [name for name in PARAMETERS if name in std]
        quality["std"] = {name: std[name] for name in [*known, *sorted(std.keys() - {*PARAMETERS})]}
    if entry.calibration.provenance == UNSTATED:
        calibration["provenance"] = None
    extensions = cast("dict[str, Json]", document.pop("extensions"))
    members = document | calibration | {"digest": digest(entry.calibration, entry.sensor, entry.rig)}
    ordered = {name: members.pop(name) for name in ORDER} | members
    for path, value in extensions.items():
        block, _, key = path.rpartition("/")
        cast("dict[str, Json]", ordered[block] if block else ordered)[key] = value
    return ordered


def read(document: dict[str, Json]) -> dict[str, Json]:
    """Convert the form of the file to the fields of an entry; values of a wrong type are left unchanged.

    Raises:
        InputError: a value is missing or out of bounds. The schema gives a better message.
    """
    if "status" not in document:
        raise InputError("lacks status")
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


def _take_extensions(document: dict[str, Json]) -> dict[str, Json]:
    """Remove the ``x-`` fields from the document and (copied) blocks, and return them."""
    found = {name: document.pop(name) for name in [*document] if name.startswith("x-")}
    for block in BLOCKS_WITH_EXTENSIONS:
        if isinstance(inner := document.get(block), dict):
            found |= {f"{block}/{name}": value for name, value in inner.items() if name.startswith("x-")}
            document[block] = {name: value for name, value in inner.items() if not name.startswith("x-")}
    return found


def require_entry_values(calibration: Calibration) -> None:
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


def schema(schema: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
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
        "required": ["schema", "status", "camera", "intrinsics", "grade"],
        "properties": {name: members[name] for name in [*ORDER, *(members.keys() - {*ORDER})]},
    }


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
    if rig is not None:
        # The digest of an entry without a rig stays the same as before rigs were introduced.
        block["rig"] = to_json(rig)
    text = json.dumps(block, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def _numbers(values: Mapping[str, float]) -> dict[str, Json]:
    # Replaces minus zero by zero.
    return {name: float(value) + 0.0 for name, value in values.items()}


def _sides(sensor: Sensor) -> dict[str, float]:
    sides = {"width_mm": sensor.width_mm, "height_mm": sensor.height_mm, "pitch_um": sensor.pitch_um}
    return {name: value for name, value in sides.items() if value is not None}


def _pairs(covariance: Covariance) -> dict[str, float]:
    """Return each element by the names of its row and column, so that the order of the names does not matter."""
    pairs = combinations_with_replacement(covariance.names, 2)
    return {",".join(sorted(pair)): value for pair, value in zip(pairs, covariance.upper, strict=True)}


Document: TypeAlias = "dict[str, YamlValue]"

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
