"""What a run found, camera by camera."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.fallback import Fallback
from calibrary.jobs.extract.states import StateDocument, states_of
from calibrary.jobs.images.folders import SkippedFile
from calibrary.policy import Policy
from calibrary.validation import Report, Verdict

if TYPE_CHECKING:
    from calibrary.jobs.extract.candidates import Candidates
    from calibrary.jobs.verify.look import Look
    from calibrary.sfm.pixel_check import PixelCheck

__all__ = ["CameraReport", "Extraction", "slugs", "slugs_of"]


class CameraReport(Struct, frozen=True, kw_only=True):
    """One camera, its own K or what stands in for it.

    Attributes:
        slug: its name in file names, unique in the run.
        camera: what its images say.
        fallback: the chain that was gone through, None when it was not needed.
        pixels: what the pixels say of the K to write; None where they were not asked or there is none.
        look: what they show, to hold other K's against.
    """

    slug: str
    camera: Camera
    fallback: Fallback | None = None
    pixels: PixelCheck | None = None
    look: Look | None = None

    @property
    def calibration(self) -> Calibration | None:
        """The K to write: the images', the fallback's, or none."""
        if self.fallback is not None and self.fallback.calibration is not None:
            return self.fallback.calibration
        return self.camera.calibration if self.camera.verdict is not Verdict.REJECTED else None

    @property
    def label(self) -> str | None:
        """What the registry calls the unit; None where its entry is of no unit, or no entry is used for it."""
        found = self.camera.states[0].known.resolution
        return found.entry.label if found is not None and found.entry.unit is not None else None

    @property
    def name(self) -> str:
        """The camera in words, behind its label."""
        return f"{self.label}: {self.camera.key}" if self.label is not None else str(self.camera.key)

    @property
    def outranked(self) -> Calibration | None:
        """The images' own valid K, where a measured entry of the registry is used in its place."""
        replaced = self.fallback is not None and self.camera.verdict is Verdict.VALID
        return self.camera.calibration if replaced else None

    @property
    def images(self) -> tuple[str, ...]:
        """The images of this camera, by their paths below the folder: all, or the first of very many."""
        return self.camera.names

    @property
    def states(self) -> tuple[StateDocument, ...]:
        """Its images by what can change K or its meaning, with what was decided of each."""
        return states_of(self.camera)

    @property
    def report(self) -> Report | None:
        """That K against the policy; of a rejected K, why."""
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
        """Whether principal point and distortion are defaults instead of measured."""
        calibration = self.calibration
        return calibration is None or calibration.grade not in {Grade.CALIBRATED, Grade.ADJUSTED}

    @property
    def reason(self) -> str | None:
        """Why the K is not valid, or what stands in for it; None for a valid K of the images' own."""
        reason = self.camera.reason
        if self.outranked is None and self.fallback is not None and self.fallback.calibration is not None:
            taken = self.fallback.steps[-1]
            return f"{taken.source or taken.step.value} is used; the images alone give no valid K: {reason}"
        if reason is not None and self.camera.calibration is not None:
            assumptions = self.camera.calibration.provenance.assumptions
            return f"{reason} (assumed: {'; '.join(assumptions)})" if assumptions else reason
        return reason

    @property
    def advice(self) -> str | None:
        """The next step for whoever flies this camera, None when there is nothing to do."""
        if self.verdict is Verdict.VALID:
            return None
        if self.fallback is not None and self.fallback.report is not None:
            return self.fallback.report.remedy
        return self.camera.remedy


class Extraction(Struct, frozen=True, kw_only=True):
    """The run.

    Attributes:
        policy: what it was judged by.
        cameras: every camera, in a fixed order.
        rejected: images that cannot be read; each of them is without a K.
        skipped: pictures that are not images of a camera, such as a preview; they count for nothing.
        more_rejected, more_skipped: how many more there are of each than are listed.
        lost: how many of those that cannot be read are so because the processes that read them were killed.
        beside: the calibration files that lie with the images.
        beside_unread: what looks like one and cannot be read, with the reason.
        warnings: what the user should know about the run itself.
        root: the folder that the images' names are relative to.
        sources: the folders, archives and URLs that were given, by their last names.
        days: the first and last on which images were taken; None where none states one, or nothing asked.
    """

    policy: Policy
    cameras: tuple[CameraReport, ...]
    rejected: tuple[SkippedFile, ...] = ()
    skipped: tuple[SkippedFile, ...] = ()
    warnings: tuple[str, ...] = ()
    more_rejected: int = 0
    more_skipped: int = 0
    lost: int = 0
    beside: tuple[Candidates, ...] = ()
    beside_unread: tuple[tuple[str, str], ...] = ()
    root: Path = Path()
    sources: tuple[str, ...] = ()
    days: tuple[date, date] | None = None

    @property
    def images(self) -> int:
        """How many images were looked at, and folders that cannot be read."""
        counted = len(self.rejected) + self.more_rejected + len(self.skipped) + self.more_skipped
        return counted + sum(one.camera.count for one in self.cameras)

    @property
    def uncalibrated(self) -> bool:
        """Whether any camera goes on without measured principal point and distortion."""
        return any(camera.uncalibrated for camera in self.cameras)

    @property
    def is_good(self) -> bool:
        """Whether every image has a valid K, and there is at least one."""
        valid = all(c.verdict is Verdict.VALID for c in self.cameras)
        return bool(self.cameras) and valid and not self.rejected

    @property
    def unread(self) -> str | None:
        """How many images and folders cannot be read, in words; None where all can."""
        folders = sum(one.name.endswith("/") for one in self.rejected)
        files = len(self.rejected) + self.more_rejected - folders
        images = files + sum(camera.camera.count for camera in self.cameras)
        counted = [f"{files} of {images} images"] if files else []
        counted += [f"{folders} folder{'s' if folders > 1 else ''}"] if folders else []
        return f"{' and '.join(counted)} unread" if counted else None

    @property
    def exit_code(self) -> int:
        """0 when it is good, 3 when a part of the images was never read, else 1."""
        return 3 if self.lost else 0 if self.is_good else 1


def slugs_of(cameras: Sequence[Camera]) -> list[str]:
    """The short name of each camera; of those with one key, the later ones carry the grade of their K."""
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
    """A short name per camera that is safe in any file system and unique in the run.

    Only what distinguishes the cameras is in it: focal length, mode and serial come in where two would collide.
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
