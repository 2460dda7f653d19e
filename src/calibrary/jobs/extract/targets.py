"""K in the form that each program needs: files and command lines, in the program's own conventions.

COLMAP's origin is the outer corner of the first pixel, as in calibrary. ``PINHOLE`` is for images known to be
free of distortion, ``OPENCV`` and ``FULL_OPENCV`` include it; an unknown distortion starts from zero in
``OPENCV``, to be found by bundle adjustment (COLMAP's documentation of camera models). OpenSfM and ODM count
from the image centre in units of the longer side. OpenCV's origin is the centre of the first pixel.

To add a program:

1. Add its name to ``Program`` in :mod:`calibrary.jobs.extract`, which makes it a word of ``--to``. Where the name
   stands for a calibration format too (:mod:`calibrary.parsers`), it is the same.
2. Add a row to :data:`TARGETS`, at the end of this module: :func:`_one_file_each` if the program reads one file of a
   calibration format for each camera; else a function that makes its datasets.
3. Run ``tests/jobs/extract/test_hand_off.py``: it makes each program's files for each lens, and names a program without
   a row, and a row whose files are not of its patterns or have no K.

``--to``, its help, completion and the manual's list (``make docs``) follow.
"""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.interop.colmap import ColmapCamera
from calibrary.interop.colmap_database import DatabaseChange, change_of, read_database
from calibrary.jobs.export.opensfm_names import (
    odm_band,
    odm_name,
    odm_names,
    opensfm_names,
)
from calibrary.jobs.extract import Program
from calibrary.jobs.use import Allowed
from calibrary.parsers.fit import refit
from calibrary.parsers.opensfm_models import opensfm_camera
from calibrary.records import encoded, replace
from calibrary.validation import Use

OPENSFM_MODELS: Final = "camera_models_overrides.json"
OPENSFM_IMAGES: Final = "exif_overrides.json"
REALITYSCAN_CSV: Final = "realityscan.csv"
RESTORE: Final = "colmap.database-before.sql"
ODM_SCRIPT: Final = """\
#!/bin/sh
# usage: sh odm.sh [more options of ODM]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
name=$(basename "$here")
exec docker run --rm -v "$(dirname "$here"):/datasets" opendronemap/odm \\
  --project-path /datasets "$name" --cameras "/datasets/$name/cameras.json"{options} "$@"
"""

Files: TypeAlias = Mapping[str, bytes]
"""Content by file name."""
UNJUDGED: Final = Allowed(use=Use.START, why="how well it is known was not judged")


class Candidate(Struct, frozen=True, kw_only=True):
    """One camera of a run on its way to a program.

    Attributes:
        slug: its name in file names.
        calibration: its K as the program holds it; None if the program does not get it.
        allowed: what the program may do with it.
        said: how far what the program holds is from the original, or why the program does not get it.
        states: metadata of its images; some programs derive a camera's name from EXIF.
        names: its images, relative to the image directory.
    """

    slug: str
    calibration: Calibration | None
    allowed: Allowed = UNJUDGED
    said: str = ""
    states: tuple[ImageMetadata, ...]
    names: tuple[str, ...]


Candidates: TypeAlias = Sequence[Candidate]
"""All cameras of the run, because a K must not be applied to another camera's images."""


class Dataset(Struct, frozen=True, kw_only=True):
    """Candidates that a program processes together.

    Attributes:
        into: file or folder that each camera is in, by slug; cameras that are not named stay out.
        files: their files.
        command: what to run, or to do with the files; ``{place}`` is their folder and ``{images}`` that of the images.
        folder: sub-folder of a task; empty for the task's own folder.
        said: why it is apart from the others.
        primary: slug of the camera whose images alone are placed; those of the others follow it. Empty if all are.
    """

    into: Mapping[str, str]
    files: Files
    command: str
    folder: str = ""
    said: str = ""
    primary: str = ""


