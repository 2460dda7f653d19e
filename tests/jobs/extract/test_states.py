"""Every image counts: a camera is judged in each of its states, and by the worst of them."""

from __future__ import annotations

from typing import Any

import pytest

from calibrary.calibration import Grade
from calibrary.evidence.metadata import ImageMetadata, XmpProperty
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import slugs_of
from calibrary.policy import FLEET, SOURCE
from calibrary.records import replace
from calibrary.validation import Finding, Severity, Verdict
from tests.evidence.scenes import p4_rtk, xmp
from tests.jobs.extract.fleet import judged

SERIAL = "5f1d0c7a9be24d3c"
ORIGINAL = p4_rtk()
PLAIN = replace(ORIGINAL, xmp=())
APPLIED = xmp("crs", LensProfileEnable="1", AlreadyApplied="True")
CROPPED = xmp("crs", HasCrop="True")


def images(*states: tuple[ImageMetadata, int]) -> dict[ImageMetadata, list[str]]:
    """So many images of each state, named in order."""
    return {state: [f"{at}-{n}.jpg" for n in range(count)] for at, (state, count) in enumerate(states)}


def finding(camera: Camera, rule: str) -> Finding:
    assert camera.report is not None
    return next(one for one in camera.report.findings if one.rule == rule)


def fx_of(camera: Camera) -> float:
    assert camera.calibration is not None
    return camera.calibration.intrinsics.fx


class TestEdits:
    @pytest.mark.parametrize(
        ("edited", "words"),
        [
            (replace(PLAIN, xmp=APPLIED), "2 of 5 images were lens-corrected by an editor"),
            (replace(PLAIN, xmp=CROPPED), "2 of 5 images were cropped by an editor"),
        ],
        ids=["lens profile", "crop"],
    )
    def test_a_few_edited_images_leave_the_camera_unproven(self, edited: ImageMetadata, words: str) -> None:
        [camera] = judged(images((PLAIN, 3), (edited, 2)))
        assert camera.verdict is Verdict.UNPROVEN
        assert camera.reason is not None
        assert camera.reason.startswith(words)
        assert camera.reason.endswith("; the first is 1-0.jpg")
        assert [one.report.verdict for one in camera.judged if one.report is not None] == [
            Verdict.VALID,
            Verdict.UNPROVEN,
        ]

    def test_one_original_among_corrected_images_does_not_speak_for_them(self) -> None:
        edited = replace(ORIGINAL, xmp=(*ORIGINAL.xmp, *APPLIED))
        [camera] = judged(images((edited, 9), (ORIGINAL, 1)))
        assert camera.verdict is Verdict.UNPROVEN
        assert str(camera.reason).startswith("9 of 10 images were lens-corrected by an editor")
        assert camera.evidence.scene.metadata is ORIGINAL

    def test_nor_does_it_where_they_lost_the_calibration_with_it(self) -> None:
        one, rest = judged(images((replace(PLAIN, xmp=APPLIED), 9), (ORIGINAL, 1)))
        assert (one.names, one.verdict) == (("1-0.jpg",), Verdict.VALID)
        assert rest.verdict is Verdict.UNPROVEN
        assert str(rest.reason).startswith("9 of 10 images were lens-corrected by an editor")

    def test_all_images_are_told_as_all(self) -> None:
        [camera] = judged(images((replace(PLAIN, xmp=CROPPED), 3)))
        assert str(camera.reason).startswith("all 3 images were cropped by an editor")

    def test_under_source_it_is_a_warning(self) -> None:
        policy = replace(SOURCE, focal_over_width=(0.5, 1.5))
        [camera] = judged(images((PLAIN, 3), (replace(PLAIN, xmp=CROPPED), 2)), policy=policy)
        assert camera.verdict is Verdict.VALID
        assert finding(camera, "as-recorded").severity is Severity.WARNING


class TestImagesThatLackWhatOthersCarry:
    def test_they_have_a_k_of_their_own_grade_where_nothing_proves_one_unit(self) -> None:
        one, rest = judged(images((PLAIN, 5), (ORIGINAL, 1)))
        assert one.calibration is not None
        assert rest.calibration is not None
        assert (one.calibration.grade, len(one.names)) == (Grade.CALIBRATED, 1)
        assert (rest.calibration.grade, len(rest.names)) == (Grade.DERIVED, 5)
        assert rest.calibration.distortion is None
        assert finding(rest, "one-unit").message.startswith("5 of 6 images lack drone-dji:DewarpData")
        assert slugs_of([one, rest]) == ["dji-fc6310r-5472x3648", "dji-fc6310r-5472x3648-derived"]

    def test_they_take_it_over_where_the_serial_number_proves_one_unit(self) -> None:
        [camera] = judged(images((replace(PLAIN, serial=SERIAL), 5), (replace(ORIGINAL, serial=SERIAL), 1)))
        assert (camera.verdict, fx_of(camera)) == (Verdict.VALID, 3660.5)
        printed = finding(camera, "one-unit")
        assert printed.severity is Severity.NOTE
        assert printed.message.startswith("5 of 6 images lack drone-dji:DewarpData")
        assert "serial number" in printed.message
        assert [one.inherits for one in camera.judged] == [True, False]

    def test_what_they_say_themselves_still_counts(self) -> None:
        known: dict[str, Any] = {"serial": SERIAL, "make": "Example", "model": "Survey One"}
        one = replace(ORIGINAL, **known)
        zoomed_in = replace(PLAIN, focal_35mm=60.0, **known)
        [camera] = judged(images((one, 3), (zoomed_in, 2)))
        assert camera.verdict is not Verdict.VALID
        assert str(camera.reason).startswith("2 of 5 images: fx = ")
        assert "and EXIF FocalLengthIn35mmFilm states" in str(camera.reason)


