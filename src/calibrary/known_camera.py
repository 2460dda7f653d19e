"""The key of a camera, and facts about its model before any image is read, for catalogue and registry alike.

This module does not need NumPy.
"""

from __future__ import annotations

import unicodedata
from enum import StrEnum
from functools import lru_cache
from typing import Annotated, Any, Final, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.image_size import ImageSize, same_aspect
from calibrary.records import Json, Meta, Record, replace, require_declared


class CameraKey(Record):
    """Which camera a calibration belongs to. EXIF Model alone is not a key: four sub-cameras may share it.

    Attributes:
        make: as written in EXIF (stripped of padding).
        model: as written in EXIF.
        sub_camera: wide, tele, thermal or a band, if one model has several cameras.
        lens: the lens, if the camera has interchangeable lenses.
        focal_mm: nominal focal length in mm, or that of the zoom.
        capture_mode: what the camera does to the image: "dewarped", "zoom 2x", ….
        image_size: image size that K belongs to, in px.
        serial: serial number of the unit; only its hash is kept.
        firmware: version, as the camera writes it.

    >>> str(calibrary.CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648)))
    'DJI FC6310R 8.8 mm 5472×3648'
    """

    make: str | None = None
    model: str | None = None
    sub_camera: str | None = None
    lens: str | None = None
    focal_mm: float | None = None
    capture_mode: str | None = None
    image_size: ImageSize | None = None
    serial: str | None = None
    firmware: str | None = None

    def __str__(self) -> str:
        make, model = self.make or "", self.model or ""
        # Avoid "Canon Canon PowerShot".
        name = model if make and model.lower().startswith(make.lower()) else f"{make} {model}".strip()
        focal = f"{self.focal_mm:g} mm" if self.focal_mm is not None else None
        size = "{}×{}".format(*self.image_size) if self.image_size else None
        parts = [name or "unknown camera", self.sub_camera, self.lens, focal, self.capture_mode, size]
        return " ".join(part for part in parts if part)


LONGEST_TEXT: Final = 1000
"""Characters of a name that are used; an EXIF string has a few dozen."""
ROUNDS: Final = 4

VISIBLE: Final = frozenset({"rgb", "wide", "zoom", "medium-tele", "tele"})
"""Sub-cameras that take colour images; "rgb" stands for a tag that does not state which of them."""

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
"""64 bits: among a million cameras, the probability that two share a hash is 3e-8."""

HEX_DIGITS: Final = frozenset("0123456789abcdef")


def hash_serial(make: str | None, serial: str) -> str:
    """Return the hash that is written instead of a serial number.

    The make is part of the hash, since two makers may use the same numbers. The hash hides the number from readers of
    a registry, but not from someone who can list all serial numbers of a maker.
    """
    import hashlib  # noqa: PLC0415  it loads OpenSSL, which a look into the catalogue does not need

    digest = hashlib.sha256(b"calibrary serial\0" + (make or "").encode() + b"\0" + serial.encode())
    return digest.hexdigest()[:SERIAL_HASH_DIGITS]


def is_serial_hash(serial: str) -> bool:
    """Return whether ``serial`` has the form of :func:`hash_serial`'s result."""
    return len(serial) == SERIAL_HASH_DIGITS and set(serial) <= HEX_DIGITS


def hashed(camera: CameraKey) -> CameraKey:
    """Replace the serial number in a key by its hash; 16 hexadecimal digits are taken to be a hash already."""
    if not camera.serial or is_serial_hash(camera.serial):
        return camera
    return replace(camera, serial=hash_serial(camera.make, camera.serial))


