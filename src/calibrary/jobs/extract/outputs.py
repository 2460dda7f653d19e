"""Output files of a run: one K per camera, the report, and the solver's files."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError, UnsupportedModelError, UsageError, first_of
from calibrary.interop.colmap_database import DatabaseChange, write_database
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.hand_off import (
    RESTORE,
    TARGETS,
    UNJUDGED,
    HandedCamera,
    Nearest,
    TaskFolder,
    hand_off,
    lay_out,
    nearest,
    plan_database,
    refinement,
    task_folder,
)
from calibrary.jobs.extract.report import ExtractReport, Outputs, encode
from calibrary.pages import check_page_place
from calibrary.parsers.formats.k_npy import matrix_file
from calibrary.records import replace
from calibrary.validation import Verdict


def left_over(paths: Iterable[Path | str]) -> str:
    """Return the remark on files of an earlier run that this one does not write."""
    names = [str(path) for path in paths]
    are, them = ("is", "it") if len(names) == 1 else ("are", "them")
    return f"{first_of(names)} {are} left from an earlier run; remove {them}"


class Wanted(Struct, frozen=True, kw_only=True):
    """What a run is to write; arguments as of :func:`calibrary.jobs.extract.extract`."""

    out: Path | None = None
    to: Program | None = None
    database: Path | None = None
    task: Path | None = None
    copy_images: bool = False
    drop_distortion: bool = False
    html: Path | None = None

    @classmethod
    def checked(
        cls,
        *,
        out: str | Path | None,
        to: Program | None,
        database: str | Path | None,
        task: str | Path | None,
        copy_images: bool,
        drop_distortion: bool,
        html: str | Path | None,
    ) -> Wanted:
        """Check before the images are read that all of it can be written.

        Raises:
            UsageError: an argument lacks the one that it belongs to.
            InputError: a file must not be replaced, or its folder is not writable.
        """
        target = TARGETS.get(to) if to is not None else None
        with_database = [name for name, one in TARGETS.items() if one.database]
        with_task = [name for name, one in TARGETS.items() if one.datasets is not None]
        for is_bad, complaint in (
            (out is None and (to or html), "--to and --html go with --out FILE"),
            (
                database and not (target and target.database),
                f"--database is for --to {_either(with_database)}",
            ),
            (task and not (target and target.datasets), f"--task is for --to {_either(with_task)}"),
            (copy_images and not task, "--copy-images is for --task DIR"),
            (drop_distortion and not to, "--drop-distortion is for --to PROGRAM"),
        ):
            if is_bad:
                raise UsageError(complaint)
        if out is not None:
            check_place(Path(out))
        if task is not None:
            check_task_place(Path(task))
        return cls(
            out=Path(out) if out is not None else None,
            to=to,
            database=Path(database) if database is not None else None,
            task=Path(task) if task is not None else None,
            copy_images=copy_images,
            drop_distortion=drop_distortion,
            html=check_page_place(html),
        )

    def written(self, found: ExtractReport, *, dry_run: bool) -> ExtractReport:
        """Write it, each step at once or not at all, and return the report of it; a dry run writes nothing."""
        if self.out is None:
            return found
        report = plan(
            found,
            self.out,
            self.to,
            database=self.database,
            task=self.task,
            copied=self.copy_images,
            drop_distortion=self.drop_distortion,
        )
        planned = replace(report.outputs, is_dry_run=dry_run)
        report = replace(report, outputs=planned)
        if self.html is not None:
            from calibrary.jobs.extract.told import told  # noqa: PLC0415  draws with matplotlib
            from calibrary.pages import render_page  # noqa: PLC0415  as above

            planned.files[self.html] = render_page(told(report, checked=datetime.now(UTC).date())).encode()
        if not dry_run:
            if planned.task is not None:
                lay_out(planned.task)
            write_files(planned.files)
            if planned.database is not None:
                write_database(planned.database)
        return report


def _either(names: Sequence[str]) -> str:
    return " and --to ".join(names)


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


def plan(
    found: ExtractReport,
    matrix_path: Path,
    program: Program | None = None,
    *,
    database: Path | None = None,
    task: Path | None = None,
    copied: bool = False,
    drop_distortion: bool = False,
) -> ExtractReport:
    """Plan all files before any is written, and return the report with its ``outputs``.

    With one camera its valid K is written to ``matrix_path``; with several to ``<stem>.<camera>.npy`` in the
    same folder. An unproven K is written to ``<stem>_unproven.<camera>.npy`` and a self-calibration seed to
    ``<stem>_seed.<camera>.npy``, so that they are not mistaken for a valid K. Only a valid K is handed to a
    program; if that fails, K and the report are still written.

    Args:
        found: what is in the images.
        matrix_path: path of K.
        program: program that gets K.
        database: COLMAP database that gets the cameras.
        task: folder for ODM or OpenSfM, which gets the images and the solver's files.
        copied: whether its images are copies.
        drop_distortion: whether a program that takes an unknown distortion for none gets such a K.

    Raises:
        InputError: ``matrix_path`` is not a .npy, a file that may not be replaced exists, or a program needs
            the names of more images than are listed.
    """
    check_place(matrix_path)
    if program is not None and any(c.camera.count > len(c.camera.names) for c in found.judged):
        raise InputError(
            f"{program} needs the name of every image, which this run did not keep: list_images=True"
        )
    files, matrices = _matrices(found.judged, matrix_path)
    held, refused = _nearest(found.judged, program, drop_distortion=drop_distortion)
    handed_cameras = [_handed_camera(camera, held.get(camera.slug)) for camera in found.judged]
    handed: dict[str, bytes] = {}
    change, failed = None, None
    laid_out = None
    if task is not None and program is not None:
        laid_out = _task(program, handed_cameras, found.root, task, copied=copied)
    if isinstance(laid_out, str):
        laid_out, failed = None, laid_out
    elif laid_out is None and program is not None:
        handed, change, failed = _handed(program, handed_cameras, database)
    files |= {matrix_path.with_name(name): content for name, content in handed.items()}
    said = TARGETS[program].notes(handed) if program is not None and handed else ()
    if laid_out is not None:
        files |= laid_out.files
        said = laid_out.notes
    said = (*said, *(f"{slug}: {one.note}" for slug, one in held.items() if one.note and not failed))
    report_path = matrix_path.with_suffix(".json")
    if report_path in files:
        raise InputError(
            f"the report would be {report_path.name}, as is {program}'s own file; give another name",
            source=str(matrix_path),
            place="--out",
        )
    stale = tuple(path for path in _earlier(matrix_path, program) if path not in files)
    warnings = (
        *found.warnings,
        *((left_over(path.name for path in stale),) if stale else ()),
        *_refusals(program, refused),
        *((f"nothing is handed to {program}: {failed}",) if failed else ()),
        *said,
    )
    is_handed = bool(handed or laid_out)
    refine = {
        c.slug: refinement(c) if held[c.slug].is_exact else f"{held[c.slug]}; {refinement(c)}"
        for c in handed_cameras
        if c.calibration and is_handed
    }
    exit_code = 1 if failed else found.exit_code
    report = replace(
        found,
        cameras=tuple(replace(one, output=matrices.get(one.id)) for one in found.cameras),
        warnings=warnings,
        exit_code=exit_code,
        outputs=Outputs(
            files=files,
            report=report_path,
            matrices=matrices,
            stale=stale,
            not_handed_over=refused,
            hand_off_failed=failed,
            hand_off_notes=said,
            refine=refine,
            database=change,
            task=laid_out,
        ),
    )
    files[report_path] = encode(report)
    for path in files:
        _check_replaceable(path)
    return report


def _refusals(program: Program | None, refused: Mapping[str, str]) -> Iterator[str]:
    """The cameras that a program does not get, those with one reason together."""
    reasons: dict[str, list[str]] = {}
    for slug, why in refused.items():
        reasons.setdefault(why, []).append(slug)
    for why, slugs in reasons.items():
        yield f"{first_of(slugs)} {'is' if len(slugs) == 1 else 'are'} not handed to {program}: {why}"


def _matrices(cameras: Sequence[JudgedCamera], matrix_path: Path) -> tuple[dict[Path, bytes], dict[str, str]]:
    """K files by path, and their names by camera slug."""
    alone, stem = len(cameras) == 1, matrix_path.stem
    files: dict[Path, bytes] = {}
    matrices: dict[str, str] = {}
    for camera in cameras:
        path = matrix_path if alone else matrix_path.with_suffix(f".{camera.slug}.npy")
        if camera.calibration is not None:
            place = path if camera.verdict is Verdict.VALID else _marked(path, stem, "unproven")
            files[place] = matrix_file(camera.calibration)
            matrices[camera.slug] = place.name
        if camera.fallback is not None and camera.fallback.seed is not None:
            files[_marked(path, stem, "seed")] = matrix_file(camera.fallback.seed)
    return files, matrices


def _marked(path: Path, stem: str, word: str) -> Path:
    """File name of a matrix that is not a valid K."""
    return path.with_name(path.name.replace(stem, f"{stem}_{word}", 1))


def _handed(
    program: Program, cameras: Sequence[HandedCamera], database: Path | None
) -> tuple[dict[str, bytes], DatabaseChange | None, str | None]:
    """The program's files and the change of its database, or the reason why there are none."""
    try:
        files = dict(hand_off(program, cameras))
        if database is None or not files:
            return files, None, None
        change = plan_database(database, cameras)
    except (InputError, UnsupportedModelError) as error:
        return {}, None, str(error)
    return {**files, RESTORE: change.restore}, change, None