class Target(Struct, frozen=True, kw_only=True):
    """A program that gets K, as a row of :data:`TARGETS`.

    Attributes:
        form: the calibration format that has the program's models.
        models: lens models of the program, if they are not all of that format; preferred ones first.
        reads: patterns of the names of the files that it reads K from, ``*`` for a camera; those of an earlier run are
            reported.
        several: how the cameras of a run are kept apart, for the manual.
        datasets: makes them of the cameras of a run, at least one of which has a K, and the name of a task's folder
            of images, which is empty without a task.
        holds: converts one calibration; raises UnsupportedModelError if the program cannot represent it exactly.
        adjusted: makes what that format can represent (of the original) what the program can; None if it is the same.
        named: its name of a camera; None if it has files instead.
        task: whether it processes a folder as it is (``--task``).
        database: whether K can be written into its database (``--database``).
    """

    form: str
    models: tuple[type[Distortion], ...] = ()
    reads: tuple[str, ...]
    several: str = "a file each"
    datasets: Callable[[Candidates, str], Sequence[Dataset]]
    holds: Callable[[Calibration], object]
    adjusted: Callable[[Calibration, Calibration], Calibration] | None = None
    named: Callable[[ImageMetadata], str] | None = None
    task: bool = False
    database: bool = False


def refinement(camera: Candidate) -> str:
    """Which parameters of a camera a bundle adjustment should refine."""
    if camera.allowed.use is Use.FIXED:
        return f"keep fixed: {camera.allowed.why}"
    what = "the focal length only"
    if camera.calibration is None or not isinstance(camera.calibration.distortion, NoDistortion):
        what = "focal length and distortion"
    return f"refine {what}: {camera.allowed.why}"


def _given(cameras: Candidates) -> list[tuple[Candidate, Calibration]]:
    return [(camera, camera.calibration) for camera in cameras if camera.calibration is not None]


def _json(document: Mapping[str, object]) -> bytes:
    return encoded(document) + b"\n"


def seed_command(seed: Calibration) -> str:
    """COLMAP commands for a self-calibration from a seed, in the model that the source document names: PINHOLE."""
    return (
        "colmap feature_extractor --database_path database.db --image_path IMAGES "
        f"{colmap_flags(seed.to_colmap('PINHOLE'))} && colmap exhaustive_matcher --database_path database.db && "
        "colmap mapper --database_path database.db --image_path IMAGES --output_path OUT "
        "--Mapper.ba_refine_focal_length 1"
    )


def colmap_flags(camera: ColmapCamera) -> str:
    """The flags of COLMAP's feature_extractor that state a camera."""
    values = ",".join(repr(value) for value in camera.params)
    return (
        f"--ImageReader.single_camera 1 --ImageReader.camera_model {camera.model} "
        f'--ImageReader.camera_params "{values}"'
    )


def _colmap_datasets(cameras: Candidates, _images: str) -> list[Dataset]:
    given = _given(cameras)
    into = {camera.slug: f"colmap.{camera.slug}.txt" for camera, _ in given}
    files = {into[camera.slug]: _image_list(camera) for camera, _ in given}
    script = {"colmap.sh": _colmap_script(given).encode()}
    return [
        Dataset(into=into, files={**script, **files}, command="sh {place}/colmap.sh {images} database.db")
    ]


def _image_list(camera: Candidate) -> bytes:
    """List of image names, one per line, in the bytes of the file system.

    Raises:
        InputError: a name contains a line break.
    """
    broken = next((name for name in camera.names if "\n" in name or "\r" in name), None)
    if broken is not None:
        raise InputError(
            "its name contains a line break, which a COLMAP image list cannot contain; rename it",
            source=repr(broken),
        )
    return b"".join(os.fsencode(name) + b"\n" for name in camera.names)


