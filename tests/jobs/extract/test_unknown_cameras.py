"""Cameras that neither catalogue nor registry knows: what their images' sources prove of each other."""

from __future__ import annotations

from typing import Any

import pytest

from calibrary.calibration import Grade
from calibrary.evidence.context import Source
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.fallback import Sources, fall_back
from calibrary.policy import FLEET, SOURCE, Policy
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import KNOWLEDGE, judged
from tests.jobs.extract.real_tags import TABLE, Figures, all_judged, figures, read_table


def image(size: tuple[int, int] = (3008, 2000), **tags: Any) -> ImageMetadata:
    """An image whose Model no database lists, unless its tags name another."""
    all_tags: dict[str, Any] = {"size": size, "make": "Example", "model": "One", "has_exif": True} | tags
    return ImageMetadata(**all_tags)


def per_mm(value: float) -> dict[str, Any]:
    """FocalPlaneResolution."""
    return {
        "focal_plane_resolution": (value, value),
        "focal_plane_unit": FocalPlaneUnit.MILLIMETRE,
    }


D70: dict[str, Any] = {"make": "NIKON CORPORATION", "model": "NIKON D70"}
"""23.7 mm in both databases."""


def only(metadata: ImageMetadata, policy: Policy = FLEET) -> Camera:
    [camera] = judged({metadata: ["a.jpg"]}, policy=policy)
    return camera


def fx_of(camera: Camera) -> float:
    assert camera.calibration is not None
    return camera.calibration.intrinsics.fx


def grade_of(camera: Camera) -> Grade:
    assert camera.calibration is not None
    return camera.calibration.grade


def seed_fx(camera: Camera, policy: Policy) -> float:
    fallback = fall_back(camera, policy, Sources(matrix=None, knowledge=KNOWLEDGE, rivals={}))
    assert fallback.seed is not None
    return fallback.seed.intrinsics.fx


@pytest.fixture(scope="module")
def found() -> tuple[Figures, ...]:
    """All rows, and two halves that share no camera."""
    outcomes = all_judged(read_table(TABLE))
    return (figures(outcomes), *(figures([o for o in outcomes if o.half == half]) for half in (0, 1)))


class TestRealImages:
    """Every row's K would be right: it has a focal length and a listed width."""

    def test_no_valid_k_is_more_than_3_per_cent_wrong(self, found: tuple[Figures, ...]) -> None:
        assert [str(one) for part in found for one in part.wrong] == []
        assert [part.known for part in found] == [57, 24, 33]

    def test_at_most_5_per_cent_of_right_ks_are_rejected(self, found: tuple[Figures, ...]) -> None:
        for part in found:
            assert len(part.rejected) <= 0.05 * part.known, "\n".join(map(str, part.rejected))

    def test_every_unproven_k_is_within_10_per_cent(self, found: tuple[Figures, ...]) -> None:
        assert [str(one) for part in found for one in part.far] == []


class TestTwoSourcesThatAgree:
    @pytest.mark.parametrize(
        "tags",
        [
            {"focal_mm": 70.0, "focal_35mm": 105.0, **D70},
            {"focal_mm": 70.0, **D70, **per_mm(3008 / 23.5)},
            {"focal_mm": 70.0, "focal_35mm": 105.0, **per_mm(3008 / 23.7)},
        ],
        ids=["listed width, equivalent", "listed width, focal plane", "focal plane, equivalent"],
    )
    def test_make_a_valid_derived_k(self, tags: dict[str, Any]) -> None:
        camera = only(image(**tags))
        assert (camera.verdict, grade_of(camera)) == (Verdict.VALID, Grade.DERIVED)
        assert fx_of(camera) == pytest.approx(70 / 23.7 * 3008, rel=0.01)

    def test_the_band_of_the_source_document_has_no_say(self) -> None:
        camera = only(image(focal_mm=200.0, focal_35mm=300.0, **D70))
        assert camera.verdict is Verdict.VALID
        assert fx_of(camera) > 8 * 3008

    def test_a_longer_side_that_stands_upright_spans_the_width(self) -> None:
        camera = only(image((2000, 3008), focal_mm=60.0, focal_35mm=90.0, **D70))
        assert camera.verdict is Verdict.VALID
        assert fx_of(camera) == pytest.approx(60 / 23.7 * 3008)

    def test_two_statements_of_one_width_must_agree_within_3_per_cent(self) -> None:
        camera = only(image(focal_mm=70.0, **D70, **per_mm(3008 / 23.7 * 1.04)))
        assert camera.verdict is Verdict.UNPROVEN

    def test_a_k_equal_to_its_equivalent_is_a_full_frame_cameras(self) -> None:
        tags = {"make": "Sony", "model": "A7SM2", "focal_mm": 21.0, "focal_35mm": 21.0}
        camera = only(image((1920, 1080), **tags))
        assert camera.verdict is Verdict.VALID
        assert fx_of(camera) == pytest.approx(21 / 35.6 * 1920)