def _task(
    program: Program, cameras: Sequence[HandedCamera], root: Path, folder: Path, *, copied: bool
) -> TaskFolder | str:
    """The task folder, or the reason why there is none."""
    try:
        return task_folder(program, cameras, root, folder, copied=copied)
    except (InputError, UnsupportedModelError) as error:
        return str(error)


def check_place(matrix_path: Path) -> None:
    """Check before the images are read that K can be written.

    Raises:
        InputError: the name is not a .npy, or its folder is not writable.
    """
    if matrix_path.suffix != ".npy":
        raise InputError("expected a name ending in .npy", source=str(matrix_path), place="--out")
    check_folder(matrix_path, place="--out")
    _check_replaceable(matrix_path)


def _check_replaceable(path: Path) -> None:
    """Refuse to replace a protected file.

    Raises:
        InputError: the path is a link or a read-only file.
    """
    try:
        found = path.lstat()
    except OSError:
        return
    if stat.S_ISLNK(found.st_mode):
        raise InputError(
            "is a link, which writing would replace; remove it, or give another name", source=str(path)
        )
    if not found.st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH):
        raise InputError("is write-protected; make it writable, or give another name", source=str(path))


def _earlier(matrix_path: Path, program: Program | None) -> Iterator[Path]:
    """Existing files at the output paths of such a run: an old K must not be mistaken for a result of this run."""
    stem = re.escape(matrix_path.stem)
    ours = re.compile(rf"{stem}(_seed|_unproven)?(\..+)?\.npy")
    for path in sorted(matrix_path.parent.iterdir()) if matrix_path.parent.is_dir() else ():
        if ours.fullmatch(path.name) or _is_of(path.name, program):
            yield path


