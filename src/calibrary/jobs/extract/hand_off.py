"""The plan of what a program gets: which images, under which name, with which K, and which stay out and why."""

from __future__ import annotations

import errno
import math
import os
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.targets import TARGETS, UNJUDGED, Candidate, Candidates, Dataset, refinement
from calibrary.jobs.images.places import is_url
from calibrary.jobs.use import Allowed
from calibrary.parsers.discovery import format_named
from calibrary.parsers.fit import adapt, compare
from calibrary.parsers.format import FREE_LENS, UNKNOWN_LENS, Fidelity, Fit, in_words
from calibrary.probability import two_digits
from calibrary.records import Record, replace
from calibrary.validation import Use, Verdict

START_ERROR: Final = 0.005
"""Largest error of a start as a fraction of the image's diagonal: what a nominal focal length is off."""
FIXED_ERROR_PX: Final = 0.5
"""Largest error of a K that is kept fixed, that of the shipped policies."""
READ_BY_SOLVERS: Final = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp"})
"""``context.supported_extensions`` of ODM; OpenSfM reads these too."""


class HandedCamera(Record):
    """What a program gets of one camera.

    Attributes:
        camera: its ``id`` in the report.
        images: number of its images.
        use: what the program may do with its K; ``none`` if it does not get it.
        into: file or folder that it is in; None if it stays out.
        name: name that the program gives it, if it names cameras.
        why: why it may be used so, or stays out.
    """

    camera: str
    images: int
    use: Use
    into: str | None
    name: str | None
    why: str


class HandOff(Record):
    """Plan of what a program gets of a run.

    Attributes:
        program: its name.
        cameras: all of the run, those that stay out too.
        commands: what to run, or to do with the files.
        failed: why the program gets nothing; None if it gets something, or no camera has a K for it.
        files: content by path.
        images: source path of each image of a task, by its path there.
        copied: whether images are copied; otherwise hard links are made, which take no space and work in a
            container.
    """

    _unwritten = frozenset({"files", "images", "copied"})

    program: str
    cameras: tuple[HandedCamera, ...] = ()
    commands: tuple[str, ...] = ()
    failed: str | None = None
    files: Mapping[Path, bytes] = {}
    images: Mapping[Path, Path] = {}
    copied: bool = False


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

    def __str__(self) -> str:
        said = (self.unknown,) if self.unknown is not None else ()
        if self.fit is None:
            return in_words(Fidelity.EXACT, 0.0, 0.0)
        fit = self.fit
        return in_words(fit.outcome, fit.rms_px, fit.max_px, fit.compared_px, said, fit.lost_px)

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


def candidate_of(
    camera: JudgedCamera, program: Program, *, drop_distortion: bool = False, include_unproven: bool = False
) -> Candidate:
    """A camera with its K as the program holds it, if the program may and can use it.

    Args:
        camera: of the run.
        program: that gets it.
        drop_distortion: whether a program that takes an unknown distortion for none gets such a K.
        include_unproven: whether an unproven K is handed on as a start.
    """
    allowed, K = camera.use or UNJUDGED, camera.calibration
    if allowed.use is Use.NONE and camera.verdict is Verdict.UNPROVEN and include_unproven:
        allowed = Allowed(use=Use.START, why="its K is unproven, and was asked for")
    one = Candidate(
        slug=camera.slug,
        calibration=None,
        allowed=allowed,
        states=tuple(state.metadata for state in camera.camera.states),
        names=camera.camera.names,
    )
    if K is None:
        return replace(one, said="it has no K")
    if allowed.use is Use.NONE:
        offered = "unproven; --include-unproven hands it on as a start"
        return replace(one, said=offered if camera.verdict is Verdict.UNPROVEN else allowed.why)
    try:
        held = nearest(program, K, drop_distortion=drop_distortion)
    except UnsupportedModelError as error:
        return replace(one, said=error.message)
    said = "" if held.fit is None or held.fit.exact else str(held)
    return replace(one, calibration=held.calibration, allowed=held.allows(allowed), said=said)


