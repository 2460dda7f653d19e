"""K in the form that each program needs: files and command lines, in the program's own conventions.

COLMAP's origin is the outer corner of the first pixel, as in calibrary. ``PINHOLE`` is for images known to be
free of distortion, ``OPENCV`` and ``FULL_OPENCV`` include it; an unknown distortion starts from zero in
``OPENCV``, to be found by bundle adjustment (COLMAP's documentation of camera models). OpenSfM and ODM count
from the image centre in units of the longer side. OpenCV's origin is the centre of the first pixel.

To add a program:

1. Add its name to ``Program`` in :mod:`calibrary.jobs.extract`, which makes it a word of ``--to``. Where the name
   stands for a calibration format too (:mod:`calibrary.parsers`), it is the same.
2. Add a row to :data:`TARGETS`, at the end of this module: :func:`_one_file_each` if the program reads one file of a
   calibration format for each camera; else a function that makes its files by name.
3. Run ``tests/jobs/extract/test_hand_off.py``: it makes each program's files for each lens, and names a program without
   a row, and a row whose files are not of its patterns or have no K.

``--to``, its help, completion and the manual's list (``make docs``) follow.
"""

from __future__ import annotations

import errno
import json
import math
import os
import shlex
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
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
from calibrary.jobs.export.opensfm_names import odm_names, opensfm_names
from calibrary.jobs.extract import Program
from calibrary.jobs.images.places import is_url
from calibrary.jobs.use import Allowed, Use
from calibrary.parsers.discovery import format_named
from calibrary.parsers.fit import DEFAULT_MAX_ERROR_PX, adapt, compare, refit
from calibrary.parsers.format import FREE_LENS, UNKNOWN_LENS, Fidelity, Fit, in_words
from calibrary.parsers.opensfm_models import opensfm_camera
from calibrary.probability import two_digits
from calibrary.records import encoded, replace

OPENSFM_MODELS: Final = "camera_models_overrides.json"
OPENSFM_IMAGES: Final = "exif_overrides.json"
REALITYSCAN_CSV: Final = "realityscan.csv"
RESTORE: Final = "colmap.database-before.sql"
START_ERROR: Final = 0.005
"""Largest error of a start as a fraction of the image's diagonal: what a nominal focal length is off."""
FIXED_ERROR_PX: Final = 0.5
"""Largest error of a K that is kept fixed, that of the shipped policies."""
READ_BY_ODM: Final = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp"})
"""``context.supported_extensions``; OpenSfM reads these too."""
ODM_SCRIPT: Final = """\
#!/bin/sh
# usage: sh odm.sh [more options of ODM]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
name=$(basename "$here")
exec docker run --rm -v "$(dirname "$here"):/datasets" opendronemap/odm \\
  --project-path /datasets "$name" --cameras "/datasets/$name/cameras.json"{fixed} "$@"
"""

Files: TypeAlias = Mapping[str, bytes]
"""Content by file name."""


UNJUDGED: Final = Allowed(use=Use.START, why="how well it is known was not judged")


class HandedCamera(Struct, frozen=True, kw_only=True):
    """One camera of the run, as needed for a program.

    Attributes:
        slug: its name in file names.
        calibration: its K, None without a usable one.
        allowed: what the program may do with it.
        states: metadata of its images; some programs derive a camera's name from EXIF.
        names: its images, relative to the image directory.
    """

    slug: str
    calibration: Calibration | None
    allowed: Allowed = UNJUDGED
    states: tuple[ImageMetadata, ...]
    names: tuple[str, ...]


Cameras: TypeAlias = Sequence[HandedCamera]
"""All cameras of the run, because a K must not be applied to another camera's images."""


class Dataset(Struct, frozen=True):
    """A folder that a program processes on its own.

    Attributes:
        folder: name of the sub-folder of a task; empty for the task's own folder.
        cameras: whose images are in it.
        files: beside the images.
    """

    folder: str
    cameras: Cameras
    files: Files