class TestOneSource:
    @pytest.mark.parametrize(
        ("tags", "fx", "grade"),
        [
            (D70, 70 / 23.7 * 3008, Grade.PRIOR),
            (per_mm(3008 / 23.7), 70 / 23.7 * 3008, Grade.DERIVED),
            ({"focal_35mm": 70.0}, 70 / 36 * 3008, Grade.PRIOR),
        ],
        ids=["listed width", "focal plane", "equal to its equivalent"],
    )
    def test_leaves_k_unproven(self, tags: dict[str, Any], fx: float, grade: Grade) -> None:
        camera = only(image(focal_mm=70.0, **tags))
        assert (camera.verdict, grade_of(camera)) == (Verdict.UNPROVEN, grade)
        assert fx_of(camera) == pytest.approx(fx)
        assert camera.reason is not None
        assert "nothing confirms it" in camera.reason

    @pytest.mark.parametrize("focal_mm", [17.0, 400.0])
    def test_is_unproven_outside_the_band_too(self, focal_mm: float) -> None:
        assert only(image(focal_mm=focal_mm, **D70)).verdict is Verdict.UNPROVEN

    def test_is_rejected_where_no_lens_can_be_like_that(self) -> None:
        camera = only(image(focal_mm=2.0, **D70))
        assert camera.verdict is Verdict.REJECTED
        assert camera.reason is not None
        assert "of any lens" in camera.reason

    @pytest.mark.parametrize("tags", [{}, {"focal_mm": 4.0}], ids=["alone", "beside a focal length"])
    def test_a_35_mm_equivalent_is_an_unproven_prior(self, tags: dict[str, Any]) -> None:
        camera = only(image((4000, 3000), focal_35mm=24.0, **tags))
        assert (camera.verdict, grade_of(camera)) == (Verdict.UNPROVEN, Grade.PRIOR)
        assert fx_of(camera) == pytest.approx(24 / 43.2666 * 5000, rel=1e-5)


class TestContradictions:
    def test_sources_of_which_none_is_shown_wrong_reject_k(self) -> None:
        camera = only(image(focal_mm=70.0, focal_35mm=140.0, **D70))
        assert camera.verdict is Verdict.REJECTED
        assert camera.reason is not None
        assert "FocalLengthIn35mmFilm" in camera.reason

    def test_an_equivalent_written_as_the_focal_length_is_a_leak(self) -> None:
        tags = {"make": "NIKON", "model": "COOLPIX P6000", "focal_mm": 28.0, "focal_35mm": 28.0}
        camera = only(image((4000, 3000), **tags))
        assert camera.verdict is Verdict.REJECTED
        assert camera.reason is not None
        assert "was written as the focal length" in camera.reason

    def test_two_against_one_leave_k_unproven(self) -> None:
        camera = only(image(focal_mm=70.0, focal_35mm=140.0, **D70, **per_mm(3008 / 23.7)))
        assert camera.verdict is Verdict.UNPROVEN
        assert fx_of(camera) == pytest.approx(70 / 23.7 * 3008)


