"""Calibration from another program's finished reconstruction: its observations, our adjustment and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from calibrary.arrays import BoolArray
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict_rules import graver_first
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.extras import programs
from calibrary.jobs.calibrate.flight_images import MOST_POINTS, FlightOptions, SolvedFlight, described
from calibrary.jobs.calibrate.frames import FrameMetadata, Told, describe_frames, without_resaved
from calibrary.jobs.files import choose
from calibrary.parsers.imagery.taken import Fix, fix_of
from calibrary.progress import stage
from calibrary.records import replace
from calibrary.sfm.adjust import adjust
from calibrary.sfm.colmap_folder import is_colmap_folder, read_colmap
from calibrary.sfm.control import with_survey
from calibrary.sfm.geodesy import LocalFrame
from calibrary.sfm.image_selection import RECEIVER_STD_M, geodetic
from calibrary.sfm.nuisances import readout_of
from calibrary.sfm.opensfm_folder import is_opensfm_folder, read_opensfm
from calibrary.sfm.reconstruction import Reconstruction, scene_of
from calibrary.sfm.tracks import FEWEST_IMAGES, Positions, thinned
from calibrary.validation import Finding, Severity

MOST_IMAGES: Final = 60
"""Largest number of images of a reconstruction; more than of a flight, because their points are already matched."""


def solve_reconstruction(
    folder: Path, images: Sequence[Path], told: Told, options: FlightOptions, *, camera: int | None = None
) -> SolvedFlight:
    """Adjust a camera of a finished reconstruction.

    Args:
        folder: COLMAP's sparse model, or OpenSfM's or ODM's result.
        images: its images, which state their camera and positions; empty if they are not available.
        told: what the user states of them.
        options: how to solve; its ``start`` is not used, the program's own camera is.
        camera: number of the camera, from 1, if the reconstruction has several and no images are given.

    Raises:
        InputError: the folder cannot be read, or the camera is ambiguous.
        CalibrationError: its images do not determine a camera.
    """
    if not (is_colmap_folder(folder) or is_opensfm_folder(folder)):
        raise InputError(
            "expected a folder with COLMAP's sparse model (cameras, images, points3D; .bin or .txt), or with OpenSfM's "
            "or ODM's reconstruction.json and tracks.csv",
            source=str(folder),
        )
    with stage(f"read {folder.name}"):
        model = read_colmap(folder) if is_colmap_folder(folder) else read_opensfm(folder)
    images, resaved = without_resaved(images)
    taken, paths = _taken(model, images, camera)
    metadata = describe_frames([*paths.values()], told) if paths else FrameMetadata(setting=None)
    positions, frame = _positions(model, paths)
    model = replace(model, positions=positions or model.positions)
    survey = options.survey
    shown = survey.points_of(model.plain_names) if survey is not None else {}
    tracks, start, stated = scene_of(model, taken, options.images, shown)
    with stage(f"adjusted {len(tracks.point)} observations"):
        tracks = thinned(tracks, MOST_POINTS)
        if survey is not None:
            tracks, start = with_survey(tracks, start, survey, frame)
        found = adjust(
            tracks,
            start,
            model=options.model,
            shared_frame=frame is not None,
            readout_s=readout_of(next(iter(paths.values()), None)),
        )
    return SolvedFlight(
        found=found,
        about=described({name: paths.get(name) for name in tracks.names}, tracks.image_size, metadata, told),
        scale=max(1.0, max(tracks.image_size) / model.looked_px),
        chosen=f"{len(tracks.names)} of {int(taken.sum())} of this camera in the result of {model.program}",
        left_out=int(taken.sum()) - len(tracks.names),
        versions=programs(),
        survey=survey,
        skipped=resaved.remarks,
        notes=(*metadata.notes, *resaved.notes),
        finish=lambda result: _of_program(result, model, stated),
    )


def _taken(
    model: Reconstruction, images: Sequence[Path], camera: int | None
) -> tuple[BoolArray, dict[str, Path]]:
    """Return (V,) which images are of the selected camera, and the available image files by name."""
    if not images:
        cameras = sorted(model.cameras)
        chosen = choose(
            [model.cameras[name] for name in cameras],
            camera,
            source=model.program,
            how="--camera N, or give the folder of one camera's images",
        )
        return model.of_camera(next(name for name in cameras if model.cameras[name] is chosen)), {}
    names = model.plain_names
    by_name = {path.name: path for path in images}
    paths = {name: by_name[Path(name).name] for name in names if Path(name).name in by_name}
    if len(paths) < FEWEST_IMAGES:
        raise InputError(
            f"{len(paths)} of the {len(images)} images given are in the reconstruction, need {FEWEST_IMAGES}",
            source=str(images[0].parent),
        )
    return np.array([name in paths for name in names], dtype=np.bool_), paths


def _positions(model: Reconstruction, paths: dict[str, Path]) -> tuple[Positions | None, LocalFrame | None]:
    """Return the positions in the images' own metadata, and their frame; None for fewer than three."""
    fixes: dict[int, Fix] = {}
    for at, name in enumerate(model.plain_names):
        if name in paths and (fix := fix_of(paths[name])) is not None:
            fixes[at] = fix
    if len(fixes) < FEWEST_IMAGES:
        return None, None
    places, std = np.full((len(model.names), 3), np.nan), np.tile(RECEIVER_STD_M, (len(model.names), 1))
    rows = [*fixes]
    stated = geodetic([*fixes.values()])
    frame = LocalFrame.around(stated)
    places[rows] = frame.metres(stated)
    std[rows] = [fix.std_m or RECEIVER_STD_M for fix in fixes.values()]
    return Positions(places=places, std=std), frame


def _of_program(result: CalibrationResult, model: Reconstruction, stated: Calibration) -> CalibrationResult:
    """Add the program and its files to the provenance, and a note on the program's own fx."""
    ours, theirs = result.calibration.intrinsics, stated.intrinsics
    made = result.calibration.provenance
    calibration = replace(
        result.calibration,
        provenance=replace(
            made, sources=(*model.files, *made.sources), tool=f"{made.tool}, observations by {model.program}"
        ),
    )
    note = Finding(
        rule="other-program",
        severity=Severity.NOTE,
        measured=theirs.fx / ours.fx - 1,
        message=f"{model.program} states fx = {theirs.fx:.1f} px, which is {theirs.fx / ours.fx - 1:+.2%} from the "
        f"{ours.fx:.1f} px that its own observations give here",
    )
    return replace(result, calibration=calibration, findings=graver_first((*result.findings, note)))