def normalise_sub_camera(text: str) -> str | None:
    """Return the common word for a tag's name of a sub-camera or band.

    DJI's ImageSource ("WideCamera", "InfraredCamera"), Skydio's and FLIR's CameraSource ("COLOR", "IR") and all
    makers' BandName ("Red edge", "RedEdge", "REG", "LWIR") are reduced to one vocabulary (:data:`SUB_CAMERAS`). A word
    outside the vocabulary is kept, in lower case and joined by hyphens, so that two unknown words stay different
    cameras: "Blue-444" is not "Blue".

    Returns:
        The word; None when the text contains no letter or digit.
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
    """Projection of the lens; only a perspective camera has a pinhole K."""

    PERSPECTIVE = "perspective"
    FISHEYE = "fisheye"


CLAIMS: Final = ("native_size", "sizes", "pitch_um", "sensor_width_mm", "focal_mm", "zoom_mm", "focal_35mm",
    "projection", "fx_over_w", "spread", "readout_ms", "exif_focal_trusted", "exif_zoom_trusted")  # fmt: skip
"""Fields written together with their source, ``{value: 2.4, source: "data sheet"}``; omitted without a source."""

NEEDS: Final = {"spread": "fx_over_w", "zoom_mm": "focal_mm"}
"""Fields that require another field."""

Name: TypeAlias = Annotated[str, Meta(min_length=1, max_length=100, pattern=r"^\S(.*\S)?$")]
Text: TypeAlias = Annotated[str, Meta(min_length=1, max_length=500)]
Millimetres: TypeAlias = Annotated[float, Meta(gt=0, le=10_000)]
Pixels: TypeAlias = Annotated[int, Meta(ge=1, le=100_000)]
SubCamera: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": sorted(SUB_CAMERAS)})]
Band: TypeAlias = Annotated[str, Meta(extra_json_schema={"enum": sorted(BANDS | {"rgb"})})]
Once = Meta(extra_json_schema={"uniqueItems": True})


class SensorWidth(Struct, frozen=True):
    """Sensor width that public databases list for a camera name: evidence, never enough for a K alone.

    Attributes:
        mm: width of the longer side in mm.
        source: names of the databases.
    """

    mm: float
    source: str


class KnownCamera(Record):
    """One camera of the catalogue: a body, sub-camera and lens at its native image size.

    Attributes:
        make: EXIF Make.
        title: common name.
        models: all known spellings of EXIF Model, of every body with this camera; empty if no source states what it
            writes.
        other_makes: values of EXIF Make other than ``make``.
        sub_camera: set only if one Model has several cameras; None if the Model is one camera, or several identical
            ones.
        bands: bands of a multispectral camera head that this entry describes, all with the same values.
        lens: set only for cameras with interchangeable lenses.
        native_size: (width, height) px of the full image.
        sizes: all sizes in px that this camera writes images in, if a source states them; another one was made by a
            program.
        pitch_um: pixel pitch at the native size in µm.
        sensor_width_mm: set only if no source states the native size, so that there is no pixel pitch.
        focal_mm: nominal focal length in mm; for a zoom lens, the one that ``fx_over_w`` refers to.
        zoom_mm: shortest and longest focal length of a zoom lens in mm.
        focal_35mm: EXIF FocalLengthIn35mmFilm as this camera writes it.
        projection: perspective if absent.
        fx_over_w: expected fx / W at the native size; for a fisheye, on the axis.
        spread: relative half-width of the interval that contains units and sources.
        readout_ms: time from the first row of an image to the last with the electronic shutter; 0 for a global one.
        exif_focal_trusted: False if this camera is known to write a wrong FocalLength.
        exif_zoom_trusted: False if this camera is known to write a DigitalZoomRatio that does not apply to its images.
        conflicts: disagreements between the sources, with the values.
        notes: further remarks.
        sources: source of each value, by field name.

    Raises:
        InputError: a word is not in the vocabulary, a name is duplicated, or a field lacks another that it requires.
    """

    make: Name
    title: Name
    models: Annotated[tuple[Name, ...], Once]
    other_makes: Annotated[tuple[Name, ...], Once] = ()
    sub_camera: SubCamera | None = None
    bands: Annotated[tuple[Band, ...], Once] = ()
    lens: Name | None = None
    native_size: tuple[Pixels, Pixels] | None = None
    sizes: Annotated[tuple[tuple[Pixels, Pixels], ...], Once] = ()
    pitch_um: Annotated[float, Meta(gt=0.1, le=100)] | None = None
    sensor_width_mm: Annotated[float, Meta(gt=0, le=200)] | None = None
    focal_mm: Millimetres | None = None
    zoom_mm: tuple[Millimetres, Millimetres] | None = None
    focal_35mm: Millimetres | None = None
    projection: Projection = Projection.PERSPECTIVE
    fx_over_w: Annotated[float, Meta(gt=0.05, le=50)] | None = None
    spread: Annotated[float, Meta(gt=0, le=0.5)] | None = None
    readout_ms: Annotated[float, Meta(ge=0, le=200)] | None = None
    exif_focal_trusted: bool = True
    exif_zoom_trusted: bool = True
    conflicts: Annotated[tuple[Text, ...], Once] = ()
    notes: Annotated[tuple[Text, ...], Once] = ()
    sources: tuple[tuple[str, Text], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Its Models, or its title if no source states one."""
        return self.models or (self.title,)

    @property
    def gives_k(self) -> bool:
        """Whether its focal length in pixels is known, so that the sources in an image are not weighed."""
        return self.pitch_um is not None or self.fx_over_w is not None

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
        """Return the source of a value, by field name."""
        return next((text for name, text in self.sources if name == field), None)

    def fx_over_w_at(self, focal_mm: float | None) -> float | None:
        """Return the expected fx / W of the full image; for a zoom lens, at the given focal length.

        Without ``fx_over_w``, as for a body without its lens, it is focal length ÷ (pixel pitch × width).

        Args:
            focal_mm: EXIF FocalLength in mm; None if not stated.

        Returns:
            The expected value; None if there is no source, or the setting of a zoom lens is unknown or impossible.
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

    def focal_lengths_px(self) -> dict[ImageSize, float]:
        """Return fx of its nominal lens for each image size that it writes, as far as the entry states them."""
        whole, over_width = self.native_size, self.fx_over_w_at(self.focal_mm)
        if whole is None or over_width is None or self.projection is not Projection.PERSPECTIVE:
            return {}
        fx = over_width * whole[0]
        # Another shape is a 1:1 crop of the whole frame; the same shape is the frame resized.
        return {
            size: fx * size[0] / whole[0] if same_aspect(size, whole) else fx
            for size in self.sizes or (whole,)
        }

    def answers(self, sub_camera: str) -> bool:
        """Return whether a tag in the common vocabulary names exactly this camera."""
        return sub_camera == self.sub_camera or sub_camera in self.bands

    def may_answer(self, sub_camera: str) -> bool:
        """Return whether a tag in the common vocabulary is compatible with this camera.

        "rgb" means a visible camera without stating which one. A Model that is a single camera matches any name of a
        visible camera. Thermal cameras and bands match only their own names.
        """
        if self.answers(sub_camera):
            return True
        if self.sub_camera is None:
            return sub_camera in VISIBLE
        return {sub_camera, self.sub_camera} <= VISIBLE and "rgb" in {sub_camera, self.sub_camera}


@lru_cache(maxsize=1 << 14)
def match_key(text: str) -> str:
    """Return the part of a name that counts: letters and digits, without case, width, padding and invisible characters.

    The text ends at its first NUL; control and format characters (writing direction, zero-width joiners) are removed,
    blanks are folded, compatibility forms and letter case are normalised, and × becomes x, as in "zoom 2×".
    """
    key = text[:LONGEST_TEXT].partition("\0")[0]
    for _ in range(ROUNDS):
        folded = _folded(key)
        if folded == key:
            break
        key = folded
    return key


def _folded(text: str) -> str:
    kept = "".join(" " if c.isspace() else c for c in text if c.isspace() or not _is_invisible(c))
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", kept).casefold())
    return " ".join(folded.replace("×", "x").split())


def _is_invisible(character: str) -> bool:
    return unicodedata.category(character) in {"Cc", "Cf"}
