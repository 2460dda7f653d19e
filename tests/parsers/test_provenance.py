"""Date, tool and operator of a calibration: what its file states, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Provenance
from calibrary.parsers.content import Content
from calibrary.parsers.reading import identified
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera
from tests.parsers.formats import (
    test_agisoft_xml,
    test_australis_report,
    test_gyroflow,
    test_inpho_prj,
    test_kitti,
    test_metashape_document,
    test_mrcal,
    test_photomodeler_report,
    test_usgs_report,
)
from tests.parsers.samples import exported


@dataclass(frozen=True, kw_only=True)
class Case:
    """A file, the text in it that is its date, and what its calibrations are to say."""

    file: str
    stated: str | None = None
    date: str | None = None
    tool: str | None = None
    operator: str | None = None


OPENCV = """%YAML:1.0
---
calibration_time: "Tue Oct  8 10:53:15 2024"
image_width: 5472
image_height: 3648
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 3650.1, 0., 2736.2, 0., 3649.8, 1824.7, 0., 0., 1. ]
"""
CASES = {
    "opencv_storage": Case(file=OPENCV, stated="Tue Oct  8 10:53:15 2024", date="2024-10-08T10:53:15"),
    "opencv_storage, ISO": Case(
        file=OPENCV.replace("Tue Oct  8 10:53:15 2024", "2019-05-14"), stated="2019-05-14", date="2019-05-14"
    ),
    "opencv_storage, of another locale": Case(
        file=OPENCV.replace("Tue Oct  8 10:53:15 2024", "Tue 14 May 2019 10:22:31 AM UTC"),
        stated="Tue 14 May 2019 10:22:31 AM UTC",
        date="2019-05-14T10:22:31Z",
    ),
    "opencv_storage, Metashape's spelling": Case(
        file=OPENCV.replace("calibration_time", "calibration_Time"),
        stated="Tue Oct  8 10:53:15 2024",
        date="2024-10-08T10:53:15",
    ),
    "agisoft_xml": Case(
        file=test_agisoft_xml.xml(test_agisoft_xml.FRAME).decode(),
        stated="2024-05-17T10:00:00Z",
        date="2024-05-17T10:00:00Z",
    ),
    "metashape_document": Case(
        file=test_metashape_document.document(
            test_metashape_document.sensor(test_metashape_document.DATED)
        ).decode(),
        stated="2024-05-17T10:00:00Z",
        date="2024-05-17T10:00:00Z",
        tool="Agisoft Metashape or PhotoScan, document version 1.5.0",
    ),
    "mrcal": Case(
        file="# generated on 2020-08-30 22:55:50 with   /usr/bin/mrcal-calibrate-cameras --focal 1 /home/a/*.jpg\n"
        + test_mrcal.file().partition("\n")[2],
        date="2020-08-30T22:55:50",
        tool="mrcal-calibrate-cameras",
    ),
    "kitti": Case(file=test_kitti.RAW, stated="09-Jan-2021 13:57:47", date="2021-01-09T13:57:47"),
    "gyroflow": Case(
        file=json.dumps(test_gyroflow.PROFILE),
        stated="2023-09-08",
        date="2023-09-08",
        tool="Gyroflow 1.5.2",
        operator="A. Pilot",
    ),
    "inpho_prj": Case(file=test_inpho_prj.block(), stated="19:07:49 17/08/2024", date="2024-08-17T19:07:49"),
    "australis_report": Case(
        file=test_australis_report.REPORT, stated="03 May, 2024   14:11:14", date="2024-05-03T14:11:14"
    ),
    "photomodeler_report": Case(
        file=test_photomodeler_report.report(test_photomodeler_report.block()),
        stated="Fri Oct 06 15:18:09 2017",
        date="2017-10-06T15:18:09",
        tool="PhotoModeler UAS 2017.1.1.2199 (64-bit)",
    ),
    "usgs_report": Case(file=test_usgs_report.REPORT, date="2001-05-03", operator="U.S. Geological Survey"),
    "alicevision_sfm": Case(
        file=exported()["alicevision_sfm"].data.decode(), tool="AliceVision, file version 1.2.11"
    ),
    "openmvg": Case(file=exported()["openmvg"].data.decode(), tool="OpenMVG, sfm_data version 0.3"),
    "realitycapture_xmp": Case(
        file=exported()["realitycapture_xmp"].data.decode(), tool="RealityCapture, XMP version 3"
    ),
}
IDS = [pytest.param(case, id=name) for name, case in CASES.items()]
DATED = [pytest.param(case, id=name) for name, case in CASES.items() if case.stated is not None]


def read(file: str) -> Sequence[Calibration]:
    record = identified(Content(file.encode(), "camera")).format
    size = SIZE if record.needs_image_size else None
    options = {"scan_um": "20"} if record.name == "usgs_report" else {}
    return parsers.decode(file.encode(), name="camera", image_size=size, options=options)


@pytest.mark.parametrize("case", IDS)
def test_a_calibration_has_the_date_and_the_makers_that_its_file_states(case: Case) -> None:
    for item in read(case.file):
        origin = item.provenance
        assert (origin.date, origin.tool, origin.operator) == (case.date, case.tool, case.operator)


@pytest.mark.parametrize("case", DATED)
@pytest.mark.parametrize("unclear", ["03/04/2019", "03-04-2019 10:00:00"])
def test_a_date_that_is_ambiguous_stays_unknown_and_is_quoted(case: Case, unclear: str) -> None:
    assert case.stated is not None
    for item in read(case.file.replace(case.stated, unclear)):
        assert item.provenance.date is None
        assert any(unclear in note for note in item.notes)


@pytest.mark.parametrize("case", DATED)
def test_an_empty_date_is_none(case: Case) -> None:
    assert case.stated is not None
    for item in read(case.file.replace(case.stated, "")):
        assert item.provenance.date is None
        assert not any("date" in note for note in item.notes)


def test_photographs_dates_in_a_project_are_not_the_calibrations() -> None:
    """Neither EXIF's nor the day the project was saved."""
    file = CASES["metashape_document"].file.replace("<date>2024-05-17T10:00:00Z</date>", "")
    meta = (
        '<meta><property name="Info/LastSavedDateTime" value="2020:06:22 02:23:20"/>'
        '<property name="Info/LastSavedSoftwareVersion" value="1.6.2.10247"/>'
        '<property name="Exif/DateTime" value="2013:08:22 21:12:02"/></meta>'
    )
    [item] = read(file.replace("</chunk>", f"{meta}</chunk>"))
    assert (item.provenance.date, item.provenance.tool) == (None, "Agisoft Metashape 1.6.2.10247")


