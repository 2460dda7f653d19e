"""Reading a registry's entries from its folder: ``cameras/<make>/<model>/…/<variant>.yaml``, one camera a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TypeGuard, cast

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import Distortion, distortion_from
from calibrary.errors import InputError, ParseError, RegistryError
from calibrary.evidence.frame import adapt
from calibrary.evidence.metadata import ImageMetadata
from calibrary.schemas import require
from calibrary.strictyaml import YamlValue, line_of, load_yaml

__all__ = ["Entry", "Status", "read_entries", "resolve"]

LARGEST_ENTRY = 1 << 20
FOCAL_TOLERANCE = 0.02


class Status(StrEnum):
    """Whether an entry may be used."""

    DRAFT = "draft"
    APPROVED = "approved"
    HELD = "held"
    RETIRED = "retired"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One camera of the registry.

    Attributes:
        path: below the registry's root.
        status: only approved and held entries are used.
        calibration: K in the canonical origin, distortion apart.
    """

    path: str
    status: Status
    calibration: Calibration

    @property
    def is_usable(self) -> bool:
        """Whether somebody answers for it; a held entry is one a person pinned."""
        return self.status in {Status.APPROVED, Status.HELD}


def read_entries(root: Path) -> tuple[Entry, ...]:
    """Every entry of a registry's working tree, in the order of their paths.

    Raises:
        RegistryError: there is no registry here, or an entry cannot be read.
    """
    cameras = root / "cameras"
    if not cameras.is_dir():
        raise RegistryError(
            f"{root}: no registry here: wanted a folder 'cameras' with one YAML file a camera"
        )
    entries = []
    for path in sorted(cameras.rglob("*.yaml")):
        name = path.relative_to(root).as_posix()
        try:
            if path.is_symlink() or not path.is_file() or path.stat().st_size > LARGEST_ENTRY:
                raise RegistryError(f"{name}: wanted a regular file of at most 1 MiB")
            entries.append(parse_entry(path.read_bytes(), name))
        except (InputError, OSError) as error:
            raise RegistryError(str(error)) from None
    return tuple(entries)


def parse_entry(data: bytes, name: str) -> Entry:
    """Read one entry.

    Raises:
        ParseError: it is no YAML, or breaks schemas/entry-1.schema.json.
        InputError: its numbers are no camera's.
    """
    value = load_yaml(data, source=name)
    require(value, "entry-1", source=name, locate=partial(line_of, data))
    document = cast("dict[str, YamlValue]", value)
    camera, numbers = _mapping(document, "camera", name), _mapping(document, "intrinsics", name)
    size = _size(camera.get("image_size"), name)
    try:
        intrinsics = Intrinsics(
            **{key: _number(numbers[key], name) for key in ("fx", "fy", "cx", "cy")},
            skew=_number(numbers.get("skew", 0.0), name),
            image_size=size,
        )
        distortion = _distortion(document.get("distortion"), name)
    except InputError as error:
        raise type(error)(error.message, source=name) from None
    calibration = Calibration(
        camera=CameraKey(
            make=_text(camera.get("make")),
            model=_text(camera.get("model")),
            sub_camera=_text(camera.get("sub_camera")),
            lens=_text(camera.get("lens")),
            focal_mm=_number(camera["focal_mm"], name) if camera.get("focal_mm") is not None else None,
            capture_mode=_text(camera.get("capture_mode")),
            image_size=size,
            serial=_text(camera.get("serial")),
            firmware=_text(camera.get("firmware")),
        ),
        intrinsics=intrinsics,
        distortion=distortion,
        grade=Grade(str(document["grade"])),
        provenance=Provenance(kind="registry", source=name),
    )
    return Entry(path=name, status=Status(str(document["status"])), calibration=calibration)


def resolve(entries: Sequence[Entry], key: CameraKey) -> Calibration | None:
    """The most specific usable entry for a camera, brought to its image size.

    An entry's field that is absent fits every camera; one that is there must be equal. Of the entries that
    fit, the one that states most wins.

    Raises:
        RegistryError: two entries fit equally well; the message names both.
    """
    fitting = [(entry, K) for entry in entries if entry.is_usable and (K := _adapted(entry, key)) is not None]
    if not fitting:
        return None
    best = max(_specificity(entry) for entry, _ in fitting)
    chosen = [(entry, K) for entry, K in fitting if _specificity(entry) == best]
    if len(chosen) > 1:
        names = ", ".join(entry.path for entry, _ in chosen)
        raise RegistryError(f"{len(chosen)} entries fit {key} equally well: {names}; retire all but one")
    return chosen[0][1]


def _adapted(entry: Entry, key: CameraKey) -> Calibration | None:
    if not _fits(entry.calibration.camera, key) or key.image_size is None:
        return None
    try:
        adapted = adapt(entry.calibration.intrinsics, ImageMetadata(size=key.image_size))
    except InputError:
        return None
    provenance = replace(
        entry.calibration.provenance,
        reference_size=adapted.reference_size,
        adaptation="; ".join(adapted.steps) or None,
        assumptions=adapted.assumptions,
    )
    return replace(entry.calibration, camera=key, intrinsics=adapted.intrinsics, provenance=provenance)


def _fits(entry: CameraKey, key: CameraKey) -> bool:
    for name in ("make", "model", "sub_camera", "lens", "capture_mode", "serial", "firmware"):
        stated, seen = getattr(entry, name), getattr(key, name)
        if stated is not None and (seen is None or stated.casefold() != seen.casefold()):
            return False
    # A frame the camera changed (dewarped, zoomed) is another camera unless the entry says it is this one.
    if key.capture_mode is not None and entry.capture_mode is None:
        return False
    if entry.model is None:
        return False
    if entry.focal_mm is None or key.focal_mm is None:
        return True
    return abs(key.focal_mm / entry.focal_mm - 1.0) <= FOCAL_TOLERANCE


def _specificity(entry: Entry) -> tuple[bool, ...]:
    camera = entry.calibration.camera
    order = (camera.serial, camera.firmware, camera.lens, camera.focal_mm, camera.sub_camera)
    return tuple(field is not None for field in order)


def _distortion(value: YamlValue, name: str) -> Distortion | None:
    if value is None:
        return None
    if not isinstance(value, dict):
        raise ParseError("distortion is no mapping", source=name)
    coefficients = {key: _number(number, name) for key, number in value.items() if key != "model"}
    return distortion_from(str(value["model"]), coefficients)


def _mapping(document: dict[str, YamlValue], key: str, name: str) -> dict[str, YamlValue]:
    value = document[key]
    if not isinstance(value, dict):
        raise ParseError(f"{key} is no mapping", source=name)
    return value


def _number(value: YamlValue, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParseError(f"found {value!r}, wanted a number", source=name)
    return float(value)


def _size(value: YamlValue, name: str) -> ImageSize:
    if _is_pair(value):
        return int(value[0]), int(value[1])
    raise ParseError(f"image_size is {value!r}, wanted [width, height]", source=name)


def _is_pair(value: YamlValue) -> TypeGuard[list[int]]:
    return isinstance(value, list) and len(value) == 2 and all(type(side) is int for side in value)


def _text(value: YamlValue) -> str | None:
    return str(value) if value is not None else None