def _colmap_script(cameras: Sequence[tuple[Candidate, Calibration]]) -> str:
    lines = [
        "#!/bin/sh",
        "# usage: sh colmap.sh IMAGE_DIR DATABASE",
        "# One run of the extractor a camera: K of one camera is wrong for every other.",
        "set -eu",
        'here=$(dirname "$0")',
    ]
    for camera, calibration in cameras:
        lines += ["", f"# {calibration.camera} ({calibration.grade}); {refinement(camera)}"]
        lines.append(
            f'colmap feature_extractor --database_path "$2" --image_path "$1" '
            f'--image_list_path "$here"/{shlex.quote(f"colmap.{camera.slug}.txt")} '
            f"{colmap_flags(calibration.to_colmap())}"
        )
    refine = [camera.allowed.use is not Use.FIXED for camera, _ in cameras]
    flag, why = (
        ("1", "Not all was measured: let bundle adjustment find it with")
        if any(refine)
        else ("0", "A measured K is not a start: keep bundle adjustment from moving it with")
    )
    both = (
        ["# These flags are for all cameras at once, the measured ones too."] if len(set(refine)) > 1 else []
    )
    lines += [
        "",
        f"# {why}",
        f"#   colmap mapper … --Mapper.ba_refine_focal_length {flag} --Mapper.ba_refine_principal_point 0 \\",
        f"#     --Mapper.ba_refine_extra_params {flag}",
        *both,
    ]
    return "\n".join(lines) + "\n"


def plan_database(path: Path, cameras: Candidates) -> DatabaseChange:
    """Find the rows of a COLMAP database that get the K of each camera: those of its images. Writes nothing.

    Raises:
        InputError: the file is not a COLMAP database, contains none of the images, or has a camera with
            images of several cameras of this run.
        UnsupportedModelError: no COLMAP model represents a lens exactly.
    """
    stored = read_database(path)
    owner = {name: camera for camera in cameras for name in camera.names}
    owners: dict[int, dict[str, Candidate | None]] = {}
    for name, number in stored.images:
        camera = owner.get(name)
        owners.setdefault(number, {})[camera.slug if camera is not None else ""] = camera
    updates: dict[int, ColmapCamera] = {}
    for number, found in sorted(owners.items()):
        usable = [
            one.calibration for one in found.values() if one is not None and one.calibration is not None
        ]
        if not usable or number not in stored.cameras:
            continue
        if len(found) > 1:
            names = " and ".join(sorted(slug or "images that are not here" for slug in found))
            raise InputError(
                f"its camera {number} is that of the images of {names}; extract features with one run a camera, as "
                "colmap.sh does, or with --ImageReader.single_camera 0",
                source=str(path),
            )
        updates[number] = usable[0].to_colmap()
    if not updates:
        raise InputError("it has none of these images under their names here", source=str(path))
    return change_of(path, stored, updates)


def _opensfm_datasets(cameras: Candidates, images: str) -> list[Dataset]:
    """Models by OpenSfM's camera names; if two cameras have the same name, by new names.

    In that case ``exif_overrides.json`` states the camera of each image (``extract_metadata`` applies it
    before it makes a camera for the image). Without a task, the images of all cameras are in the dataset.

    Raises:
        InputError: images that it has to tell apart by their names have the same.
    """
    models = {camera.slug: opensfm_camera(K) for camera, K in _given(cameras)}
    near = [camera for camera in cameras if camera.slug in models or not images]
    files: dict[str, bytes] = {}
    if len(near) == 1:
        # "all" applies to every image, whatever the camera's name.
        files[OPENSFM_MODELS] = _json({"all": models[near[0].slug]})
    elif not _sharing(near, opensfm_names):
        by_name = {
            f"v2 {name}": models[camera.slug]
            for camera, _ in _given(near)
            for name in sorted(opensfm_names(camera.states))
        }
        files[OPENSFM_MODELS] = _json(by_name)
    else:
        whose = {name.rsplit("/", 1)[-1]: camera.slug for camera in near for name in camera.names}
        if len(whose) < sum(len(camera.names) for camera in near):
            raise InputError(
                "OpenSfM takes two of these cameras for one, and knows images by their file names, of which some are "
                "equal: --task DIR makes a folder in which they differ"
            )
        files[OPENSFM_MODELS] = _json(models)
        files[OPENSFM_IMAGES] = _json({name: {"camera": slug} for name, slug in whose.items()})
    if images:
        config = _opensfm_config([camera for camera, _ in _given(near)])
        files |= {"config.yaml": config} if config else {}
    command = "bin/opensfm_run_all {place}" if images else f"put {' and '.join(files)} into OpenSfM's dataset"
    into = dict.fromkeys(models, images or OPENSFM_MODELS)
    return [Dataset(into=into, files=files, command=command)]