def _nothing(files: Files) -> tuple[str, ...]:  # noqa: ARG001  the form of a target's notes
    return ()


class Target(Struct, frozen=True, kw_only=True):
    """A program that gets K, as a row of :data:`TARGETS`.

    Attributes:
        form: the calibration format that has the program's models.
        models: lens models of the program, if they are not all of that format; preferred ones first.
        reads: patterns of the names of the files that it reads K from, ``*`` for a camera; those of an earlier run are
            reported.
        several: how the cameras of a run are kept apart, for the manual.
        files: makes them for the cameras of a run, at least one of which has a K.
        holds: converts one calibration; raises UnsupportedModelError if the program cannot represent it exactly.
        adjusted: makes what that format can represent (of the original) what the program can; None if it is the same.
        notes: what its user must know about the files that were made.
        datasets: distributes the cameras and files of a ``--task`` to folders and adds the options that make the
            program use them; None if the program does not process a folder as it is.
        database: whether K can be written into its database (``--database``).
    """

    form: str
    models: tuple[type[Distortion], ...] = ()
    reads: tuple[str, ...]
    several: str = "a file each"
    files: Callable[[Cameras], Files]
    holds: Callable[[Calibration], object]
    adjusted: Callable[[Calibration, Calibration], Calibration] | None = None
    notes: Callable[[Files], tuple[str, ...]] = _nothing
    datasets: Callable[[Cameras, Files], Sequence[Dataset]] | None = None
    database: bool = False


def hand_off(program: Program, cameras: Cameras) -> Files:
    """Make the files for one program, by name; empty if no camera has a K.

    Raises:
        UnsupportedModelError: the program cannot represent a camera exactly, or cannot distinguish two cameras.
        InputError: an image name cannot be written to a list of names.
    """
    return TARGETS[program].files(cameras) if _usable(cameras) else {}


class Nearest(Struct, frozen=True, kw_only=True):
    """What a program can represent of a calibration.

    Attributes:
        calibration: the nearest one that it can.
        fit: how far its projections are from the original's; None if it is the original.
        unknown: what it says of a distortion that is unknown; None if the distortion is known, or stays unknown.
    """

    calibration: Calibration
    fit: Fit | None = None
    unknown: str | None = None

    @property
    def is_exact(self) -> bool:
        """Whether K and a known lens are the original's."""
        return self.fit is None or self.fit.exact

    def __str__(self) -> str:
        said = (self.unknown,) if self.unknown is not None else ()
        if self.fit is None:
            return in_words(Fidelity.EXACT, 0.0, 0.0)
        fit = self.fit
        return in_words(fit.outcome, fit.rms_px, fit.max_px, fit.compared_px, said, fit.lost_px)

    @property
    def note(self) -> str | None:
        """What its user must know of the difference; None if there is none that matters."""
        if self.fit is None or self.fit.max_px <= DEFAULT_MAX_ERROR_PX:
            return None
        by = f"by max {two_digits(self.fit.max_px)} px, rms {two_digits(self.fit.rms_px)} px"
        return f"its files represent this K and lens {by} off, with {self.fit.model}: nearer it has none"

    def allows(self, allowed: Allowed) -> Allowed:
        """What the program may do with it: a K that is off by more than it is known to is refined."""
        if allowed.use is not Use.FIXED or self.fit is None or self.fit.max_px <= FIXED_ERROR_PX:
            return allowed
        return replace(
            allowed, use=Use.START, why=f"the program's lens model is off by {two_digits(self.fit.max_px)} px"
        )