def hand_off(
    program: Program,
    cameras: Candidates,
    *,
    root: Path,
    folder: Path,
    task: Path | None = None,
    copied: bool = False,
) -> HandOff:
    """Plan what a program gets; writes nothing.

    ODM and OpenSfM read ``images/`` of a dataset without its sub-folders (``get_images`` in stages/dataset.py),
    so a task's images from several folders are put into one, under distinct names.

    Args:
        program: that gets it.
        cameras: all cameras of the run.
        root: folder that the image names are relative to.
        folder: of the files.
        task: folder that the program processes as it is, with a sub-folder for each of several datasets.
        copied: whether to copy a task's images.

    Raises:
        InputError: an image name cannot be written to a list, or is not a local file or another's twin in a task.
        UnsupportedModelError: the program cannot represent a camera exactly.
    """
    target = TARGETS[program]
    flat = _flat_names([name for one in cameras for name in one.names]) if task is not None else {}
    named = [replace(one, names=tuple(flat.get(name, name) for name in one.names)) for one in cameras]
    given = any(one.calibration is not None for one in cameras)
    datasets = target.datasets(named, "images" if task is not None else "") if given else ()
    files: dict[Path, bytes] = {}
    images: dict[Path, Path] = {}
    commands = []
    rows = {
        one.slug: HandedCamera(
            camera=one.slug, images=len(one.names), use=Use.NONE, into=None, name=None, why=one.said
        )
        for one in cameras
    }
    for dataset in datasets:
        place = (task if task is not None else folder) / dataset.folder
        commands.append(dataset.command.format(place=place, images=root))
        files |= {place / name: content for name, content in dataset.files.items()}
        for one in (one for one in cameras if one.slug in dataset.into):
            names = [
                name for name in one.names if task is None or Path(name).suffix.lower() in READ_BY_SOLVERS
            ]
            rows[one.slug] = _handed(program, one, len(names), dataset, place)
            if task is not None:
                images |= {place / "images" / flat[name]: _file(root, name) for name in names}
    return HandOff(
        program=program,
        cameras=tuple(rows.values()),
        commands=tuple(commands),
        files=files,
        images=images,
        copied=copied,
    )


def _handed(program: Program, one: Candidate, images: int, dataset: Dataset, place: Path) -> HandedCamera:
    named = TARGETS[program].named
    use, said = one.allowed.use, [dataset.said, one.said, refinement(one)]
    if dataset.primary not in {"", one.slug}:
        use, said = Use.NONE, [f"its K is not needed: {program} aligns it to the images of {dataset.primary}"]
    unread = sorted({Path(name).suffix.lower() for name in one.names} - READ_BY_SOLVERS)
    if images < len(one.names):
        said.append(
            f"{len(one.names) - images} more stay out, for {program} does not read {', '.join(unread)}"
        )
    return HandedCamera(
        camera=one.slug,
        images=images,
        use=use,
        into=str(place / dataset.into[one.slug]),
        name=named(one.states[0]) if named is not None else None,
        why="; ".join(part for part in said if part),
    )


def lay_out(plan: HandOff) -> None:
    """Put the images into a task's folders.

    Raises:
        InputError: an image cannot be linked or copied; none is left there then.
    """
    done: list[Path] = []
    try:
        for to, source in plan.images.items():
            to.parent.mkdir(parents=True, exist_ok=True)
            if plan.copied:
                shutil.copy2(source, to)
            else:
                os.link(os.path.realpath(source), to)
            done.append(to)
    except OSError as error:
        for path in done:
            with suppress(OSError):
                path.unlink()
        other_disk = error.errno in {errno.EXDEV, errno.EPERM, errno.ENOTSUP} and not plan.copied
        remedy = "; --copy-images copies them" if other_disk else ""
        verb = "copied" if plan.copied else "linked"
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