def _opensfm_config(cameras: Candidates) -> bytes:
    """Cameras that are kept fixed, or the standard deviations within which OpenSfM is to refine them, if all have one.

    It has one value for all cameras: the largest. The principal point is a fraction of the longer side, as its
    ``principal_point_sd``; focal and distortion parameters are those of its own models.
    """
    if all(one.allowed.use is Use.FIXED for one in cameras):
        return b"optimize_camera_parameters: no\n"
    known = [camera for camera in cameras if camera.allowed.sigma_focal is not None]
    if len(known) < len(cameras):
        return b""
    stds = [_std(camera.calibration) for camera in known if camera.calibration is not None]
    lines = {"exif_focal_sd": max(camera.allowed.sigma_focal or 0.0 for camera in known)}
    for name, of in (
        ("principal_point_sd", ("cx", "cy")),
        *((f"radial_distortion_{k}_sd", (k,)) for k in ("k1", "k2", "k3", "k4")),
        *((f"tangential_distortion_{p}_sd", (p,)) for p in ("p1", "p2")),
    ):
        found = [std[part] for std in stds for part in of if part in std]
        if found:
            lines[name] = max(found)
    return "".join(f"{name}: {value:.6g}\n" for name, value in lines.items()).encode()


def _std(calibration: Calibration) -> dict[str, float]:
    """Standard deviations by parameter, those of the principal point as a fraction of the longer side."""
    quality = calibration.quality
    if quality is None:
        return {}
    stated = quality.covariance.std if quality.covariance is not None else {}
    by = math.sqrt(quality.inflation)
    longer = max(calibration.intrinsics.image_size)
    return {
        name: value * by / (longer if name in {"cx", "cy"} else 1.0)
        for name, value in {**stated, **quality.std}.items()
    }


def _odm_datasets(cameras: Candidates, images: str) -> list[Dataset]:
    """Cameras that ODM tells apart together; those that it does not, and multispectral cameras, each alone.

    ODM places the images of one band and aligns those of the others to them (``get_primary_band_name`` and
    ``compute_band_maps`` in opendm/multispectral.py), so the bands of a camera are one dataset with the K of that band.
    It takes any two bands for those of one camera, and an image without a band for one of band RGB. ODM reads cameras
    only from the file given by ``--cameras``.
    """
    heads = [head for head in _heads(cameras) if _primary(head) is not None]
    plain = [camera for camera in cameras if not odm_band(camera.states[0])]
    shared = _sharing([one for one in plain if one.calibration is not None or not images], odm_names)
    rest = [camera for camera, _ in _given(plain) if camera.slug not in shared]
    parts = [
        *([rest] if rest else []),
        *([camera] for camera, _ in _given(plain) if camera.slug in shared),
        *heads,
    ]
    return [_odm_dataset(part, shared.get(part[0].slug), images, alone=len(parts) == 1) for part in parts]