def nearest(program: Program, calibration: Calibration, *, drop_distortion: bool = False) -> Nearest:
    """The nearest calibration that a program can represent, with the error that it has.

    Args:
        program: the program.
        calibration: the original.
        drop_distortion: whether a program that takes an unknown distortion for none gets it.

    Raises:
        UnsupportedModelError: it is too far away even to start from.
    """
    target = TARGETS[program]
    limit = START_ERROR * math.hypot(*calibration.intrinsics.image_size)
    capacity = format_named(target.form).capacity
    assert capacity is not None  # noqa: S101  a format that is written has one
    if target.models:
        capacity = replace(capacity, models=target.models)
    # A larger error is not offered: what is farther away is no start.
    held = adapt(calibration, capacity, max_error_px=limit, drop_distortion=drop_distortion, offers=False)
    if target.adjusted is not None:
        held = target.adjusted(calibration, held)
    target.holds(held)
    if held == calibration:
        return Nearest(calibration=held)
    unknown = None
    if calibration.distortion is None and held.distortion is not None:
        unknown = FREE_LENS if held.distortion.names() else UNKNOWN_LENS
    return Nearest(calibration=held, fit=compare(calibration, held), unknown=unknown)


def refinement(camera: HandedCamera) -> str:
    """Which parameters of a camera a bundle adjustment should refine."""
    if camera.allowed.use is Use.FIXED:
        return f"keep fixed: {camera.allowed.why}"
    what = "the focal length only"
    if camera.calibration is None or not isinstance(camera.calibration.distortion, NoDistortion):
        what = "focal length and distortion"
    return f"refine {what}: {camera.allowed.why}"


def _usable(cameras: Cameras) -> list[tuple[HandedCamera, Calibration]]:
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


def _colmap_files(cameras: Cameras) -> Files:
    lists = {f"colmap.{camera.slug}.txt": _image_list(camera) for camera, _ in _usable(cameras)}
    return {"colmap.sh": _colmap_script(_usable(cameras)).encode(), **lists}


def _image_list(camera: HandedCamera) -> bytes:
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


