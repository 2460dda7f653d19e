"""Output files of a run: one K per camera, the report, and the solver's files."""

from __future__ import annotations

import io
import re
import stat
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from msgspec import Struct, field

from calibrary.atomic import check_folder
from calibrary.calibration import Calibration
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.interop.colmap_database import DatabaseChange
from calibrary.jobs.extract.extraction import CameraReport, Extraction
from calibrary.jobs.extract.hand_off import (
    RESTORE,
    SOLVER_FILES,
    TASKS,
    Candidate,
    DatabaseCamera,
    Solver,
    TaskFolder,
    colmap_camera,
    hand_off,
    notes,
    plan_database,
    refinement,
    refusal,
    task_folder,
)
from calibrary.jobs.extract.report import encode, report_of
from calibrary.records import replace
from calibrary.validation import Verdict

__all__ = ["STALE", "Outputs", "check_place", "plan"]

STALE = "is left from an earlier run; remove it"


class Outputs(Struct, frozen=True, kw_only=True):
    """Files to be written.

    Attributes:
        files: content by path.
        matrices: name of the K file by camera slug.
        report: the JSON report, also in ``files``.
        stale: K and solver files of an earlier run that this run does not replace.
        not_handed_over: reason why the solver does not get a camera's K, by slug.
        hand_off_failed: reason why the solver gets nothing; None if it gets something.
        hand_off_notes: notes on the use of the solver's files.
        refine: which parameters a bundle adjustment should refine, by slug.
        database: change to be written to a COLMAP database.
        task: folder for a solver, its files also in ``files``.
        exit_code: of the run; 1 also if a requested hand-off failed.
        warnings: all warnings of the run, including those on the outputs.
    """

    files: dict[Path, bytes]
    matrices: dict[str, str]
    report: bytes
    stale: tuple[Path, ...] = ()
    not_handed_over: dict[str, str] = field(default_factory=dict)
    hand_off_failed: str | None = None
    hand_off_notes: tuple[str, ...] = ()
    refine: dict[str, str] = field(default_factory=dict)
    database: DatabaseChange | None = None
    task: TaskFolder | None = None
    exit_code: int = 0
    warnings: tuple[str, ...] = ()


def plan(
    outcome: Extraction,
    matrix_path: Path,
    solver: Solver,
    *,
    database: Path | None = None,
    task: Path | None = None,
    copied: bool = False,
) -> Outputs:
    """Plan all files before any is written.

    With one camera its valid K is written to ``matrix_path``; with several to ``<stem>.<camera>.npy`` in the
    same folder. An unproven K is written to ``<stem>_unproven.<camera>.npy`` and a self-calibration seed to
    ``<stem>_seed.<camera>.npy``, so that they are not mistaken for a valid K. Only a valid K is handed to a
    solver; if that fails, K and the report are still written.

    Args:
        outcome: result of the run.
        matrix_path: path of K.
        solver: program that gets K.
        database: COLMAP database that gets the cameras.
        task: folder for ODM or OpenSfM, which gets the images and the solver's files.
        copied: whether its images are copies.

    Raises:
        InputError: ``matrix_path`` is not a .npy, a file that may not be replaced exists, or a solver needs
            the names of more images than are listed.
    """
    check_place(matrix_path)
    if solver is not Solver.NONE and any(c.camera.count > len(c.camera.names) for c in outcome.cameras):
        raise InputError(
            f"{solver} needs the name of every image, which this run did not keep: list_images=True"
        )
    files, matrices = _matrices(outcome, matrix_path)
    refused = {c.slug: why for c in outcome.cameras if (why := _reason_not_written(c, solver)) is not None}
    candidates = [_candidate(camera, refused=camera.slug in refused) for camera in outcome.cameras]
    handed: dict[str, bytes] = {}
    change, failed = None, None
    laid_out = _task(solver, candidates, outcome.root, task, copied=copied) if task is not None else None
    if isinstance(laid_out, str):
        laid_out, failed = None, laid_out
    elif laid_out is None:
        handed, change, failed = _handed(solver, candidates, database)
    files |= {matrix_path.with_name(name): content for name, content in handed.items()}
    said = notes(solver, handed)
    if laid_out is not None:
        files |= laid_out.files
        said = laid_out.notes
    report_path = matrix_path.with_suffix(".json")
    if report_path in files:
        raise InputError(
            f"the report would be {report_path.name}, as is {solver}'s own file; give another name",
            source=str(matrix_path),
            place="--output-matrix",
        )
    stale = tuple(path for path in _earlier(matrix_path, solver) if path not in files)
    warnings = (
        *outcome.warnings,
        *(f"{path.name} {STALE}" for path in stale),
        *(f"{slug} is not handed to {solver}: {why}" for slug, why in refused.items()),
        *((f"nothing is handed to {solver}: {failed}",) if failed else ()),
        *said,
    )
    is_handed = bool(handed or laid_out)
    refine = {c.slug: refinement(c.calibration) for c in candidates if c.calibration and is_handed}
    exit_code = 1 if failed else outcome.exit_code
    report = encode(replace(report_of(outcome, matrices), warnings=warnings, exit_code=exit_code))
    files[report_path] = report
    for path in files:
        _check_replaceable(path)
    return Outputs(
        files=files,
        matrices=matrices,
        report=report,
        stale=stale,
        not_handed_over=refused,
        hand_off_failed=failed,
        hand_off_notes=said,
        refine=refine,
        database=change,
        task=laid_out,
        exit_code=exit_code,
        warnings=warnings,
    )


