"""A task folder that ODM, WebODM or OpenSfM can process directly: images, cameras, options.

ODM and OpenSfM read ``images/`` of a dataset without its sub-folders (``get_images`` in stages/dataset.py),
so images from several folders are put into one, under distinct names. ODM reads cameras only from the file
given by ``--cameras``: ``odm.sh`` passes it to the container, and ``options.json`` contains the ``options``
of a task for WebODM and NodeODM (``POST /task/new``). OpenSfM finds its files by name.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.atomic import check_folder
from calibrary.errors import InputError
from calibrary.jobs.extract.hand_off import Candidate, Solver, hand_off, is_fixed, notes
from calibrary.jobs.images.places import is_url
from calibrary.records import replace

__all__ = ["TASKS", "TaskFolder", "check_task_place", "lay_out", "task_folder"]

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
