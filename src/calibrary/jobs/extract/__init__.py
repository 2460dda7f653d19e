"""One valid K per camera from the images of a flight, before a reconstruction starts from it.

>>> from calibrary.jobs.extract import extract
>>> result = extract("survey")
>>> [camera] = result.cameras
>>> camera.verdict, camera.calibration.intrinsics.fx, len(camera.images)
(<Verdict.VALID: 'valid'>, 3659.5, 2)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta

from calibrary.arguments import File, Folder, Place, PolicyLike, Text, Workers
from calibrary.policy import FLEET
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.jobs.extract.report import ExtractReport

__all__ = ["Program", "extract"]

Program: TypeAlias = Literal["colmap", "opensfm", "odm", "opencv", "metashape", "pix4d", "realityscan", "ros"]
"""The programs that K can be handed to; :mod:`calibrary.jobs.extract.targets` states how to add one."""
Source: TypeAlias = Annotated[str | Path, Meta(title="DIR|URL")]
Millimetres: TypeAlias = Annotated[float, Meta(ge=0.1, le=1000)]


def extract(
    images: Source | Sequence[Source] = (),
    *,
    recursive: bool = False,
    lines: Iterable[str] | None = None,
    workers: Workers = 0,
    cluster: Annotated[str, Meta(title="URL")] | None = None,
    policy: PolicyLike = FLEET,
    max_focal_deviation_pct: Annotated[float, Meta(ge=0, le=100)] | None = None,
    principal_point_tolerance: Annotated[float, Meta(ge=0, le=1, title="FRACTION")] | None = None,
    verify: bool | Literal["unproven"] = False,
    strict_validation: bool = False,
    sensor: Annotated[Mapping[str, str], Meta(title="CAMERA=WxH")] | None = None,
    camera: Annotated[str, Meta(title="MODEL")] | None = None,
    focal_mm: Millimetres | None = None,
    sensor_width_mm: Millimetres | None = None,
    sensor_height_mm: Millimetres | None = None,
    registry: Place | Sequence[Place] | None = None,
    locked: Annotated[str | Path, Meta(title="LOCKFILE")] | None = None,
    fallback_k: File | None = None,
    fallback_camera: Text | None = None,
    out: File | None = None,
    to: Program | None = None,
    database: File | None = None,
    task: Folder | None = None,
    drop_distortion: bool = False,
    include_unproven: bool = False,
    copy_images: bool = False,
    html: File | None = None,
    list_images: bool = False,
    dry_run: bool = False,
    progress: Progress | None = None,
) -> ExtractReport:
    """Derive and validate one K per camera from image metadata; pixels are decoded only for ``verify``.

    Args:
        images: folders of images, zip or tar files, URLs (https://, s3://, gs://, az://, …), or images (default of the
            command: ./input/).
        recursive: include sub-folders.
        lines: more images, folders and URLs, one on each line, such as an open text file.
        workers: number of processes that read images; 0 chooses it.
        cluster: read with the workers of this Dask scheduler, as tcp://host:8786.
        policy: fleet knows real UAV cameras, source requires fx within 0.8 … 1.5 W of every camera; or your own file.
        max_focal_deviation_pct: largest difference of fx and fy in per cent (default: that of the policy, 15).
        principal_point_tolerance: largest offset of the principal point from the middle, as a fraction of the side
            (default: that of the policy, 0.05).
        verify: also compare K with the pixels of a dozen images of each camera, or of each whose K is not valid
            otherwise (unproven): agrees, contradicts or cannot tell (needs calibrary[sfm]; up to a minute for each).
        strict_validation: stop at the first broken rule and write nothing.
        sensor: physical width and height in mm of the sensor of one camera, which its model names, with band or lens
            where these differ.
        camera: the camera of images that state none, by its Model or title in the catalogue; their K is unproven.
        focal_mm: focal length of images that state none, with ``camera`` or ``sensor_width_mm``; their K is unproven.
        sensor_width_mm: physical sensor width, for images of one camera (default: that of the camera if it is known or
            its images state one; otherwise 13.2, marked as assumed).
        sensor_height_mm: physical sensor height (default: as for the width, 8.8).
        registry: the fleet's registry: a git repository, bare or checked out, as committed; folder:PATH for files
            without git; or the https:// address of a published one; of several, the first that answers is used.
        locked: use only the entries of the registry that this file pins, as they were then; an error if that state is
            lost.
        fallback_k: a calibrated K, in a file of any format, to use if the images yield none.
        fallback_camera: which camera of that file, if several are of these images: its number or name.
        out: .npy file for a valid K, and beside it the report; with several cameras, each file name contains the name
            of the camera; a K that is not valid has unproven or seed in the name.
        to: also write the files that this program needs, for cameras whose K it may use.
        database: with ``to`` colmap: also write the cameras into this COLMAP database, which has the images; an SQL
            file keeps the old cameras.
        task: with ``to`` odm or opensfm: make a folder that the program can process as it is, with the images as hard
            links, the cameras and the options.
        drop_distortion: with ``to``: hand a K whose distortion is unknown to a program that takes it for none, too.
        include_unproven: with ``to``: hand an unproven K on as a start, too.
        copy_images: with ``task``: copy the images, do not link.
        html: also write the report as a page.
        list_images: name every image in the report; without it, the report of more than 10 000 images names only a few,
            unless a program needs them all.
        dry_run: judge everything and write nothing.
        progress: called with (images read, number of images, "images"); with ``verify`` also with "features", "pairs",
            "placed".

    Raises:
        UsageError: an argument lacks the one that it belongs to, ``sensor`` names no camera or no size, or what is
            stated of the camera has no effect.
        InputError: there is no image, a named file cannot be read, or a file must not be replaced.
        RegistryError: the registry cannot be read, or has drifted from the lock.
        ValidationError: ``strict_validation`` is set and a rule was violated.
        MissingExtraError: Dask is required for a cluster, or pycolmap for ``verify``, and is not installed.
    """
    if cluster is None and workers > 1:
        from calibrary.workers import get_ready

        # The process that readers are forked from starts while the rest is loaded: half a second less.
        get_ready(["calibrary.jobs.images.reading"])
    from calibrary.errors import UsageError
    from calibrary.jobs.extract.outputs import Wanted
    from calibrary.jobs.extract.run import limits, run
    from calibrary.jobs.images.places import place_of
    from calibrary.registry.places import registries

    if fallback_camera is not None and fallback_k is None:
        raise UsageError("--fallback-camera goes with --fallback-k FILE")
    wanted = Wanted(
        out=_path(out),
        to=to,
        database=_path(database),
        task=_path(task),
        copy_images=copy_images,
        drop_distortion=drop_distortion,
        include_unproven=include_unproven,
        html=_path(html),
    )
    wanted.check()
    given = [images] if isinstance(images, str | Path) else images
    outcome = run(
        *(place_of(path) for path in given),
        lines=lines,
        recursive=recursive,
        workers=workers,
        cluster=cluster,
        policy=limits(policy, max_focal_deviation_pct, principal_point_tolerance),
        sensor_mm=(sensor_width_mm, sensor_height_mm),
        sensors=dict(sensor or {}),
        camera=camera,
        focal_mm=focal_mm,
        registry=registries(registry, needed=locked is not None),
        lock=_path(locked),
        fallback_k=_path(fallback_k),
        fallback_camera=fallback_camera,
        strict=strict_validation,
        verify=verify,
        list_images=list_images or to is not None,
        days=html is not None,
        progress=progress,
    )
    return wanted.written(outcome, dry_run=dry_run)


def _path(place: str | Path | None) -> Path | None:
    return Path(place) if place is not None else None
