"""K in the form that each solver needs: files and command lines, in the solver's own conventions.

COLMAP's origin is the outer corner of the first pixel, as in calibrary. ``PINHOLE`` is for images known to be
free of distortion, ``OPENCV`` and ``FULL_OPENCV`` include it; an unknown distortion starts from zero in
``OPENCV``, to be found by bundle adjustment (COLMAP's documentation of camera models). OpenSfM and ODM count
from the image centre in units of the longer side. OpenCV's origin is the centre of the first pixel.
"""

from __future__ import annotations

import errno
import json
import os
import shlex
import shutil
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary import parsers
from calibrary.atomic import check_folder
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.interop.colmap import ColmapCamera
from calibrary.interop.colmap_database import DatabaseChange, change_of, read_database
from calibrary.jobs.export.opensfm_names import odm_names, opensfm_names
from calibrary.jobs.images.places import is_url
from calibrary.parsers.opensfm_models import opensfm_camera
from calibrary.records import encoded, replace

__all__ = [
    "RESTORE",
    "SOLVER_FILES",
    "TASKS",
    "Candidate",
    "DatabaseCamera",
    "Solver",
    "TaskFolder",
    "check_task_place",
    "colmap_camera",
    "hand_off",
    "is_fixed",
    "lay_out",
    "notes",
    "plan_database",
    "refinement",
    "refusal",
    "seed_command",
    "task_folder",
]

