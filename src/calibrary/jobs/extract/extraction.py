"""A camera of a run with its K and the evidence for it, and the short names of the cameras."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, CameraKey
from calibrary.jobs.extract.cameras import Camera, StateDocument, states_of
from calibrary.jobs.extract.fallback import Fallback
from calibrary.validation import Report, Verdict

if TYPE_CHECKING:
    from calibrary.jobs.use import Allowed
    from calibrary.jobs.verify.look import Look
    from calibrary.sfm.pixel_check import PixelCheck


@dataclass(frozen=True, kw_only=True)
class JudgedCamera:
    """One camera with its own K or a fallback, and all that was considered; the report says what follows from it.

    Attributes:
        slug: its name in file names, unique in the run.
        camera: result from its images.
        fallback: the fallback steps, None if not needed.
        pixels: check of the K to write against the pixels; None if not requested or without a K.
        look: observations in the pixels, to check another K with.
        use: what a solver may do with the K to write.
    """

    slug: str
    camera: Camera
    fallback: Fallback | None = None
    pixels: PixelCheck | None = None
    look: Look | None = None
    use: Allowed | None = None

    @property
    def calibration(self) -> Calibration | None:
        """The K to write: from the images or the fallback; None if there is none."""
        if self.fallback is not None and self.fallback.calibration is not None:
            return self.fallback.calibration
        return self.camera.calibration if self.camera.has_k else None

    @property
    def label(self) -> str | None:
        """Label of the unit in the registry; None if its entry has none, or no entry is used."""
        found = self.camera.states[0].known.resolution
        return found.entry.label if found is not None and found.entry.unit is not None else None

    @property
    def name(self) -> str:
        """The camera in words."""
        return name_of(self.camera.key, self.slug, self.label)

    @property
    def outranked(self) -> Calibration | None:
        """The valid K from the images, if a measured registry entry is used instead of it."""
        replaced = self.fallback is not None and self.camera.verdict is Verdict.VALID
        return self.camera.calibration if replaced else None

    @property
    def images(self) -> tuple[str, ...]:
        """Paths of the images relative to the folder; only the first if there are very many."""
        return self.camera.names

    @property
    def states(self) -> tuple[StateDocument, ...]:
        """Its images by state, with the verdict on each state."""
        return states_of(self.camera)

    @property
    def report(self) -> Report | None:
        """Validation of the K to write, or of the rejected K."""
        if self.fallback is not None and self.fallback.report is not None:
            return self.fallback.report
        return self.camera.report

    @property
    def verdict(self) -> Verdict:
        """Verdict on the K to write."""
        if self.fallback is not None and self.fallback.report is not None:
            return self.fallback.report.verdict
        return self.camera.verdict

    @property
    def uncalibrated(self) -> bool:
        """Whether principal point and distortion are defaults, not measured."""
        calibration = self.calibration
        return calibration is None or not calibration.grade.is_measured

    @property
    def reason(self) -> str | None:
        """Reason why the K is not valid, or the fallback that is used; None for a valid K from the images."""
        reason = self.camera.reason
        taken = self.fallback.taken if self.fallback is not None else None
        if self.outranked is None and taken is not None:
            return f"{taken.source or taken.step.value} is used; the images alone give no valid K: {reason}"
        if reason is not None and self.camera.calibration is not None:
            assumptions = self.camera.calibration.provenance.assumptions
            reason = f"{reason} (assumed: {'; '.join(assumptions)})" if assumptions else reason
        refused = [
            step for step in (self.fallback.steps if self.fallback is not None else ()) if step.is_refused
        ]
        if reason is not None and refused:
            reason = f"{reason}; {refused[0].source} is not used: {refused[0].why}"
        return reason

    @property
    def advice(self) -> str | None:
        """The next step for the user, None if there is nothing to do."""
        if self.verdict is Verdict.VALID:
            return None
        if self.fallback is not None and self.fallback.report is not None:
            return self.fallback.report.remedy
        return self.camera.remedy


def name_of(key: CameraKey, slug: str, label: str | None) -> str:
    """The camera in words, after its label; with its unit if its short name has that, to tell two apart."""
    unit = f", unit {key.serial[:8]}" if key.serial and _serial(key)[0] in slug else ""
    return f"{label}: {key}{unit}" if label is not None else f"{key}{unit}"


def slugs_of(cameras: Sequence[Camera]) -> list[str]:
    """Short names of the cameras; if several have the same key, the grade of K is appended to the later ones."""
    names = slugs(dict.fromkeys(camera.key for camera in cameras))
    taken: set[str] = set(names.values())
    seen: set[CameraKey] = set()
    found: list[str] = []
    for camera in cameras:
        slug = names[camera.key]
        if camera.key in seen:
            grade = camera.calibration.grade.value if camera.calibration is not None else "no-k"
            slug, n = f"{slug}-{grade}", 2
            while slug in taken:
                slug, n = f"{names[camera.key]}-{grade}-{n}", n + 1
            taken.add(slug)
        seen.add(camera.key)
        found.append(slug)
    return found


def slugs(keys: Iterable[CameraKey]) -> dict[CameraKey, str]:
    """Short names by camera that are safe in any file system and unique in the run.

    A name contains focal length, mode and serial number only if two names would otherwise be equal.
    """
    keys = list(keys)
    names: dict[CameraKey, str] = {}
    taken: dict[str, CameraKey] = {}
    parts: dict[CameraKey, list[str]] = {key: _basic(key) for key in keys}
    for finer in (_lens, _serial):
        counts: dict[str, int] = {}
        for key in keys:
            counts[_slug(parts[key])] = counts.get(_slug(parts[key]), 0) + 1
        for key in keys:
            if counts[_slug(parts[key])] > 1:
                parts[key] = [*parts[key], *finer(key)]
    for key in keys:
        slug, n = _slug(parts[key]), 2
        while slug in taken:
            slug, n = f"{_slug(parts[key])}-{n}", n + 1
        taken[slug] = key
        names[key] = slug
    return names


def _basic(key: CameraKey) -> list[str]:
    name = str(CameraKey(make=key.make, model=key.model))
    size = "{}x{}".format(*key.image_size) if key.image_size else ""
    return [name, key.sub_camera or "", key.capture_mode or "", size]


def _lens(key: CameraKey) -> list[str]:
    return [key.lens or "", f"{key.focal_mm:g}mm" if key.focal_mm is not None else ""]


def _serial(key: CameraKey) -> list[str]:
    return [f"sn-{key.serial[:6]}"] if key.serial else []


def _slug(parts: Iterable[str]) -> str:
    text = unicodedata.normalize("NFKD", "-".join(part for part in parts if part)).replace("×", "x")
    ascii_text = text.encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9.]+", "-", ascii_text).strip("-.")[:100] or "camera"