class TestResizedImages:
    def test_a_focal_plane_of_another_width_than_the_listed_one_is_of_the_image_before(self) -> None:
        """The editor rewrote EXIF's size and kept the resolution of the 3008 px original."""
        camera = only(image((800, 532), exif_size=(800, 532), focal_mm=70.0, **D70, **per_mm(3008 / 23.7)))
        assert camera.verdict is Verdict.UNPROVEN
        assert fx_of(camera) == pytest.approx(70 / 23.7 * 800)
        assert camera.calibration is not None
        assert "the image was resized, not cropped" in camera.calibration.provenance.assumptions
        [dropped] = camera.evidence.dropped
        assert (dropped.source, "6.30 mm wide" in dropped.reason) == (Source.FOCAL_PLANE, True)

    def test_the_equivalent_cannot_tell_it_from_a_crop(self) -> None:
        tags = {"focal_mm": 70.0, "focal_35mm": 105.0, **D70, **per_mm(3008 / 23.7)}
        camera = only(image((800, 532), exif_size=(800, 532), **tags))
        assert camera.verdict is Verdict.UNPROVEN
        assert camera.calibration is not None
        assert "the image was resized, not cropped" in camera.calibration.provenance.assumptions

    def test_an_exif_size_at_another_scale_is_told_as_well(self) -> None:
        camera = only(image((752, 500), exif_size=(3008, 2000), focal_mm=70.0, **D70))
        assert camera.verdict is Verdict.UNPROVEN
        assert fx_of(camera) == pytest.approx(70 / 23.7 * 752)
        assert camera.calibration is not None
        assert "the image was resized, not cropped" in camera.calibration.provenance.assumptions

    @pytest.mark.parametrize(
        ("size", "resolution", "words"),
        [
            ((600, 400), (40.0, 40.0), "25 µm"),
            ((3008, 2000), (127.0, 100.0), "times as wide as high"),
            ((3000, 1200), (127.0, 127.0), "2.50 to 1"),
        ],
        ids=["pitch", "oblong pixels", "panorama"],
    )
    def test_a_focal_plane_that_no_sensor_fills_is_not_believed(
        self, size: tuple[int, int], resolution: tuple[float, float], words: str
    ) -> None:
        tags = {"focal_plane_resolution": resolution, "focal_plane_unit": FocalPlaneUnit.MILLIMETRE}
        camera = only(image(size, focal_mm=70.0, **tags))
        assert words in camera.evidence.dropped[0].reason


class TestDigitalZoom:
    def test_a_zoom_that_nothing_confirms_is_a_contradiction(self) -> None:
        camera = only(image(focal_mm=70.0, digital_zoom=2.0, **D70))
        assert camera.verdict is Verdict.REJECTED
        assert "digital zoom 2×" in str(camera.reason) + str(camera.report)

    def test_a_phones_arithmetic_is_no_zoom(self) -> None:
        tags = {"make": "Apple", "model": "iPhone 99", "focal_mm": 5.7, "focal_35mm": 26.0}
        camera = only(image((4032, 3024), digital_zoom=1.000661813, **tags))
        assert camera.key.capture_mode is None
        assert camera.report is not None
        assert "digital-zoom" not in {finding.rule for finding in camera.report.findings}


class TestTheAssumedSensor:
    def test_it_stands_while_nothing_speaks_against_it(self) -> None:
        assert only(image((5472, 3648), focal_mm=13.2)).verdict is Verdict.UNPROVEN

    def test_where_the_image_has_other_proportions_there_is_no_k_and_nothing_wrong(self) -> None:
        camera = only(image((4000, 3000), focal_mm=13.2))
        assert camera.evidence.chosen is None
        assert (camera.calibration, camera.verdict) == (None, Verdict.UNPROVEN)

    def test_it_is_no_evidence_against_the_equivalent(self) -> None:
        camera = only(image((5472, 3648), focal_mm=13.2, focal_35mm=60.0))
        assert [one.source for one in camera.evidence.estimates] == [Source.FOCAL_35MM]
        assert camera.verdict is Verdict.UNPROVEN


class TestTheStartOfASelfCalibration:
    def test_it_is_the_equivalent_by_the_diagonal(self) -> None:
        camera = only(image((4000, 3000), focal_35mm=24.0))
        assert seed_fx(camera, FLEET) == pytest.approx(24 / 43.2666 * 5000, rel=1e-5)

    def test_it_is_the_source_documents_under_source_and_where_nothing_is_known(self) -> None:
        assert seed_fx(only(image((4000, 3000), focal_35mm=24.0), SOURCE), SOURCE) == 3200
        assert seed_fx(only(image((4000, 3000))), FLEET) == 3200


def test_under_source_neither_lists_nor_equivalents_are_asked() -> None:
    camera = only(image(focal_mm=13.2, focal_35mm=13.2, **D70), SOURCE)
    assert {one.source for one in camera.evidence.estimates} == {Source.ASSUMED_SENSOR, Source.FOCAL_35MM}
