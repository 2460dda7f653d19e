"""What an entry's file says, once the schema has let it through, as an Entry."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from typing import NotRequired, TypedDict

from calibrary.calibration import (
    Calibration,
    CameraKey,
    Covariance,
    Grade,
    ImageSize,
    Intrinsics,
    Provenance,
    Quality,
    SourceFile,
)
from calibrary.distortion import Distortion, distortion_from
from calibrary.errors import InputError
from calibrary.registry.entry import (
    UNSTATED,
    Alias,
    Entry,
    Sensor,
    Status,
    Validity,
)
from calibrary.registry.firmware import FirmwareRange
from calibrary.strictyaml import YamlValue

__all__ = ["EntryDocument", "entry_from"]


class _Range(TypedDict):
    min: NotRequired[str | None]
    max: NotRequired[str | None]


class _Camera(TypedDict):
    make: str
    model: str
    sub_camera: NotRequired[str | None]
    lens: NotRequired[str | None]
    focal_mm: NotRequired[float | None]
    capture_mode: NotRequired[str | None]
    image_size: list[int]
    serial: NotRequired[str | None]
    firmware: NotRequired[_Range | None]


class _Intrinsics(TypedDict):
    fx: float
    fy: float
    cx: float
    cy: float
    skew: NotRequired[float]


class _Sensor(TypedDict):
    width_mm: NotRequired[float | None]
    height_mm: NotRequired[float | None]
    pitch_um: NotRequired[float | None]


class _Covariance(TypedDict):
    names: list[str]
    upper: list[float]


class _Quality(TypedDict):
    rms_px: NotRequired[float | None]
    points: NotRequired[int | None]
    views: NotRequired[int | None]
    std: NotRequired[dict[str, float] | None]
    covariance: NotRequired[_Covariance | None]
    kappa2: NotRequired[float | None]
    coverage: NotRequired[float | None]


class _SourceFile(TypedDict):
    name: str
    sha256: str


class _Provenance(TypedDict):
    kind: str
    source: NotRequired[str | None]
    tag: NotRequired[str | None]
    reference_size: NotRequired[list[int] | None]
    adaptation: NotRequired[str | None]
    assumptions: NotRequired[list[str]]
    sha256: NotRequired[str | None]
    sources: NotRequired[list[_SourceFile]]
    tool: NotRequired[str | None]
    date: NotRequired[str | None]
    operator: NotRequired[str | None]
    firmware: NotRequired[str | None]
    focus: NotRequired[str | None]


class _Alias(TypedDict):
    make: str
    model: str


_Validity = TypedDict("_Validity", {"from": NotRequired[str | None], "until": NotRequired[str | None]})


class EntryDocument(TypedDict):
    """schemas/entry-1.schema.json, as far as the reader needs it; ``x-`` fields come beside."""

    status: str
    reason: NotRequired[str | None]
    digest: NotRequired[str]
    camera: _Camera
    intrinsics: _Intrinsics
    distortion: NotRequired[dict[str, str | float] | None]
    sensor: NotRequired[_Sensor | None]
    grade: str
    quality: NotRequired[_Quality | None]
    provenance: NotRequired[_Provenance | None]
    aliases: NotRequired[list[_Alias]]
    validity: NotRequired[_Validity | None]
    tolerance: NotRequired[float | None]
    supersedes: NotRequired[str | None]
    notes: NotRequired[list[str]]
    extras: NotRequired[dict[str, str]]


def entry_from(document: EntryDocument, extensions: Mapping[str, YamlValue]) -> Entry:
    """The entry of a document that keeps to the schema.

    Raises:
        InputError: the numbers are no camera's, or a range has its ends the wrong way round.
    """
    camera, quality = document["camera"], document.get("quality")
    firmware = camera.get("firmware")
    size = camera["image_size"][0], camera["image_size"][1]
    return Entry(
        calibration=Calibration(
            camera=_key(camera, size),
            intrinsics=_intrinsics(document["intrinsics"], size),
            distortion=_distortion(document.get("distortion")),
            grade=Grade(document["grade"]),
            quality=_quality(quality) if quality is not None else None,
            provenance=_provenance(document.get("provenance")),
            notes=tuple(document.get("notes", ())),
            extras=tuple(document.get("extras", {}).items()),
        ),
        status=Status(document["status"]),
        reason=document.get("reason"),
        firmware=FirmwareRange(min=firmware.get("min"), max=firmware.get("max")) if firmware else None,
        aliases=tuple(Alias(make=a["make"], model=a["model"]) for a in document.get("aliases", ())),
        sensor=_sensor(document.get("sensor")),
        validity=_validity(document.get("validity")),
        tolerance=_float(document.get("tolerance")),
        supersedes=document.get("supersedes"),
        extensions=extensions,
    )


def _key(camera: _Camera, size: ImageSize) -> CameraKey:
    return CameraKey(
        make=camera["make"],
        model=camera["model"],
        sub_camera=camera.get("sub_camera"),
        lens=camera.get("lens"),
        focal_mm=_float(camera.get("focal_mm")),
        capture_mode=camera.get("capture_mode"),
        image_size=size,
        serial=camera.get("serial"),
    )


def _intrinsics(K: _Intrinsics, size: ImageSize) -> Intrinsics:
    return Intrinsics(
        fx=K["fx"], fy=K["fy"], cx=K["cx"], cy=K["cy"], skew=K.get("skew", 0.0), image_size=size
    )


def _distortion(value: Mapping[str, str | float] | None) -> Distortion | None:
    if value is None:
        return None
    coefficients = {name: float(number) for name, number in value.items() if name != "model"}
    return distortion_from(str(value["model"]), coefficients)


def _sensor(value: _Sensor | None) -> Sensor | None:
    if value is None:
        return None
    return Sensor(
        width_mm=value.get("width_mm"), height_mm=value.get("height_mm"), pitch_um=value.get("pitch_um")
    )


def _quality(value: _Quality) -> Quality:
    covariance = value.get("covariance")
    return Quality(
        rms_px=_float(value.get("rms_px")),
        points=value.get("points"),
        views=value.get("views"),
        std={name: float(std) for name, std in (value.get("std") or {}).items()},
        covariance=Covariance(names=tuple(covariance["names"]), upper=tuple(covariance["upper"]))
        if covariance is not None
        else None,
        kappa2=_float(value.get("kappa2")),
        coverage=_float(value.get("coverage")),
    )


def _provenance(value: _Provenance | None) -> Provenance:
    if value is None:
        return UNSTATED
    size = value.get("reference_size")
    return Provenance(
        kind=value["kind"],
        source=value.get("source"),
        tag=value.get("tag"),
        reference_size=(size[0], size[1]) if size is not None else None,
        adaptation=value.get("adaptation"),
        assumptions=tuple(value.get("assumptions", ())),
        sha256=value.get("sha256"),
        sources=tuple(SourceFile(name=f["name"], sha256=f["sha256"]) for f in value.get("sources", ())),
        tool=value.get("tool"),
        date=value.get("date"),
        operator=value.get("operator"),
        firmware=value.get("firmware"),
        focus=value.get("focus"),
    )


def _validity(value: _Validity | None) -> Validity | None:
    if value is None:
        return None
    return Validity(first=_day(value.get("from")), last=_day(value.get("until")))


def _day(text: str | None) -> date | None:
    try:
        return date.fromisoformat(text) if text is not None else None
    except ValueError:
        raise InputError(f"{text} is no day of the calendar", place="validity") from None


def _float(value: float | None) -> float | None:
    return float(value) if value is not None else None
