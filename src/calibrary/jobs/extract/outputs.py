"""Output files of a run: one K per camera, the report, and the solver's files."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError, UnsupportedModelError, UsageError, first_of
from calibrary.interop.colmap_database import write_database
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.hand_off import HandOff, candidate_of, hand_off, lay_out
from calibrary.jobs.extract.report import ExtractReport, Outputs, encode
from calibrary.jobs.extract.targets import RESTORE, TARGETS, plan_database
from calibrary.pages import check_page_place
from calibrary.parsers.formats.numpy_arrays import matrix_file
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
    include_unproven: bool = False
    html: Path | None = None

    def check(self) -> None:
        """Check before the images are read that all of it can be written.

        Raises:
            UsageError: an argument lacks the one that it belongs to.
            InputError: a file must not be replaced, or its folder is not writable.
        """
        target = TARGETS[self.to] if self.to is not None else None
        with_database = [name for name, one in TARGETS.items() if one.database]
        with_task = [name for name, one in TARGETS.items() if one.task]
        for is_bad, complaint in (
            (self.out is None and (target or self.html), "--to and --html go with --out FILE"),
            (
                self.database and not (target and target.database),
                f"--database is for --to {_either(with_database)}",
            ),
            (self.task and not (target and target.task), f"--task is for --to {_either(with_task)}"),
            (self.copy_images and not self.task, "--copy-images is for --task DIR"),
            (self.drop_distortion and not target, "--drop-distortion is for --to PROGRAM"),
            (self.include_unproven and not target, "--include-unproven is for --to PROGRAM"),
        ):
            if is_bad:
                raise UsageError(complaint)
        if self.out is not None:
            check_place(self.out)
        if self.task is not None:
            check_task_place(self.task)
        check_page_place(self.html)

    def written(self, found: ExtractReport, *, dry_run: bool) -> ExtractReport:
        """Write it, each step at once or not at all, and return the report of it; a dry run writes nothing."""
        if self.out is None:
            return found
        report = self.plan(found)
        planned = replace(report.outputs, is_dry_run=dry_run)
        report = replace(report, outputs=planned)
        if self.html is not None:
            from calibrary.jobs.extract.told import told  # noqa: PLC0415  draws with matplotlib
            from calibrary.pages import render_page  # noqa: PLC0415  as above

            planned.files[self.html] = render_page(told(report, checked=datetime.now(UTC).date())).encode()
        if not dry_run:
            if report.hand_off is not None:
                lay_out(report.hand_off)
            write_files(planned.files)
            if planned.database is not None:
                write_database(planned.database)
        return report

    def plan(self, found: ExtractReport) -> ExtractReport:
        """Plan all files before any is written, and return the report with its ``outputs``.

        With one camera its valid K is written to ``out``; with several to ``<stem>.<camera>.npy`` in the same folder.
        An unproven K is written to ``<stem>_unproven.<camera>.npy`` and a self-calibration seed to
        ``<stem>_seed.<camera>.npy``, so that they are not mistaken for a valid K. If nothing can be handed to a
        program, K and the report are still written.

        Raises:
            InputError: ``out`` is not a .npy, a file that may not be replaced exists, or a program needs the names of
                more images than are listed.
        """
        matrix_path, program = self.out or Path(), self.to
        check_place(matrix_path)
        if program is not None and any(c.camera.count > len(c.camera.names) for c in found.judged):
            raise InputError(
                f"{program} needs the name of every image, which this run did not keep: list_images=True"
            )
        files, matrices = _matrices(found.judged, matrix_path)
        handed, change = None, None
        if program is not None:
            cameras = [
                candidate_of(
                    camera,
                    program,
                    drop_distortion=self.drop_distortion,
                    include_unproven=self.include_unproven,
                )
                for camera in found.judged
            ]
            try:
                handed = hand_off(
                    program,
                    cameras,
                    root=found.root,
                    folder=matrix_path.parent,
                    task=self.task,
                    copied=self.copy_images,
                )
                files |= handed.files
                if self.database is not None and handed.files:
                    change = plan_database(self.database, cameras)
                    files[matrix_path.with_name(RESTORE)] = change.restore
            except (InputError, UnsupportedModelError) as error:
                files, matrices = _matrices(found.judged, matrix_path)
                handed = HandOff(program=program, failed=str(error))
        report_path = matrix_path.with_suffix(".json")
        if report_path in files:
            raise InputError(
                f"the report would be {report_path.name}, as is {program}'s own file; give another name",
                source=str(matrix_path),
                place="--out",
            )
        stale = tuple(path for path in _earlier(matrix_path, program) if path not in files)
        failed = handed.failed if handed is not None else None
        warnings = (
            *found.warnings,
            *((left_over(path.name for path in stale),) if stale else ()),
            *((f"nothing is handed to {program}: {failed}",) if failed else ()),
        )
        report = replace(
            found,
            cameras=tuple(replace(one, output=matrices.get(one.id)) for one in found.cameras),
            warnings=warnings,
            exit_code=1 if failed else found.exit_code,
            hand_off=handed,
            outputs=Outputs(
                files=files,
                report=report_path,
                matrices=matrices,
                stale=stale,
                database=change,
            ),
        )
        files[report_path] = encode(report)
        for path in files:
            _check_replaceable(path)
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