class TestACalibrationThatChanged:
    def unit(self, fx: float, **over: Any) -> ImageMetadata:
        terms = f"{fx},{fx},-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
        return replace(p4_rtk(dewarp=f"2019-03-05;{terms}"), serial=SERIAL, **over)

    def test_between_two_firmwares_of_one_unit_is_told_with_both_names(self) -> None:
        old, new = self.unit(3660.0, software="v01.09"), self.unit(3660.0 * 1.0025, software="v01.10")
        [camera] = judged(images((old, 3), (new, 2)))
        assert camera.verdict is Verdict.UNPROVEN
        printed = finding(camera, "one-calibration")
        assert printed.measured == pytest.approx(0.0025)
        assert "firmware v01.09" in printed.message
        assert "firmware v01.10" in printed.message
        assert "+0.25%" in printed.message
        assert camera.reason == printed.message

    def test_of_a_distortion_alone_is_told_too(self) -> None:
        bent = replace(
            p4_rtk(dewarp="2021-01-01;3660.5,3655.25,-4.5,22.75,-0.262,0.112,0.0008,-0.0001,-0.034"),
            serial=SERIAL,
        )
        [camera] = judged(images((replace(ORIGINAL, serial=SERIAL), 3), (bent, 2)))
        assert camera.verdict is Verdict.UNPROVEN
        message = finding(camera, "one-calibration").message
        assert "2019-03-05" in message
        assert "2021-01-01" in message

    def test_a_new_firmware_with_the_old_calibration_is_nothing_to_tell(self) -> None:
        old, new = self.unit(3660.0, software="v01.09"), self.unit(3660.0, software="v01.10")
        [camera] = judged(images((old, 3), (new, 2)))
        assert camera.verdict is Verdict.VALID
        assert camera.report is not None
        assert "one-calibration" not in {one.rule for one in camera.report.findings}


class TestAnEditorsName:
    @pytest.mark.parametrize(
        "program",
        [
            "Windows Photo Viewer 10",
            "Gallery 4.1",
            "Adobe Photoshop 21.0 (Windows)",
            "GIMP 2.10.34",
            "Picasa 3.0",
            "Microsoft Windows Photo Gallery 6.0.6001.18000",
        ],
    )
    def test_is_no_firmware(self, program: str) -> None:
        [camera] = judged(images((replace(PLAIN, software=program), 1)), policy=FLEET)
        assert camera.calibration is not None
        assert camera.calibration.camera.firmware is None

    @pytest.mark.parametrize(
        "version", ["v01.09.1691", "10.00.31.19", "HDR-AS300 v1.00", "Digital Camera DX-10 Ver1.00"]
    )
    def test_a_version_is(self, version: str) -> None:
        [camera] = judged(images((replace(PLAIN, software=version), 1)))
        assert camera.calibration is not None
        assert camera.calibration.camera.firmware == version


class TestGroupsThatLookAlike:
    def test_two_calibrations_without_a_serial_are_not_one_k_for_all(self) -> None:
        """0.4 % of fx apart, which the limit of the spread passes, is 40 cm of height at 100 m."""
        other = replace(ORIGINAL, serial=None, xmp=tuple(moved(one) for one in ORIGINAL.xmp))
        [camera] = judged(images((replace(ORIGINAL, serial=None), 5), (other, 5)))
        assert camera.verdict is Verdict.UNPROVEN
        assert "the calibration differs between" in finding(camera, "one-calibration").message

    def test_images_without_the_confirming_source_are_not_said_to_lack_the_source(self) -> None:
        nikon = {"make": "NIKON CORPORATION", "model": "NIKON D70", "focal_mm": 70.0, "has_exif": True}
        confirmed = ImageMetadata(size=(3008, 2000), focal_35mm=105.0, **nikon)  # type: ignore[arg-type]  # tags
        alone = replace(confirmed, focal_35mm=None)
        first, rest = judged(images((confirmed, 3), (alone, 2)))
        assert (first.verdict, rest.verdict) == (Verdict.VALID, Verdict.UNPROVEN)
        assert "2 of 5 images lack a second source that confirms" in finding(rest, "one-unit").message

    def test_images_that_a_viewer_turns_are_counted(self) -> None:
        [camera] = judged(images((PLAIN, 3), (replace(PLAIN, orientation=6), 2)))
        assert camera.verdict is Verdict.VALID
        message = finding(camera, "orientation").message
        assert message.startswith("2 of 5 images have another EXIF Orientation")

    def test_one_image_is_told_in_the_singular(self) -> None:
        [camera] = judged(images((PLAIN, 499), (replace(PLAIN, xmp=CROPPED), 1)))
        assert str(camera.reason).startswith("1 of 500 images was cropped by an editor")


def moved(item: XmpProperty) -> XmpProperty:
    """DewarpData whose focal lengths are 0.4 % longer; other properties as they are."""
    if item.name != "DewarpData":
        return item
    date, _, numbers = item.values[0].partition(";")
    fx, fy, *rest = numbers.split(",")
    longer = (f"{float(fx) * 1.004:.2f}", f"{float(fy) * 1.004:.2f}")
    return replace(item, values=(f"{date};{','.join((*longer, *rest))}",))