def _odm_dataset(cameras: Candidates, twin: str | None, images: str, *, alone: bool) -> Dataset:
    primary = _primary(cameras) if odm_band(cameras[0].states[0]) else None
    given = [(primary, primary.calibration)] if primary is not None else _given(cameras)
    slug = "together" if len(given) > 1 else given[0][0].slug
    models = {name: _odm_camera(K) for one, K in given if K for name in sorted(odm_names(one.states))}
    options: dict[str, str | bool] = {}
    if all(one.allowed.use is Use.FIXED for one, _ in given):
        options["use-fixed-camera-params"] = True
    if primary is not None and len(cameras) > 1:
        options["primary-band"] = odm_band(primary.states[0])
    said = f"alone, for ODM does not tell it from {twin}" if twin is not None else ""
    if primary is not None and not alone:
        said = "alone, for ODM would take the other images for a band of this camera"
    flags = "".join(
        f" --{name}" + (f" {value}" if value is not True else "") for name, value in options.items()
    )
    name = "cameras.json" if images or alone else f"cameras.{slug}.json"
    files = {name: _json(models)}
    if images:
        # The options of a task for WebODM and NodeODM (POST /task/new).
        stated = {"cameras": json.dumps(models, separators=(",", ":")), **options}
        listed = [{"name": option, "value": value} for option, value in stated.items()]
        files["options.json"] = json.dumps(listed).encode() + b"\n"
        files["odm.sh"] = ODM_SCRIPT.format(options=flags).encode()
    return Dataset(
        into=dict.fromkeys((one.slug for one in cameras), images or name),
        files=files,
        command="sh {place}/odm.sh" if images else f"add the options --cameras {{place}}/{name}{flags}",
        folder="" if alone or not images else slug,
        said=said,
        primary=primary.slug if primary is not None else "",
    )


def _heads(cameras: Candidates) -> list[list[Candidate]]:
    """Multispectral cameras as lists of their bands.

    Those of a model are one camera if each band is there once. Otherwise units are told apart by their serial numbers.
    """
    heads: list[list[Candidate]] = []
    bands = [one for one in cameras if odm_band(one.states[0])]
    for members in _alike(bands, "make", "model"):
        units = [members] if _are_distinct(members) else _alike(members, "serial")
        heads += [
            part for one in units for part in ([one] if _are_distinct(one) else [[band] for band in one])
        ]
    return heads


def _alike(cameras: Candidates, *fields: str) -> list[list[Candidate]]:
    found: dict[tuple[str | None, ...], list[Candidate]] = {}
    for one in cameras:
        found.setdefault(tuple(getattr(one.states[0], field) for field in fields), []).append(one)
    return [*found.values()]


def _are_distinct(bands: Candidates) -> bool:
    return len({odm_band(one.states[0]) for one in bands}) == len(bands)


def _primary(head: Candidates) -> Candidate | None:
    """The band to place, of those with a K: green or blue as ODM itself chooses, else the first."""
    given = [camera for camera, _ in _given(head)]
    by_band = {odm_band(camera.states[0]).lower(): camera for camera in given}
    return next(
        (by_band[band] for band in ("green", "g", "blue", "b") if band in by_band), next(iter(given), None)
    )


def _odm_camera(calibration: Calibration) -> dict[str, str | int | float]:
    if isinstance(calibration.distortion, KannalaBrandt) and calibration.distortion.k4 != 0:
        raise UnsupportedModelError("ODM drops k4 of a fisheye model, and this one's is not 0")
    model = opensfm_camera(calibration)
    focal = (float(str(model["focal_x"])) + float(str(model["focal_y"]))) / 2
    return {**model, "focal": focal}


def _without_k4(original: Calibration, held: Calibration) -> Calibration:
    """A fisheye as ODM keeps it, with three coefficients."""
    if not isinstance(held.distortion, KannalaBrandt) or held.distortion.k4 == 0:
        return held
    fitted = refit(original, KannalaBrandt, terms=3)
    return fitted[0] if fitted is not None else held


def _sharing(
    cameras: Candidates, names_of: Callable[[Sequence[ImageMetadata]], Iterable[str]]
) -> dict[str, str]:
    """Cameras that have a name in common with another, of which one has a K: the other's slug by slug."""
    first: dict[str, Candidate] = {}
    found: dict[str, str] = {}
    for camera in sorted(cameras, key=lambda camera: camera.calibration is None):
        for name in names_of(camera.states):
            other = first.setdefault(name, camera)
            if other is not camera and other.calibration is not None:
                found[camera.slug] = other.slug
                found.setdefault(other.slug, camera.slug)
    return found