def _is_of(name: str, program: Program | None) -> bool:
    return program is not None and any(fnmatchcase(name, pattern) for pattern in TARGETS[program].reads)


def _nearest(
    cameras: Sequence[JudgedCamera], program: Program | None, *, drop_distortion: bool
) -> tuple[dict[str, Nearest], dict[str, str]]:
    """What a program can represent of each camera, and why it must not get a camera's K, by slug."""
    held: dict[str, Nearest] = {}
    refused: dict[str, str] = {}
    if program is None:
        return held, refused
    for camera in cameras:
        if camera.calibration is None or camera.verdict is not Verdict.VALID:
            refused[camera.slug] = "no valid K"
            continue
        try:
            held[camera.slug] = nearest(program, camera.calibration, drop_distortion=drop_distortion)
        except UnsupportedModelError as error:
            refused[camera.slug] = error.message
    return held, refused


def _handed_camera(camera: JudgedCamera, held: Nearest | None) -> HandedCamera:
    """A camera for a program, with its K only if the program may and can use it."""
    allowed = camera.use or UNJUDGED
    return HandedCamera(
        slug=camera.slug,
        calibration=held.calibration if held is not None else None,
        allowed=held.allows(allowed) if held is not None else allowed,
        states=tuple(state.metadata for state in camera.camera.states),
        names=camera.camera.names,
    )
