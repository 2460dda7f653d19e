"""What is known of a camera before any image of it is read: the type the catalogue and the registry share."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Final, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.records import Json, Meta, Record
from calibrary.records.limits import require_declared

__all__ = [
    "BANDS",
    "HEX_DIGITS",
    "SERIAL_HASH_DIGITS",
    "SUB_CAMERAS",
    "KnownCamera",
    "Name",
    "Projection",
    "SensorWidth",
    "Text",
    "hash_serial",
    "is_serial_hash",
    "normalise_sub_camera",
]

VISIBLE: Final = frozenset({"rgb", "wide", "zoom", "medium-tele", "tele"})
"""Sub-cameras that take colour pictures; "rgb" is what a tag says when it does not say which of them."""

BANDS: Final = frozenset({"blue", "green", "red", "red-edge", "nir", "panchromatic"})

SUB_CAMERAS: Final = VISIBLE | BANDS | {"thermal", "multispectral"}
"""The common vocabulary; any other word is an unknown tag."""

_SPELLINGS: Final = {
    "rgb": "rgb visible visual vis color colour truecolor truecolour eo",
    "wide": "wide wideangle",
    "zoom": "zoom",
    "medium-tele": "mediumtele mediumtelephoto",
    "tele": "tele telephoto",
    "thermal": "thermal infrared ir lwir tir",
    "multispectral": "multispectral",
    "blue": "blue",
    "green": "green gre",
    "red": "red",
    "red-edge": "rededge reg re",
    "nir": "nir nearinfrared",
    "panchromatic": "panchromatic panchro pan",
}
_WORDS: Final = {text: word for word, texts in _SPELLINGS.items() for text in texts.split()}
_LONGEST_TEXT: Final = 200
_LONGEST_WORD: Final = 48


SERIAL_HASH_DIGITS: Final = 16
"""64 bits: two of a million cameras share a hash with a chance of 3e-8."""

HEX_DIGITS: Final = frozenset("0123456789abcdef")


def hash_serial(make: str | None, serial: str) -> str:
    """What stands for a serial number wherever anything is written down.

    Two makers may number alike, so the maker is part of it. It keeps the number from readers of a registry;
    anyone who can list every serial number of a maker can still find it.
    """
    import hashlib  # noqa: PLC0415  it loads OpenSSL, which a look into the catalogue does not need

    digest = hashlib.sha256(b"calibrary serial\0" + (make or "").encode() + b"\0" + serial.encode())
    return digest.hexdigest()[:SERIAL_HASH_DIGITS]


def is_serial_hash(serial: str) -> bool:
    """Whether this has the form of :func:`hash_serial`'s result."""
    return len(serial) == SERIAL_HASH_DIGITS and set(serial) <= HEX_DIGITS


def normalise_sub_camera(text: str) -> str | None:
    """The common word for what a tag calls a sub-camera or band.

    DJI's ImageSource ("WideCamera", "InfraredCamera"), Skydio's and FLIR's CameraSource ("COLOR", "IR") and
    every maker's BandName ("Red edge", "RedEdge", "REG", "LWIR") come down to one vocabulary
    (:data:`SUB_CAMERAS`). A word outside it stays apart, lower-cased and joined by hyphens, so that two
    cameras never fall together because neither was understood: "Blue-444" is not "Blue".

    Returns:
        None when the text holds no letter or digit.
    """
    text = text[:_LONGEST_TEXT]
    parts = text.split(",")
    if len(parts) > 1 and {"red", "green", "blue"} <= {normalise_sub_camera(part) for part in parts}:
        return "rgb"
    lowered = text.lower()
    squeezed = "".join(c for c in lowered if c.isalnum())
    word = _WORDS.get(squeezed) or _WORDS.get(squeezed.removesuffix("camera"))
    if word is not None:
        return word
    spaced = "".join(c if c.isalnum() else " " for c in lowered)
    return "-".join(spaced.split())[:_LONGEST_WORD].strip("-") or None