def test_the_program_that_wrote_an_opf_project_is_named_beside_the_file() -> None:
    square = replace(camera(), intrinsics=replace(camera().intrinsics, fy=camera().intrinsics.fx))
    data = parsers.encode([square], "opf_calibrated_cameras")[0]
    project = {"items": [], "generator": {"name": "PIX4Dmatic", "version": "1.41.0"}}
    beside = {"project.opf": json.dumps(project).encode()}
    [item] = parsers.decode(data, name="cameras.json", image_size=SIZE, companion=beside.get)
    assert item.provenance.tool == "PIX4Dmatic 1.41.0"


def test_cameras_of_several_dates_share_no_opencv_file_date() -> None:
    pair = [
        replace(
            camera(),
            camera=replace(camera().camera, sub_camera=name),
            provenance=Provenance(kind="test", date=made),
        )
        for name, made in (("left", "2019-05-14"), ("right", "2020-05-14"))
    ]
    data, verdict = parsers.encode(pair, "opencv_storage")
    assert verdict.dropped == ("date",)
    assert [item.provenance.date for item in read(data.decode())] == [None, None]


def test_a_date_in_an_mrcal_model_is_written_as_its_tools_do() -> None:
    origin = Provenance(kind="test", date="2019-05-14T10:22:31", tool="Solver 3.1")
    data, _ = parsers.encode([replace(camera(), provenance=origin)], "mrcal")
    assert data.startswith(b"# generated on 2019-05-14 10:22:31 with   Solver 3.1\n{\n")
