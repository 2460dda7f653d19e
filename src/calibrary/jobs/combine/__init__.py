"""Combine several calibrations of one camera into one, if they agree.

>>> from calibrary.jobs.combine import combine
>>> result = combine(["fleet/cameras/dji/fc6310r/5472x3648.yaml"])
>>> result.verdict, result.findings[0].rule
(<BoardVerdict.PROVISIONAL: 'provisional'>, 'unknown-uncertainty')
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from calibrary.arguments import CameraLike, File, FormatName, Place, Reading, Stated, paths
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.jobs.combine.report import CombinationReport

__all__ = ["combine"]


def combine(
    sources: File | Sequence[File],
    *,
    reading: Reading | None = None,
    camera: CameraLike | None = None,
    stated: Stated | None = None,
    html: File | None = None,
    out: File | None = None,
    to: FormatName | None = None,
    registry: Place | None = None,
    as_: Annotated[str, Meta(title="KEY")] | None = None,
    progress: Progress | None = None,
) -> CombinationReport:
    """Combine several calibrations of one camera, weighted by their covariances, if they agree.

    Flights are solved together by their observations: one lens, which may drift, and the rest of each flight apart.
    They count as one calibration beside files. The result becomes an entry with
    ``open_registry(registry).propose_entries(result.entry)``.

    Args:
        sources: files with a covariance, the JSON that calibrate --json prints, KEY[@REV] of entries, or folders, each
            with the images of a flight or with its reconstruction by COLMAP, OpenSfM or ODM. A single one is only
            checked.
        reading: settings for the files, and which camera of files with several.
        camera: facts about the camera that the files do not state or state wrongly.
        stated: day and operator of the combination (default: the day of the latest calibration).
        html: a page with each calibration and the plot of fx.
        out: K and distortion as a calibration file; not written if the combination is refused.
        to: format of ``out``, or the program that reads it (default: by its suffix).
        registry: the registry in which it becomes a draft, and that of the entries named in ``sources``.
        as_: it is for the camera of this entry.
        progress: called with (done, total, what) for each part of the work on flights.

    Raises:
        UsageError: there is a format, but no file of it.
        CalibrationError: the images of a flight cannot be matched, or do not determine a camera.
        InputError: a file cannot be read, or contains several cameras and none was chosen.
        RegistryError: an entry does not exist.
    """
    from calibrary.jobs.calibrate.outputs import Outputs
    from calibrary.jobs.calibrate.run import Told, not_in_future, stated_camera
    from calibrary.jobs.combine.page import combination_page
    from calibrary.jobs.combine.run import combined, solved_together
    from calibrary.jobs.combine.sources import Source, read_flights, read_sources

    outputs = Outputs.of(html=html, out=out, to=to)
    told = Told(camera=stated_camera(camera, registry, as_), stated=not_in_future(stated))
    given = paths(sources)
    folders = [one for one in given if one.is_dir()]
    read = read_sources([str(one) for one in given if one not in folders], reading or Reading(), registry)
    flights = read_flights(folders, told, progress) if folders else []
    report = solved_together(flights, told) if len(flights) > 1 else None
    if report is not None and (not read or report.calibration is None):
        return outputs.write(report, combination_page)
    if report is not None and report.calibration is not None:
        read.append(Source(label="the flights together", calibration=report.calibration))
    read += [
        Source(label=label, calibration=one.calibrated(told)[0].calibration)
        for label, one in flights
        if report is None
    ]
    return outputs.write(combined(read, told), combination_page)