def _matrices(outcome: Extraction, matrix_path: Path) -> tuple[dict[Path, bytes], dict[str, str]]:
    """K files by path, and their names by camera slug."""
    alone, stem = len(outcome.cameras) == 1, matrix_path.stem
    files: dict[Path, bytes] = {}
    matrices: dict[str, str] = {}
    for camera in outcome.cameras:
        path = matrix_path if alone else matrix_path.with_suffix(f".{camera.slug}.npy")
        if camera.calibration is not None:
            place = path if camera.verdict is Verdict.VALID else _marked(path, stem, "unproven")
            files[place] = _npy(camera.calibration)
            matrices[camera.slug] = place.name
        if camera.fallback is not None and camera.fallback.seed is not None:
            files[_marked(path, stem, "seed")] = _npy(camera.fallback.seed)
    return files, matrices


def _marked(path: Path, stem: str, word: str) -> Path:
    """File name of a matrix that is not a valid K."""
    return path.with_name(path.name.replace(stem, f"{stem}_{word}", 1))


def _handed(
    solver: Solver, candidates: Sequence[Candidate], database: Path | None
) -> tuple[dict[str, bytes], DatabaseChange | None, str | None]:
    """The solver's files and the change of its database, or the reason why there are none."""
    try:
        files = hand_off(solver, candidates)
        if database is None or not files:
            return files, None, None
        rows = [
            DatabaseCamera(
                slug=one.slug,
                camera=colmap_camera(one.calibration) if one.calibration is not None else None,
                names=one.names,
            )
            for one in candidates
        ]
        change = plan_database(database, rows)
    except (InputError, UnsupportedModelError) as error:
        return {}, None, str(error)
    return {**files, RESTORE: change.restore}, change, None


def _task(
    solver: Solver, candidates: Sequence[Candidate], root: Path, folder: Path, *, copied: bool
) -> TaskFolder | str:
    """The task folder, or the reason why there is none."""
    if solver not in TASKS:
        raise InputError(f"a task's folder is for {' or '.join(sorted(TASKS))}", place="--task")
    try:
        return task_folder(solver, candidates, root, folder, copied=copied)
    except (InputError, UnsupportedModelError) as error:
        return str(error)


def check_place(matrix_path: Path) -> None:
    """Check before the images are read that K can be written.

    Raises:
        InputError: the name is not a .npy, or its folder is not writable.
    """
    if matrix_path.suffix != ".npy":
        raise InputError("expected a name ending in .npy", source=str(matrix_path), place="--output-matrix")
    check_folder(matrix_path, place="--output-matrix")
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


def _earlier(matrix_path: Path, solver: Solver) -> Iterator[Path]:
    """Existing files at the output paths of such a run: an old K must not be mistaken for a result of this run."""
    stem = re.escape(matrix_path.stem)
    ours = re.compile(rf"{stem}(_seed|_unproven)?(\..+)?\.npy")
    for path in sorted(matrix_path.parent.iterdir()) if matrix_path.parent.is_dir() else ():
        if ours.fullmatch(path.name) or _is_of(path.name, solver):
            yield path


def _is_of(name: str, solver: Solver) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in SOLVER_FILES.get(solver, ()))


def _reason_not_written(camera: CameraReport, solver: Solver) -> str | None:
    """Reason why the solver must not get a camera's K; None if it may."""
    if solver is Solver.NONE:
        return None
    if camera.calibration is None or camera.verdict is not Verdict.VALID:
        return "no valid K"
    return refusal(solver, camera.calibration)


def _candidate(camera: CameraReport, *, refused: bool) -> Candidate:
    """A camera for a solver, with its K only if the solver may and can use it."""
    return Candidate(
        slug=camera.slug,
        calibration=None if refused else camera.calibration,
        states=tuple(state.metadata for state in camera.camera.states),
        names=camera.camera.names,
    )


def _npy(calibration: Calibration) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, calibration.intrinsics.matrix, allow_pickle=False)
    return buffer.getvalue()
