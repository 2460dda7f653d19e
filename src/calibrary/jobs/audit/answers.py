"""The registry's answer for a camera that flew: an entry to use, an entry that must not be used, or none."""

from __future__ import annotations

from datetime import date
from enum import StrEnum

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import AmbiguousEntryError, RegistryError
from calibrary.jobs.audit.flights import Flown
from calibrary.jobs.audit.rules import Rule
from calibrary.registry.entry import Status
from calibrary.registry.paths import id_of
from calibrary.registry.resolution import RegistryIndex, Resolution
from calibrary.validation import Finding, Severity

__all__ = ["Answer", "Use", "answer_to", "named", "unit_name"]

MOST_NEAR = 3


class Use(StrEnum):
    """Whether there is an entry to use."""

    USED = "used"
    EXPIRED = "expired"
    DRAFT = "draft"
    RETIRED = "retired"
    NONE = "none"


class Answer(Struct, frozen=True, kw_only=True):
    """A camera that flew, and the registry's answer for it.

    Attributes:
        flown: the camera.
        use: whether the entry may be used.
        resolution: the entry at the images' size; None if there is none.
        finding: what is wrong with the answer, or None.
    """

    flown: Flown
    use: Use
    resolution: Resolution | None = None
    finding: Finding | None = None

    @property
    def entry_id(self) -> str | None:
        """The entry's id."""
        return id_of(self.resolution.path) if self.resolution is not None else None


def named(flown: Flown) -> str:
    """The camera in words, with its unit and firmware."""
    key = flown.key
    label = f"{flown.label}, " if flown.label is not None else ""
    unit = f", unit {key.serial[:8]}" if key.serial is not None else ""
    firmware = f", firmware {key.firmware}" if key.firmware is not None else ""
    return f"{label}{key}{unit}{firmware}"


def unit_name(camera: CameraKey, label: str | None) -> str:
    """A unit in words: its label, its camera, and the first digits of the hash of its serial number."""
    model = (
        " ".join(text for text in (camera.make, camera.model, camera.sub_camera) if text) or "unnamed camera"
    )
    called = f"{label}, " if label is not None else ""
    return f"{called}{model}" + (f", unit {camera.serial[:8]}" if camera.serial is not None else "")


def answer_to(flown: Flown, index: RegistryIndex, today: date) -> Answer:
    """Resolve a camera in the registry for the last day on which it flew."""
    key = flown.key
    if not key.make or not key.model:
        return Answer(flown=flown, use=Use.NONE, finding=_nameless(flown))
    try:
        found = index.resolve(key, on=flown.last or today)
        if found is not None:
            return Answer(flown=flown, use=Use.USED, resolution=found)
        for use, statuses in (
            (Use.EXPIRED, None),
            (Use.DRAFT, {Status.DRAFT}),
            (Use.RETIRED, {Status.RETIRED}),
        ):
            found = index.resolve(key) if statuses is None else index.resolve(key, statuses=statuses)
            if found is not None:
                return Answer(flown=flown, use=use, resolution=found, finding=_unusable(flown, use, found))
        near = index.near(key, on=flown.last or today)
    except RegistryError as error:
        finding = Finding(
            rule=Rule.SEVERAL if isinstance(error, AmbiguousEntryError) else Rule.BROKEN,
            severity=Severity.ERROR,
            camera=named(flown),
            message=str(error),
            remedy="calibrary registry check",
        )
        return Answer(flown=flown, use=Use.NONE, finding=finding)
    nearest = "; ".join(f"{id_of(one.path)}: {one.reason}" for one in near[:MOST_NEAR])
    finding = Finding(
        rule=Rule.NO_ENTRY,
        severity=Severity.ERROR,
        camera=named(flown),
        message=f"{_count(flown)} and no entry is of this camera" + (f" ({nearest})" if nearest else ""),
        remedy=f"calibrary onboard {flown.example.parent}",
    )
    return Answer(flown=flown, use=Use.NONE, finding=finding)


def _nameless(flown: Flown) -> Finding:
    missing = "no make" if flown.key.model else "no model" if flown.key.make else "neither make nor model"
    return Finding(
        rule=Rule.NAMELESS,
        severity=Severity.WARNING,
        camera=named(flown),
        message=f"{_count(flown)} that name {missing}, by which an entry is found, such as {flown.camera.names[0]}",
        remedy="provide the original files from the camera",
    )


def _unusable(flown: Flown, use: Use, found: Resolution) -> Finding:
    entry, id_ = found.entry, id_of(found.path)
    why = f" ({entry.reason})" if entry.reason else ""
    if use is Use.DRAFT:
        rule, text = Rule.DRAFT, "and its entry is a draft, which no run uses"
        remedy = f"calibrary registry show {id_}, then calibrary registry approve {id_}"
    elif use is Use.RETIRED:
        rule, text = Rule.RETIRED, f"and its entry is retired{why}"
        remedy = f"calibrate the camera again and add that: calibrary onboard {flown.example.parent}"
    else:
        day = f" on {flown.last}" if flown.last is not None else ""
        rule, text = Rule.EXPIRED, f"and its entry is valid {entry.validity}{why}, not{day or ' today'}"
        remedy = f"calibrate it again, or extend 'valid' in {found.path} and add that file again"
    return Finding(
        rule=rule,
        severity=Severity.ERROR,
        camera=named(flown),
        place=id_,
        message=f"{_count(flown)} {text}",
        remedy=remedy,
    )


def _count(flown: Flown) -> str:
    images = "1 image" if flown.images == 1 else f"{flown.images} images"
    days = f", last on {flown.last}" if flown.last is not None else ""
    return f"it flew ({images}{days})"