class Projection(StrEnum):
    """How the lens maps the world; only a perspective camera has a pinhole K."""

    PERSPECTIVE = "perspective"
    FISHEYE = "fisheye"


CLAIMS: Final = ("native_size", "pitch_um", "sensor_width_mm", "focal_mm", "zoom_mm", "focal_35mm", "projection",
    "fx_over_w", "spread", "exif_focal_trusted", "exif_zoom_trusted")  # fmt: skip
"""The fields that are written beside their source, ``{value: 2.4, source: "data sheet"}``, and left out without one."""

NEEDS: Final = {"spread": "fx_over_w", "zoom_mm": "focal_mm"}
"""Fields that mean nothing without another."""

Name: TypeAlias = Annotated[str, Meta(min_length=1, max_length=100, pattern=r"^\S(.*\S)?$")]
Text: TypeAlias = Annotated[str, Meta(min_length=1, max_length=500)]
Millimetres: TypeAlias = Annotated[float, Meta(gt=0, le=10_000)]
Pixels: TypeAlias = Annotated[int, Meta(ge=1, le=100_000)]
SubCamera: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": sorted(SUB_CAMERAS)})]
Band: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": sorted(BANDS | {"rgb"})})]
Once = Meta(extra_json_schema={"uniqueItems": True})


class SensorWidth(Struct, frozen=True):
    """Width of a camera's sensor as public databases list it by name: evidence, never a K by itself.

    Attributes:
        mm: width of the longer side.
        source: the databases, in words.
    """

    mm: float
    source: str