def _realityscan_datasets(cameras: Candidates, _images: str) -> list[Dataset]:
    """CSV with a row for each image by file name, for RealityScan's import of camera parameters."""
    head, rows = b"", b""
    # One camera at a time: a file states no image size, so what is in one has to be of one size to be read back.
    for camera, K in _given(cameras):
        named = [
            replace(K, camera=replace(K.camera, sub_camera=name.rsplit("/", 1)[-1])) for name in camera.names
        ]
        head, _, own = _encoded(named, "realitycapture_csv", REALITYSCAN_CSV).partition(b"\n")
        rows += own
    return [
        Dataset(
            into={camera.slug: REALITYSCAN_CSV for camera, _ in _given(cameras)},
            files={REALITYSCAN_CSV: head + b"\n" + rows},
            command=f"import {{place}}/{REALITYSCAN_CSV} as Internal/External camera parameters",
        )
    ]


def _encoded(cameras: Sequence[Calibration], form: str, name: str) -> bytes:
    return parsers.encode(cameras, form, name=name)[0]


def _one_file_each(suffix: str, form: str, command: str) -> Target:
    """A program that reads one file for each camera, named as the camera with a suffix."""

    def datasets(cameras: Candidates, _images: str) -> list[Dataset]:
        into = {camera.slug: f"{camera.slug}{suffix}" for camera, _ in _given(cameras)}
        files = {into[one.slug]: _encoded([K], form, into[one.slug]) for one, K in _given(cameras)}
        return [Dataset(into=into, files=files, command=command)]

    return Target(
        form=form, reads=(f"*{suffix}",), datasets=datasets, holds=lambda K: _encoded([K], form, suffix)
    )


TARGETS: Final[Mapping[Program, Target]] = {
    "colmap": Target(
        form="colmap_text",
        reads=("colmap.sh",),
        several="a list of images each, and one run of the extractor; or ``--database``, which changes the cameras of "
        f"a database that has the images already in one transaction; ``{RESTORE}`` restores them",
        datasets=_colmap_datasets,
        holds=Calibration.to_colmap,
        database=True,
    ),
    "opensfm": Target(
        form="opensfm",
        reads=(OPENSFM_MODELS, OPENSFM_IMAGES),
        several="by the names that OpenSfM gives cameras; where it gives two the same name (two units of a model, "
        f"bands, TIFFs with EXIF that only GDAL reads), ``{OPENSFM_IMAGES}`` states the camera of each image",
        holds=opensfm_camera,
        datasets=_opensfm_datasets,
        named=lambda metadata: min(opensfm_names([metadata])),
        task=True,
    ),
    "odm": Target(
        form="opensfm",
        models=(NoDistortion, BrownConrady, KannalaBrandt),
        reads=("cameras.json", "cameras.*.json"),
        several="by the names that ODM gives cameras; where it gives two the same name, these have a file or folder "
        "each, to be processed separately; the bands of a multispectral camera are one, with the K of the band "
        "that ODM places",
        holds=_odm_camera,
        adjusted=_without_k4,
        datasets=_odm_datasets,
        named=odm_name,
        task=True,
    ),
    "opencv": _one_file_each(
        ".opencv.yml", "opencv_storage", "open {place}/*.opencv.yml with cv2.FileStorage"
    ),
    "metashape": _one_file_each(
        ".metashape.xml",
        "agisoft_xml",
        "Tools ▸ Camera Calibration ▸ Initial ▸ Load the {place}/*.metashape.xml of each camera",
    ),
    "pix4d": _one_file_each(
        ".pix4d.cam",
        "pix4d_cam",
        "type the numbers of {place}/*.pix4d.cam into Image Properties Editor ▸ Camera Model ▸ Edit…",
    ),
    "realityscan": Target(
        form="realitycapture_csv",
        reads=(REALITYSCAN_CSV,),
        several="a row for each image",
        datasets=_realityscan_datasets,
        holds=lambda K: _encoded([K], "realitycapture_csv", REALITYSCAN_CSV),
    ),
    "ros": _one_file_each(
        ".ros.yaml", "ros_camera_info", "give {place}/*.ros.yaml to the driver as camera_info_url"
    ),
}
"""The programs that K can be handed to; the head of this module states how to add one."""
