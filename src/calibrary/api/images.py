"""Extraction of one validated calibration per camera from images."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeAlias

from msgspec import Struct

from calibrary.arguments import PolicyLike
from calibrary.atomic import write_files
from calibrary.interop.colmap_database import write_database
from calibrary.interop.notebook import html_rows
from calibrary.jobs.extract.extraction import CameraReport, Extraction
from calibrary.jobs.extract.hand_off import Solver, check_task_place, lay_out, seed_command
from calibrary.jobs.extract.outputs import STALE, Outputs, check_place, plan
from calibrary.jobs.extract.report import report_of
from calibrary.jobs.extract.run import Request, run
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.images.places import place_of
from calibrary.policy import FLEET
from calibrary.policy_file import policy_of
from calibrary.progress import Progress
from calibrary.records import Json, replace, to_json
from calibrary.registry.places import registries

__all__ = [
    "STALE",
    "ExtractResult",
    "Outputs",
    "check_place",
    "check_task_place",
    "extract",
    "policy_of",
    "seed_command",
    "write_outputs",
]

PathLike: TypeAlias = str | Path


class ExtractResult(Struct, frozen=True):
    """Cameras found in images, with their calibrations.

    Attributes:
        extraction: complete result, as the command line shows it.

    >>> found = calibrary.extract("survey")
    >>> found.is_good, found.skipped
    (True, ())
    """

    extraction: Extraction

    @property
    def cameras(self) -> tuple[CameraReport, ...]:
        """All cameras, each with ``calibration``, ``verdict``, ``report``, ``images``, ``reason`` and ``advice``."""
        return self.extraction.cameras

    @property
    def skipped(self) -> tuple[SkippedFile, ...]:
        """Images that cannot be read, then pictures without a camera, each with its ``reason``."""
        return (*self.extraction.rejected, *self.extraction.skipped)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the run itself."""
        return self.extraction.warnings

    @property
    def is_good(self) -> bool:
        """Whether every image has a valid K, and there is at least one."""
        return self.extraction.is_good

    def outputs(
        self,
        matrix: PathLike,
        *,
        hand_off: str = "none",
        page: PathLike | None = None,
        database: PathLike | None = None,
        task: PathLike | None = None,
        copy_images: bool = False,
        job: str | None = None,
        operator: str | None = None,
    ) -> Outputs:
        """Prepare the output files of a run: one K per camera, a report, input for a solver; nothing is written.

        Args:
            matrix: .npy file for K; with several cameras, the name of each is inserted.
            hand_off: solver that receives K: "colmap", "opensfm", "odm", "opencv", "metashape", "pix4d", "realityscan"
                or "none".
            page: file for the report as a page.
            database: a COLMAP database that contains the images, to write their cameras into.
            task: a new folder with the images that "odm" or "opensfm" can process directly.
            copy_images: copy the images into the task folder; by default they are hard links.
            job: job name for the head of the page; None is shown as unknown.
            operator: operator for the head of the page; None is shown as unknown.

        Raises:
            InputError: ``matrix`` is not a .npy, an existing file must not be replaced, or a solver needs all images
                and the result does not list them all.
        """
        found = plan(
            self.extraction,
            Path(matrix),
            Solver(hand_off),
            database=Path(database) if database is not None else None,
            task=Path(task) if task is not None else None,
            copied=copy_images,
        )
        if page is None:
            return found
        from calibrary.jobs.extract.page import JobFacts, outcome_page
        from calibrary.pages import render_page

        about = JobFacts(job=job, operator=operator, checked=datetime.now(UTC).date())
        html = render_page(outcome_page(self.extraction, found, about)).encode()
        return replace(found, files={**found.files, Path(page): html})

    def _repr_html_(self) -> str:
        """Return the cameras and the images that were not read as HTML, for notebooks."""
        rows = []
        for one in self.cameras:
            made = one.calibration
            K = made.intrinsics if made is not None else None
            numbers = [f"{value:.2f}" for value in (K.fx, K.fy, K.cx, K.cy)] if K is not None else [""] * 4
            grade = made.grade.value if made is not None else ""
            rows.append(
                (one.name, str(one.camera.count), one.verdict.value, *numbers, grade, one.reason or "")
            )
        columns = ("camera", "images", "verdict", "fx px", "fy px", "cx px", "cy px", "grade", "why")
        unread = f"; {self.extraction.unread}" if self.extraction.unread is not None else ""
        title = f"{len(rows)} camera{'s' * (len(rows) != 1)}, {self.extraction.policy.name} policy{unread}"
        return html_rows(columns, rows, title=title)

    def to_dict(self) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/report-1.schema.json)."""
        return to_json(report_of(self.extraction, {}))


def write_outputs(outputs: Outputs) -> None:
    """Place a task's images, write all files, then write the cameras of a COLMAP database; each step is atomic.

    Raises:
        InputError: a file cannot be written.
    """
    if outputs.task is not None:
        lay_out(outputs.task)
    write_files(outputs.files)
    if outputs.database is not None:
        write_database(outputs.database)


def extract(
    images: PathLike | Sequence[PathLike] = (),
    *,
    lines: Iterable[str] | None = None,
    sensor_mm: tuple[float | None, float | None] | None = None,
    policy: PolicyLike = FLEET,
    fallback_k: PathLike | None = None,
    registry: PathLike | Sequence[PathLike] | None = None,
    locked: PathLike | None = None,
    recursive: bool = False,
    workers: int = 0,
    strict_validation: bool = False,
    verify: bool = False,
    list_images: bool = False,
    days: bool = False,
    resume: PathLike | None = None,
    scheduler: str | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> ExtractResult:
    """Derive and validate one K per camera from image metadata; pixels are decoded only for ``verify``.

    Args:
        images: a folder, an archive (zip, tar), a URL (https, s3, gs, az, …), an image, or a list of those.
        lines: further images, one per line, such as an open text file.
        sensor_mm: (width, height) of the sensor in mm, for images of one camera that do not state it.
        policy: policy for the validation: a policy, "fleet", "source" or a policy file.
        fallback_k: a calibrated K (.npy), used if the images yield none.
        registry: the fleet's registry: its folder, or the address of a published one; of several, the first that has a
            matching entry is used.
        locked: a lock file; only the entries pinned in it are used.
        recursive: include sub-folders.
        workers: number of processes that read images; 0 chooses it automatically.
        strict_validation: raise an error at the first violation.
        verify: also compare K with the pixels of a dozen images of each camera, as one more source.
        list_images: list every image; by default, above 10 000 images, only the first few of each group with the same
            metadata.
        days: read the days on which the images were taken, for the page; with a registry they are always read.
        resume: a folder for intermediate results; a later run with it reads only the missing images.
        scheduler: address of a Dask scheduler with workers that read the images, such as "tcp://host:8786".
        cluster: "local:4" starts a Dask cluster with four workers on this machine to read the images.
        progress: called with (images read, number of images, "images"); with ``verify`` also with "features", "pairs",
            "placed".

    Raises:
        MissingExtraError: Dask is required for a cluster, or pycolmap for ``verify``, and is not installed.
        InputError: there is no image, or a named file cannot be read.
        RegistryError: the registry cannot be read, or has drifted from the lock.
        ValidationError: ``strict_validation`` is set and a rule was violated.

    >>> result = calibrary.extract("survey")
    >>> [camera] = result.cameras
    >>> camera.verdict, camera.calibration.intrinsics.fx, len(camera.images)
    (<Verdict.VALID: 'valid'>, 3659.5, 2)
    >>> result.is_good
    True
    """
    given = [images] if isinstance(images, str | Path) else images
    return ExtractResult(
        run(
            Request(
                images=tuple(place_of(path) for path in given),
                sensor_mm=sensor_mm or (None, None),
                policy=policy_of(policy),
                fallback_k=Path(fallback_k) if fallback_k is not None else None,
                registry=registries(registry, needed=locked is not None),
                lock=Path(locked) if locked is not None else None,
                recursive=recursive,
                workers=workers,
                strict=strict_validation,
                verify=verify,
                list_images=list_images,
                days=days,
                partials=Path(resume) if resume is not None else None,
                scheduler=scheduler,
                cluster=cluster,
                progress=progress,
                lines=lines,
            )
        )
    )