def _colmap_script(cameras: Sequence[tuple[HandedCamera, Calibration]]) -> str:
    lines = [
        "#!/bin/sh",
        "# usage: sh colmap.sh IMAGE_DIR DATABASE   (from the folder of this script)",
        "# One run of the extractor a camera: K of one camera is wrong for every other.",
        "set -eu",
    ]
    for camera, calibration in cameras:
        lines += ["", f"# {calibration.camera} ({calibration.grade}); {refinement(camera)}"]
        lines.append(
            f'colmap feature_extractor --database_path "$2" --image_path "$1" '
            f"--image_list_path {shlex.quote(f'colmap.{camera.slug}.txt')} "
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


def plan_database(path: Path, cameras: Cameras) -> DatabaseChange:
    """Find the rows of a COLMAP database that get the K of each camera: those of its images. Writes nothing.

    Raises:
        InputError: the file is not a COLMAP database, contains none of the images, or has a camera with
            images of several cameras of this run.
        UnsupportedModelError: no COLMAP model represents a lens exactly.
    """
    stored = read_database(path)
    owner = {name: camera for camera in cameras for name in camera.names}
    owners: dict[int, dict[str, HandedCamera | None]] = {}
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


def _opensfm_files(cameras: Cameras) -> Files:
    """Models by OpenSfM's camera names; if two cameras have the same name, by new names.

    In that case ``exif_overrides.json`` states the camera of each image (``extract_metadata`` applies it
    before it makes a camera for the image).
    """
    models = {camera.slug: opensfm_camera(K) for camera, K in _usable(cameras)}
    if len(cameras) == 1:
        # "all" applies to every image, whatever the camera's name.
        return {OPENSFM_MODELS: _json({"all": next(iter(models.values()))})}
    try:
        named = _under_every_name(cameras, models, opensfm_names, "opensfm")
        return {OPENSFM_MODELS: _json({f"v2 {name}": model for name, model in named.items()})}
    except UnsupportedModelError:
        whose = {name.rsplit("/", 1)[-1]: camera.slug for camera in cameras for name in camera.names}
        if len(whose) < sum(len(camera.names) for camera in cameras):
            raise
    images = {name: {"camera": slug} for name, slug in whose.items()}
    return {OPENSFM_MODELS: _json(models), OPENSFM_IMAGES: _json(images)}


def _opensfm_notes(files: Files) -> tuple[str, ...]:
    if OPENSFM_IMAGES not in files:
        return ()
    return (
        f"OpenSfM does not distinguish these cameras by itself: put {OPENSFM_IMAGES}, which says of each image "
        f"whose it is, beside {OPENSFM_MODELS} before extract_metadata",
    )


def _opensfm_datasets(cameras: Cameras, files: Files) -> Sequence[Dataset]:
    """OpenSfM finds its files by name."""
    config = {"config.yaml": content} if (content := _opensfm_config(cameras)) else {}
    return [Dataset("", cameras, {**files, **config})]


def _opensfm_config(cameras: Cameras) -> bytes:
    """Cameras that are kept fixed, or the standard deviations within which OpenSfM is to refine them, if all have one.

    It has one value for all cameras: the largest. The principal point is a fraction of the longer side, as its
    ``principal_point_sd``; focal and distortion parameters are those of its own models.
    """
    if _all_fixed(cameras):
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


def _odm_files(cameras: Cameras) -> Files:
    """One file; if ODM uses the same name for two cameras, one file for each, to be processed separately."""
    models = {camera.slug: _odm_camera(K) for camera, K in _usable(cameras)}
    try:
        return {"cameras.json": _json(_under_every_name(cameras, models, odm_names, "odm"))}
    except UnsupportedModelError:
        return {
            f"cameras.{camera.slug}.json": _json(_under_every_name([camera], models, odm_names, "odm"))
            for camera, _ in _usable(cameras)
        }


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


def _odm_notes(files: Files) -> tuple[str, ...]:
    if "cameras.json" in files:
        return ()
    names = ", ".join(sorted(files))
    return (
        f"ODM does not distinguish these cameras: process the images of each alone, with --cameras ({names})",
    )


def _odm_datasets(cameras: Cameras, files: Files) -> Sequence[Dataset]:
    """ODM reads cameras only from the file given by ``--cameras``.

    ``odm.sh`` passes it to the container, and ``options.json`` contains the ``options`` of a task for WebODM and
    NodeODM (``POST /task/new``).
    """
    alone = [
        (camera.slug, [camera], content)
        for camera in cameras
        if (content := files.get(f"cameras.{camera.slug}.json")) is not None
    ]
    parts = [("", cameras, files["cameras.json"])] if "cameras.json" in files else alone
    made = []
    for folder, part, content in parts:
        compact = json.dumps(json.loads(content), separators=(",", ":"))
        options: list[dict[str, str | bool]] = [{"name": "cameras", "value": compact}]
        if fixed := _all_fixed(part):
            options.append({"name": "use-fixed-camera-params", "value": True})
        script = ODM_SCRIPT.format(fixed=" --use-fixed-camera-params" if fixed else "")
        files_beside = {
            "cameras.json": content,
            "options.json": json.dumps(options).encode() + b"\n",
            "odm.sh": script.encode(),
        }
        made.append(Dataset(folder, part, files_beside))
    return made


def _all_fixed(cameras: Cameras) -> bool:
    return all(one.allowed.use is Use.FIXED for one in cameras)


def _under_every_name(
    cameras: Cameras,
    models: Mapping[str, Mapping[str, object]],
    names_of: Callable[[Sequence[ImageMetadata]], Iterable[str]],
    program: Program,
) -> dict[str, Mapping[str, object]]:
    """The models under all names that the program may give to their cameras; unused names do no harm.

    Raises:
        UnsupportedModelError: two cameras have a common name, so that images of one would get the other's K.
    """
    named: dict[str, HandedCamera] = {}
    for camera in sorted(cameras, key=lambda camera: camera.slug not in models):
        for name in sorted(names_of(camera.states)):
            other = named.get(name)
            if other is not None:
                raise UnsupportedModelError(
                    f"{program} knows cameras by words of EXIF, and {other.slug} and {camera.slug} are both "
                    f"{name!r}: put the images of each into a folder of its own"
                )
            if camera.slug in models:
                named[name] = camera
    return {name: models[camera.slug] for name, camera in named.items()}


def _realityscan_files(cameras: Cameras) -> Files:
    """CSV with a row for each image by file name, for RealityScan's import of camera parameters."""
    head, rows = b"", b""
    # One camera at a time: a file states no image size, so what is in one has to be of one size to be read back.
    for camera, K in _usable(cameras):
        named = [
            replace(K, camera=replace(K.camera, sub_camera=name.rsplit("/", 1)[-1])) for name in camera.names
        ]
        head, _, own = _encoded(named, "realitycapture_csv", REALITYSCAN_CSV).partition(b"\n")
        rows += own
    return {REALITYSCAN_CSV: head + b"\n" + rows}


def _encoded(cameras: Sequence[Calibration], form: str, name: str) -> bytes:
    return parsers.encode(cameras, form, name=name)[0]


def _one_file_each(suffix: str, form: str) -> Target:
    """A program that reads one file for each camera, named as the camera with a suffix."""

    def files(cameras: Cameras) -> Files:
        return {
            f"{camera.slug}{suffix}": _encoded([K], form, f"{camera.slug}{suffix}")
            for camera, K in _usable(cameras)
        }

    return Target(form=form, reads=(f"*{suffix}",), files=files, holds=lambda K: _encoded([K], form, suffix))


class TaskFolder(Struct, frozen=True, kw_only=True):
    """Content of a task folder: a folder that a program processes as it is, with images, cameras and options.

    Attributes:
        files: content by path.
        images: source path of each image, by its path in the task.
        copied: whether images are copied; otherwise hard links are made, which take no space and work in a
            container.
        notes: on its use.
    """

    files: dict[Path, bytes]
    images: dict[Path, Path]
    copied: bool
    notes: tuple[str, ...]


def task_folder(
    program: Program, cameras: Cameras, root: Path, folder: Path, *, copied: bool = False
) -> TaskFolder:
    """Plan a task's files and images; writes nothing.

    ODM and OpenSfM read ``images/`` of a dataset without its sub-folders (``get_images`` in stages/dataset.py),
    so images from several folders are put into one, under distinct names.

    Args:
        program: one with datasets.
        cameras: all cameras of the run.
        root: folder that the image names are relative to.
        folder: of the task; with a sub-folder for each camera if ODM cannot distinguish two cameras.
        copied: whether to copy the images.

    Raises:
        InputError: an image is not a local file, or two images would have the same name.
        UnsupportedModelError: the program cannot represent a camera exactly.
    """
    target = TARGETS[program]
    flat = _flat_names([name for camera in cameras for name in camera.names])
    handed = hand_off(
        program, [replace(one, names=tuple(flat[name] for name in one.names)) for one in cameras]
    )
    datasets = target.datasets(cameras, handed) if target.datasets is not None and handed else ()
    left = [name for name in flat if Path(name).suffix.lower() not in READ_BY_ODM]
    wanted = {name: to for name, to in flat.items() if name not in left}
    files: dict[Path, bytes] = {}
    images: dict[Path, Path] = {}
    for dataset in datasets:
        place = folder / dataset.folder
        files |= {place / name: content for name, content in dataset.files.items()}
        for name in (name for camera in dataset.cameras for name in camera.names if name in wanted):
            images[place / "images" / wanted[name]] = _file(root, name)
    said = [*target.notes(handed)] if len(datasets) == 1 else [APART] if datasets else []
    if left and datasets:
        said.append(f"{len(left)} images are not in the task, for {program} does not read {_suffixes(left)}")
    return TaskFolder(files=files, images=images, copied=copied, notes=tuple(said))


APART: Final = "ODM does not distinguish these cameras: each has a folder of its own, to be processed alone"


def lay_out(task: TaskFolder) -> None:
    """Put the images into the task's folders.

    Raises:
        InputError: an image cannot be linked or copied; none is left there then.
    """
    done: list[Path] = []
    try:
        for to, source in task.images.items():
            to.parent.mkdir(parents=True, exist_ok=True)
            if task.copied:
                shutil.copy2(source, to)
            else:
                os.link(os.path.realpath(source), to)
            done.append(to)
    except OSError as error:
        for path in done:
            with suppress(OSError):
                path.unlink()
        other_disk = error.errno in {errno.EXDEV, errno.EPERM, errno.ENOTSUP} and not task.copied
        remedy = "; --copy-images copies them" if other_disk else ""
        verb = "copied" if task.copied else "linked"
        raise InputError(
            f"cannot be {verb} into the task: {error.strerror}{remedy}", source=str(source)
        ) from None


def _flat_names(names: Sequence[str]) -> dict[str, str]:
    """Distinct names for the images in a single folder: the file names, or if these are not unique, with their folders.

    Raises:
        InputError: an image is behind a URL, or two names are still equal.
    """
    for name in names:
        if is_url(name):
            raise InputError("is not a file of this machine, which a task could link or copy", source=name)
    flat = {name: name.rsplit("/", 1)[-1] for name in names}
    if len(set(flat.values())) < len(flat):
        flat = {name: name.lstrip("/").replace("/", "_") for name in names}
    [(most, count)] = Counter(flat.values()).most_common(1) or [("", 0)]
    if count > 1:
        twins = [name for name, to in flat.items() if to == most]
        raise InputError(f"would have the name of {twins[0]} in the task; rename one", source=twins[1])
    return flat


def _file(root: Path, name: str) -> Path:
    path = root / name
    if not path.is_file():
        raise InputError("is not a file of this machine, which a task could link or copy", source=name)
    return path


def _suffixes(names: Iterable[str]) -> str:
    return ", ".join(sorted({Path(name).suffix.lower() for name in names}))


TARGETS: Final[Mapping[Program, Target]] = {
    "colmap": Target(
        form="colmap_text",
        reads=("colmap.sh",),
        several="a list of images each, and one run of the extractor; or ``--database``, which changes the cameras of "
        f"a database that has the images already in one transaction; ``{RESTORE}`` restores them",
        files=_colmap_files,
        holds=Calibration.to_colmap,
        database=True,
    ),
    "opensfm": Target(
        form="opensfm",
        reads=(OPENSFM_MODELS, OPENSFM_IMAGES),
        several="by the names that OpenSfM gives cameras; where it gives two the same name (two units of a model, "
        f"bands, TIFFs with EXIF that only GDAL reads), ``{OPENSFM_IMAGES}`` states the camera of each image",
        files=_opensfm_files,
        holds=opensfm_camera,
        notes=_opensfm_notes,
        datasets=_opensfm_datasets,
    ),
    "odm": Target(
        form="opensfm",
        models=(NoDistortion, BrownConrady, KannalaBrandt),
        reads=("cameras.json", "cameras.*.json"),
        several="by the names that ODM gives cameras; where it gives two the same name, a file each: process the "
        "images of each separately",
        files=_odm_files,
        holds=_odm_camera,
        adjusted=_without_k4,
        notes=_odm_notes,
        datasets=_odm_datasets,
    ),
    "opencv": _one_file_each(".opencv.yml", "opencv_storage"),
    "metashape": _one_file_each(".metashape.xml", "agisoft_xml"),
    "pix4d": _one_file_each(".pix4d.cam", "pix4d_cam"),
    "realityscan": Target(
        form="realitycapture_csv",
        reads=(REALITYSCAN_CSV,),
        several="a row for each image",
        files=_realityscan_files,
        holds=lambda K: _encoded([K], "realitycapture_csv", REALITYSCAN_CSV),
    ),
    "ros": _one_file_each(".ros.yaml", "ros_camera_info"),
}
"""The programs that K can be handed to; the head of this module states how to add one."""