class KnownCamera(Record):
    """One camera of the catalogue: a body, sub-camera and lens at its native image size.

    Attributes:
        make: EXIF Make.
        title: what people call it.
        models: every spelling of EXIF Model that was seen.
        other_makes: what EXIF Make says besides ``make``.
        sub_camera: only where one Model has several cameras; None where the Model is one camera, or several that
            are alike.
        bands: the bands of a multispectral head that this entry describes alike.
        lens: only where the lens comes off.
        native_size: width and height of the full frame in px.
        pitch_um: pixel pitch at the native size in µm.
        sensor_width_mm: only where no source gives the native size, so that no pitch follows.
        focal_mm: nominal focal length; of a zoom lens, the one that ``fx_over_w`` is of.
        zoom_mm: shortest and longest focal length of a zoom lens.
        focal_35mm: EXIF FocalLengthIn35mmFilm as this camera writes it.
        projection: perspective where absent.
        fx_over_w: expected fx / W at the native size; of a fisheye, on the axis.
        spread: half-width, as a fraction, within which units and sources lie.
        exif_focal_trusted: False where this camera is known to write a wrong FocalLength.
        exif_zoom_trusted: False where this camera is known to write a DigitalZoomRatio that its images do not have.
        conflicts: what the sources disagree about, with the numbers.
        notes: what else to know.
        sources: where each number is from, by field name.

    Raises:
        InputError: a word is not in the vocabulary, something is named twice, or a field lacks one that it needs.
    """

    make: Name
    title: Name
    models: Annotated[tuple[Name, ...], Meta(min_length=1), Once]
    other_makes: Annotated[tuple[Name, ...], Once] = ()
    sub_camera: SubCamera | None = None
    bands: Annotated[tuple[Band, ...], Once] = ()
    lens: Name | None = None
    native_size: tuple[Pixels, Pixels] | None = None
    pitch_um: Annotated[float, Meta(gt=0.1, le=100)] | None = None
    sensor_width_mm: Annotated[float, Meta(gt=0, le=200)] | None = None
    focal_mm: Millimetres | None = None
    zoom_mm: tuple[Millimetres, Millimetres] | None = None
    focal_35mm: Millimetres | None = None
    projection: Projection = Projection.PERSPECTIVE
    fx_over_w: Annotated[float, Meta(gt=0.05, le=50)] | None = None
    spread: Annotated[float, Meta(gt=0, le=0.5)] | None = None
    exif_focal_trusted: bool = True
    exif_zoom_trusted: bool = True
    conflicts: Annotated[tuple[Text, ...], Once] = ()
    notes: Annotated[tuple[Text, ...], Once] = ()
    sources: tuple[tuple[str, Text], ...] = ()

    def __post_init__(self) -> None:
        require_declared(self)
        if self.sub_camera is not None and self.sub_camera not in SUB_CAMERAS:
            raise InputError(f"{self.sub_camera!r:.60} is not a sub-camera", place="sub_camera")
        if not BANDS | {"rgb"} >= {*self.bands}:
            raise InputError("names a band that is not known", place="bands")
        for name in ("models", "other_makes", "bands", "conflicts", "notes"):
            if len({*(said := getattr(self, name))}) < len(said):
                raise InputError("names something twice", place=name)
        for name, needed in NEEDS.items():
            if getattr(self, name) is not None and getattr(self, needed) is None:
                raise InputError(f"is stated without {needed}", place=name)

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        del document["sources"]
        claims = {name: document.pop(name) for name in CLAIMS}
        stated: dict[str, Json] = {
            name: {"value": claims[name], "source": source} for name, source in self.sources
        }
        return document | stated

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        if "sources" in document:
            raise InputError("is not a key", place="sources")
        sources: list[Json] = []
        for name, claim in document.items():
            if name in CLAIMS:
                if (
                    not isinstance(claim, dict)
                    or claim.keys() != {"value", "source"}
                    or claim["value"] is None
                ):
                    raise InputError("is not a value with its source", place=name)
                document[name] = claim["value"]
                sources.append([name, claim["source"]])
        return document | {"sources": sources}

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        members = schema["properties"]
        text = members.pop("sources")["items"]["prefixItems"][1]
        for name in CLAIMS:
            value = dict(members[name])
            described = {"description": value.pop("description")}
            if isinstance(value.get("type"), list):
                value["type"] = value["type"][0]
            members[name] = {
                "type": "object",
                "required": ["value", "source"],
                "additionalProperties": False,
                "properties": {"value": value, "source": text},
            } | described
        schema["required"] = [name for name in schema["required"] if name not in {*CLAIMS, "sources"}]
        return schema | {"dependentRequired": {name: [needed] for name, needed in NEEDS.items()}}

    def source(self, field: str) -> str | None:
        """Where one number is from, by its field's name."""
        return next((text for name, text in self.sources if name == field), None)

    def fx_over_w_at(self, focal_mm: float | None) -> float | None:
        """Expected fx / W of the full frame at a focal length; a zoom lens moves it, other lenses do not.

        A body whose lens comes off, or a zoom that only its pitch is known of, has focal length ÷ pitch.

        Args:
            focal_mm: as EXIF tells it, None when it does not.

        Returns:
            None where nothing is expected: no source, or a zoom lens at an unknown or impossible setting.
        """
        if self.fx_over_w is not None and (self.zoom_mm is None or self.focal_mm is None):
            return self.fx_over_w
        if focal_mm is None:
            return None
        if self.zoom_mm is not None and not self.zoom_mm[0] * 0.95 <= focal_mm <= self.zoom_mm[1] * 1.05:
            return None
        if self.fx_over_w is not None and self.focal_mm is not None:
            return self.fx_over_w * focal_mm / self.focal_mm
        if self.pitch_um is None or self.native_size is None:
            return None
        return focal_mm * 1000.0 / self.pitch_um / self.native_size[0]

    def answers(self, sub_camera: str) -> bool:
        """Whether a tag in the common vocabulary names this very camera."""
        return sub_camera == self.sub_camera or sub_camera in self.bands

    def may_answer(self, sub_camera: str) -> bool:
        """Whether a tag in the common vocabulary leaves room for this camera.

        "rgb" says visible, not which; and a Model that is one camera is it whatever its visible camera is
        called. Thermal cameras and bands are never anything else.
        """
        if self.answers(sub_camera):
            return True
        if self.sub_camera is None:
            return sub_camera in VISIBLE
        return {sub_camera, self.sub_camera} <= VISIBLE and "rgb" in {sub_camera, self.sub_camera}
