"""The shape of an entry's file, beside the shape an Entry has in memory.

The file is flat for the people who review it: the calibration's members stand at its top, the image size is said once,
in ``camera``, and so is the range of firmware; ``x-`` fields lie in the blocks they are of, and a digest seals the
numbers. What an entry asks of the values in it beyond what every calibration does is here too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, cast

from calibrary.calibration import Calibration, Grade, Provenance
from calibrary.errors import InputError
from calibrary.records import Json, Meta
from calibrary.records.limits import Limits, first_breach, narrow
from calibrary.registry.digest import digest

if TYPE_CHECKING:
    from calibrary.registry.entry import Entry

__all__ = ["BLOCKS_WITH_EXTENSIONS", "PARAMETERS", "UNSTATED", "read", "schema", "written"]

UNSTATED: Final = Provenance(kind="unstated")
"""The provenance of an entry whose file names none."""

BLOCKS_WITH_EXTENSIONS: Final = ("camera", "sensor", "quality", "provenance")
"""Blocks that take ``x-`` fields beside the file itself; K and distortion take none."""

ORDER: Final = ("schema", "status", "reason", "digest", "camera", "intrinsics", "distortion", "sensor", "grade",
    "quality", "provenance", "aliases", "validity", "tolerance", "supersedes", "notes", "extras")  # fmt: skip
"""The blocks of a file from its top; one that is not named here comes behind them."""

PARAMETERS: Final = ("fx", "fy", "cx", "cy", "skew")
"""The intrinsics in the order of the file."""

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
"""Kinds of provenance that say nothing of where a calibration is from."""

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
"""What it takes to trace a calibration back, by the kind of its provenance; a date may be unknown."""


def written(document: dict[str, Json], entry: Entry) -> dict[str, Json]:
    """The file's form of an entry, from its fields."""
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
    members = document | calibration | {"digest": digest(entry.calibration, entry.sensor)}
    ordered = {name: members.pop(name) for name in ORDER} | members
    for path, value in extensions.items():
        block, _, key = path.rpartition("/")
        cast("dict[str, Json]", ordered[block] if block else ordered)[key] = value
    return ordered


def read(document: dict[str, Json]) -> dict[str, Json]:
    """The fields of an entry from its file's form; what has the wrong type is left as it is.

    Raises:
        InputError: something is absent or out of bounds. The schema says it better.
    """
    if "status" not in document:
        raise InputError("lacks status")
    if (path := first_breach(document, LIMITS)) is not None:
        raise InputError("is out of its bounds", place=path)
    extensions = _take_extensions(document)
    document.pop("digest", None)
    calibration = {name: document.pop(name) for name in Calibration.__struct_fields__ if name in document}
    _check_provenance(calibration.setdefault("provenance", None))
    if calibration["provenance"] is None:
        calibration["provenance"] = {"kind": UNSTATED.kind}
    if calibration.get("grade") in (Grade.PRIOR.value, Grade.SEED.value):
        raise InputError("is a guess", place="grade")
    if isinstance(camera := calibration.get("camera"), dict):
        document["firmware"] = camera.pop("firmware", None)
        if not camera.get("make") or not camera.get("model") or camera.get("image_size") is None:
            raise InputError("wanted make, model and image_size", place="camera")
        if isinstance(intrinsics := calibration.get("intrinsics"), dict):
            if "image_size" in intrinsics:
                raise InputError("the image size is said in camera alone", place="intrinsics.image_size")
            calibration["intrinsics"] = intrinsics | {"image_size": camera["image_size"]}
    return document | {"calibration": calibration, "extensions": extensions}


def _take_extensions(document: dict[str, Json]) -> dict[str, Json]:
    """The ``x-`` fields, taken out of the document and its blocks, which are copied."""
    found = {name: document.pop(name) for name in [*document] if name.startswith("x-")}
    for block in BLOCKS_WITH_EXTENSIONS:
        if isinstance(inner := document.get(block), dict):
            found |= {f"{block}/{name}": value for name, value in inner.items() if name.startswith("x-")}
            document[block] = {name: value for name, value in inner.items() if not name.startswith("x-")}
    return found


def _check_provenance(provenance: Json) -> None:
    if not isinstance(provenance, dict):
        return
    kind = provenance.get("kind")
    if kind in NO_SOURCES:
        raise InputError("is no source", place="provenance.kind")
    missing = [name for name in TRACED_BY.get(str(kind), ()) if not provenance.get(name)]
    if missing:
        raise InputError(f"lacks {', '.join(missing)}", place="provenance")


def schema(schema: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
    """The schema of the file's form, from that of the fields; the parts are changed in place."""
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
    """What a provenance of one kind has to say."""
    stated = {
        name: {"type": "array", "minItems": 1} if members[name]["type"] == "array" else {"type": "string"}
        for name in names
    }
    return {
        "if": {"properties": {"kind": {"const": kind}}},
        "then": {"required": list(names), "properties": stated},
    }