OPENSFM_OVERRIDES = "exif_overrides.json"
REALITYSCAN_CSV = "realityscan.csv"
UNKNOWN_LENS = BrownConrady(k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
"""Initial value for bundle adjustment if the distortion is unknown."""


class Solver(StrEnum):
    """Program that gets the K."""

    COLMAP = "colmap"
    OPENSFM = "opensfm"
    ODM = "odm"
    OPENCV = "opencv"
    METASHAPE = "metashape"
    PIX4D = "pix4d"
    REALITYSCAN = "realityscan"
    NONE = "none"


ONE_FILE_EACH = {
    Solver.OPENCV: (".opencv.yml", "opencv_storage"),
    Solver.METASHAPE: (".metashape.xml", "agisoft_xml"),
    Solver.PIX4D: (".pix4d.cam", "pix4d_cam"),
}
"""Programs that use one file per camera: its suffix and format."""

SOLVER_FILES = {
    Solver.COLMAP: ("colmap.sh",),
    Solver.OPENSFM: ("camera_models_overrides.json", OPENSFM_OVERRIDES),
    Solver.ODM: ("cameras.json", "cameras.*.json"),
    Solver.REALITYSCAN: (REALITYSCAN_CSV,),
    **{solver: (f"*{suffix}",) for solver, (suffix, _) in ONE_FILE_EACH.items()},
}
"""Name patterns of the files from which a solver reads K."""


class Candidate(Struct, frozen=True, kw_only=True):
    """One camera of the run, as needed for a solver.

    Attributes:
        slug: its name in file names.
        calibration: its K, None without a usable one.
        states: metadata of its images; some solvers derive a camera's name from EXIF.
        names: its images, relative to the image directory.
    """

    slug: str
    calibration: Calibration | None
    states: tuple[ImageMetadata, ...]
    names: tuple[str, ...]


def hand_off(solver: Solver, cameras: Sequence[Candidate]) -> dict[str, bytes]:
    """Make the files for one solver, by name; empty if no camera has a K.

    Args:
        solver: the program.
        cameras: all cameras of the run, because a K must not be applied to another camera's images.

    Raises:
        UnsupportedModelError: the solver cannot represent a camera exactly, or cannot distinguish two cameras.
        InputError: an image name cannot be written to a list of names.
    """
    usable = [(camera, camera.calibration) for camera in cameras if camera.calibration is not None]
    if solver is Solver.NONE or not usable:
        return {}
    if solver is Solver.COLMAP:
        lists = {f"colmap.{camera.slug}.txt": _image_list(camera) for camera, _ in usable}
        return {"colmap.sh": _colmap_script(usable).encode(), **lists}
    if solver is Solver.OPENSFM:
        return _opensfm(cameras, {camera.slug: opensfm_camera(K) for camera, K in usable})
    if solver is Solver.ODM:
        return _odm_files(cameras, {camera.slug: _odm(K) for camera, K in usable})
    if solver is Solver.REALITYSCAN:
        return {REALITYSCAN_CSV: _realityscan(usable)}
    suffix, form = ONE_FILE_EACH[solver]
    files = {f"{camera.slug}{suffix}": K for camera, K in usable}
    return {name: parsers.encode([K], form, name=name)[0] for name, K in files.items()}


def notes(solver: Solver, files: Mapping[str, bytes]) -> tuple[str, ...]:
    """Notes on the use of the files."""
    if solver is Solver.OPENSFM and OPENSFM_OVERRIDES in files:
        return (
            f"OpenSfM does not distinguish these cameras by itself: put {OPENSFM_OVERRIDES}, which says of each image "
            "whose it is, beside camera_models_overrides.json before extract_metadata",
        )
    if solver is Solver.ODM and "cameras.json" not in files and files:
        names = ", ".join(sorted(files))
        return (
            f"ODM does not distinguish these cameras: process the images of each alone, with --cameras ({names})",
        )
    return ()


def is_fixed(calibration: Calibration) -> bool:
    """Whether K and distortion were measured, so that bundle adjustment should keep them fixed."""
    return calibration.grade in {Grade.CALIBRATED, Grade.ADJUSTED} and calibration.distortion is not None


def refinement(calibration: Calibration) -> str:
    """Which parameters of a camera a bundle adjustment should refine."""
    if is_fixed(calibration):
        return "keep fixed: it was measured"
    if isinstance(calibration.distortion, NoDistortion):
        return "refine the focal length only: it has no distortion"
    if calibration.distortion is None:
        return "refine focal length and distortion: the distortion is unknown and starts from zero"
    return "refine focal length and distortion: they were not measured on this unit"


def colmap_camera(calibration: Calibration) -> ColmapCamera:
    """Convert to a COLMAP camera; an unknown distortion becomes OPENCV with zero coefficients, never PINHOLE.

    Raises:
        UnsupportedModelError: no COLMAP model represents the lens exactly.
    """
    if calibration.distortion is None:
        return replace(calibration, distortion=UNKNOWN_LENS).to_colmap("OPENCV")
    return calibration.to_colmap()


def refusal(solver: Solver, calibration: Calibration) -> str | None:
    """Reason why a solver cannot represent a calibration exactly; None if it can."""
    try:
        if solver is Solver.COLMAP:
            colmap_camera(calibration)
        elif solver in {Solver.OPENSFM, Solver.ODM}:
            opensfm_camera(calibration)
        elif solver is Solver.REALITYSCAN:
            parsers.encode([calibration], "realitycapture_csv", name=REALITYSCAN_CSV)
        elif solver in ONE_FILE_EACH:
            suffix, form = ONE_FILE_EACH[solver]
            parsers.encode([calibration], form, name=suffix)
    except UnsupportedModelError as error:
        return error.message
    return None


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


def seed_command(seed: Calibration) -> str:
    """COLMAP commands for a self-calibration that starts from a seed."""
    return (
        "colmap feature_extractor --database_path database.db --image_path IMAGES "
        f"{_reader_options(seed)} && colmap exhaustive_matcher --database_path database.db && "
        "colmap mapper --database_path database.db --image_path IMAGES --output_path OUT "
        "--Mapper.ba_refine_focal_length 1 --Mapper.ba_refine_extra_params 1"
    )


def _reader_options(calibration: Calibration) -> str:
    # The source document starts a self-calibration from PINHOLE.
    is_seed = calibration.grade is Grade.SEED
    camera = calibration.to_colmap() if is_seed else colmap_camera(calibration)
    values = ",".join(repr(value) for value in camera.params)
    return (
        f"--ImageReader.single_camera 1 --ImageReader.camera_model {camera.model} "
        f'--ImageReader.camera_params "{values}"'
    )


def _colmap_script(cameras: Sequence[tuple[Candidate, Calibration]]) -> str:
    lines = [
        "#!/bin/sh",
        "# usage: sh colmap.sh IMAGE_DIR DATABASE   (from the folder of this script)",
        "# One run of the extractor a camera: K of one camera is wrong for every other.",
        "set -eu",
    ]
    for camera, calibration in cameras:
        lines += ["", f"# {calibration.camera} ({calibration.grade}); {refinement(calibration)}"]
        lines.append(
            f'colmap feature_extractor --database_path "$2" --image_path "$1" '
            f"--image_list_path {shlex.quote(f'colmap.{camera.slug}.txt')} {_reader_options(calibration)}"
        )
    refine = [not is_fixed(K) for _, K in cameras]
    flag, why = (
        ("1", "Not all was measured: let bundle adjustment find it with") if any(refine) else ("0", FIXED)
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


FIXED = "A measured K is not a start: keep bundle adjustment from moving it with"


def _opensfm(cameras: Sequence[Candidate], models: Mapping[str, Mapping[str, object]]) -> dict[str, bytes]:
    """Models by OpenSfM's camera names; if two cameras have the same name, by new names.

    In that case ``exif_overrides.json`` states the camera of each image (``extract_metadata`` applies it
    before it makes a camera for the image).
    """
    overrides = "camera_models_overrides.json"
    if len(cameras) == 1:
        # "all" applies to every image, whatever the camera's name.
        return {overrides: _json({"all": next(iter(models.values()))})}
    try:
        return {overrides: _json(_named(cameras, models, Solver.OPENSFM))}
    except UnsupportedModelError:
        whose = {name.rsplit("/", 1)[-1]: camera.slug for camera in cameras for name in camera.names}
        if len(whose) < sum(len(camera.names) for camera in cameras):
            raise
    images = {name: {"camera": slug} for name, slug in whose.items()}
    return {overrides: _json(models), OPENSFM_OVERRIDES: _json(images)}


def _odm_files(cameras: Sequence[Candidate], models: Mapping[str, Mapping[str, object]]) -> dict[str, bytes]:
    """One file; if ODM uses the same name for two cameras, one file for each, to be processed separately."""
    try:
        return {"cameras.json": _json(_named(cameras, models, Solver.ODM))}
    except UnsupportedModelError:
        usable = [camera for camera in cameras if camera.slug in models]
        return {
            f"cameras.{camera.slug}.json": _json(_named([camera], models, Solver.ODM)) for camera in usable
        }


def _realityscan(cameras: Sequence[tuple[Candidate, Calibration]]) -> bytes:
    """CSV with a row for each image by file name, for RealityScan's import of camera parameters."""
    rows = [
        replace(K, camera=replace(K.camera, sub_camera=name.rsplit("/", 1)[-1]))
        for camera, K in cameras
        for name in camera.names
    ]
    return parsers.encode(rows, "realitycapture_csv", name=REALITYSCAN_CSV)[0]


def _odm(calibration: Calibration) -> dict[str, str | int | float]:
    if isinstance(calibration.distortion, KannalaBrandt) and calibration.distortion.k4 != 0:
        raise UnsupportedModelError("ODM drops k4 of a fisheye model, and this one's is not 0")
    model = opensfm_camera(calibration)
    focal = (float(str(model["focal_x"])) + float(str(model["focal_y"]))) / 2
    return {**model, "focal": focal}


def _named(
    cameras: Sequence[Candidate], models: Mapping[str, Mapping[str, object]], solver: Solver
) -> dict[str, Mapping[str, object]]:
    """The models under all names that the solver may give to their cameras; unused names do no harm.

    Raises:
        UnsupportedModelError: two cameras have a common name, so that images of one would get the other's K.
    """
    names_of = odm_names if solver is Solver.ODM else opensfm_names
    named: dict[str, Candidate] = {}
    for camera in sorted(cameras, key=lambda camera: camera.slug not in models):
        for name in sorted(names_of(camera.states)):
            other = named.get(name)
            if other is not None:
                raise UnsupportedModelError(
                    f"{solver.value} knows cameras by words of EXIF, and {other.slug} and {camera.slug} are both "
                    f"{name!r}: put the images of each into a folder of its own"
                )
            if camera.slug in models:
                named[name] = camera
    prefix = "v2 " if solver is Solver.OPENSFM else ""
    return {prefix + name: models[camera.slug] for name, camera in named.items()}


def _json(document: Mapping[str, object]) -> bytes:
    return encoded(document) + b"\n"


RESTORE = "colmap.database-before.sql"


class DatabaseCamera(Struct, frozen=True, kw_only=True):
    """A camera for the database.

    Attributes:
        slug: name in messages.
        camera: in COLMAP's form; None without a usable K.
        names: its images, relative to the image directory.
    """

    slug: str
    camera: ColmapCamera | None
    names: tuple[str, ...]


def plan_database(path: Path, cameras: Sequence[DatabaseCamera]) -> DatabaseChange:
    """Find the rows of each camera; writes nothing.

    Raises:
        InputError: the file is not a COLMAP database, contains none of the images, or has a camera with
            images of several cameras of this run.
    """
    stored = read_database(path)
    owner = {name: camera for camera in cameras for name in camera.names}
    owners: dict[int, dict[str, DatabaseCamera | None]] = {}
    for name, number in stored.images:
        camera = owner.get(name)
        owners.setdefault(number, {})[camera.slug if camera is not None else ""] = camera
    updates: dict[int, ColmapCamera] = {}
    for number, found in sorted(owners.items()):
        usable = [one.camera for one in found.values() if one is not None and one.camera is not None]
        if not usable or number not in stored.cameras:
            continue
        if len(found) > 1:
            names = " and ".join(sorted(slug or "images that are not here" for slug in found))
            raise InputError(
                f"its camera {number} is that of the images of {names}; extract features with one run a camera, as "
                "colmap.sh does, or with --ImageReader.single_camera 0",
                source=str(path),
            )
        updates[number] = usable[0]
    if not updates:
        raise InputError("it has none of these images under their names here", source=str(path))
    return change_of(path, stored, updates)


TASKS: Final = frozenset({Solver.ODM, Solver.OPENSFM})
"""The solvers that process a task folder."""
READ_BY_ODM: Final = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp"})
"""``context.supported_extensions``; OpenSfM reads these too."""
SCRIPT: Final = """\
#!/bin/sh
# usage: sh odm.sh [more options of ODM]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
name=$(basename "$here")
exec docker run --rm -v "$(dirname "$here"):/datasets" opendronemap/odm \\
  --project-path /datasets "$name" --cameras "/datasets/$name/cameras.json"{fixed} "$@"
"""


class TaskFolder(Struct, frozen=True, kw_only=True):
    """Content of a task folder.

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


def check_task_place(folder: Path) -> None:
    """Check before the images are read that the folder can be created.

    Raises:
        InputError: it is not empty, or cannot be created.
    """
    if folder.is_dir() and not any(folder.iterdir()):
        return
    if os.path.lexists(folder):
        raise InputError("is there already; name a new or empty folder", source=str(folder), place="--task")
    check_folder(folder / "images", place="--task")


def task_folder(
    solver: Solver, cameras: Sequence[Candidate], root: Path, folder: Path, *, copied: bool = False
) -> TaskFolder:
    """Plan a task's files and images; writes nothing.

    Args:
        solver: ODM or OpenSfM.
        cameras: all cameras of the run.
        root: folder that the image names are relative to.
        folder: of the task; with a sub-folder for each camera if ODM cannot distinguish two cameras.
        copied: whether to copy the images.

    Raises:
        InputError: an image is not a local file, or two images would have the same name.
        UnsupportedModelError: the solver cannot represent a camera exactly.
    """
    flat = _flat_names([name for camera in cameras for name in camera.names])
    renamed = [replace(one, names=tuple(flat[name] for name in one.names)) for one in cameras]
    handed = hand_off(solver, renamed)
    if not handed:
        return TaskFolder(files={}, images={}, copied=copied, notes=())
    left = [name for name in flat if Path(name).suffix.lower() not in READ_BY_ODM]
    wanted = {name: to for name, to in flat.items() if name not in left}
    files: dict[Path, bytes] = {}
    images: dict[Path, Path] = {}
    for place, part, written in _parts(solver, cameras, handed, folder):
        files |= {place / name: content for name, content in _with_options(solver, part, written).items()}
        for name in (name for camera in part for name in camera.names if name in wanted):
            images[place / "images" / wanted[name]] = _file(root, name)
    said = [*notes(solver, handed)] if len({path.parent for path in files}) == 1 else [APART]
    if left:
        said.append(f"{len(left)} images are not in the task, for {solver} does not read {_suffixes(left)}")
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


def _parts(
    solver: Solver, cameras: Sequence[Candidate], handed: Mapping[str, bytes], folder: Path
) -> list[tuple[Path, Sequence[Candidate], Mapping[str, bytes]]]:
    """The folders of a task, each with its cameras and the solver's files."""
    if solver is Solver.OPENSFM or "cameras.json" in handed:
        return [(folder, cameras, handed)]
    return [
        (folder / camera.slug, [camera], {"cameras.json": handed[f"cameras.{camera.slug}.json"]})
        for camera in cameras
        if f"cameras.{camera.slug}.json" in handed
    ]


def _with_options(
    solver: Solver, cameras: Sequence[Candidate], handed: Mapping[str, bytes]
) -> dict[str, bytes]:
    """The solver's files, with the options that make it use them."""
    fixed = all(one.calibration is not None and is_fixed(one.calibration) for one in cameras)
    if solver is Solver.OPENSFM:
        return {**handed, **({"config.yaml": b"optimize_camera_parameters: no\n"} if fixed else {})}
    compact = json.dumps(json.loads(handed["cameras.json"]), separators=(",", ":"))
    options: list[dict[str, str | bool]] = [{"name": "cameras", "value": compact}]
    if fixed:
        options.append({"name": "use-fixed-camera-params", "value": True})
    script = SCRIPT.format(fixed=" --use-fixed-camera-params" if fixed else "")
    return {**handed, "options.json": json.dumps(options).encode() + b"\n", "odm.sh": script.encode()}


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
