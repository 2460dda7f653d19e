"""How an image's camera is found in the catalogue: by what the image says, and never by a guess."""

from __future__ import annotations

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calibration import ImageSize
from calibrary.catalogue import Basis, Catalogue, MatchOutcome, camera_named, load_catalogue
from calibrary.errors import InputError
from calibrary.jobs.layers.catalogue_entries import catalogue_entries
from calibrary.known_camera import KnownCamera
from calibrary.records import replace

CATALOGUE = load_catalogue()


@pytest.mark.parametrize("make", ["DJI", "dji", " DJI ", "DJI\0\0\0"])
@pytest.mark.parametrize("model", ["FC6310R", "fc6310r", "  FC6310R", "FC6310R\0"])
def test_letter_case_and_padding_do_not_matter(make: str, model: str) -> None:
    match = CATALOGUE.find(make, model)
    assert match.camera is not None
    assert match.camera.title == "Phantom 4 RTK"
    assert match.basis == (Basis.MODEL,)


@pytest.mark.parametrize("model", ["FC631", "FC63100", "C6310", "6310R", "FC6310 R", "FС6310R", "", "R"])
def test_a_part_of_a_name_or_a_lookalike_is_no_match(model: str) -> None:
    assert CATALOGUE.find("DJI", model).outcome is MatchOutcome.UNKNOWN


def test_one_model_does_not_match_under_another_make() -> None:
    assert CATALOGUE.find("GoPro", "FC6310R").outcome is MatchOutcome.UNKNOWN
    assert CATALOGUE.find(None, "FC6310R").outcome is MatchOutcome.UNKNOWN
    assert CATALOGUE.find("DJI", None).outcome is MatchOutcome.UNKNOWN


def test_hasselblad_cameras_are_known_under_dji_as_well() -> None:
    assert (
        CATALOGUE.find("DJI", "L1D-20c").camera is CATALOGUE.find("Hasselblad", "L1D-20c").camera is not None
    )


@pytest.mark.parametrize(
    ("tag", "sub_camera"),
    [("WideCamera", "wide"), ("InfraredCamera", "thermal"), ("Visible", "wide"), ("ZoomCamera", "zoom")],
)
def test_a_tag_tells_cameras_of_one_model_apart(tag: str, sub_camera: str) -> None:
    match = CATALOGUE.find("DJI", "M3T", sub_camera=tag, size=(8000, 6000) if sub_camera == "wide" else None)
    assert match.camera is not None
    assert match.camera.sub_camera == sub_camera
    assert match.basis[0] is Basis.TAG
    assert {camera.sub_camera for camera in match.siblings} == {"wide", "zoom", "thermal"} - {sub_camera}


def test_a_tag_that_fits_no_known_camera_is_not_overruled_by_the_frame() -> None:
    match = CATALOGUE.find("DJI", "M3T", sub_camera="TeleCamera", size=(8000, 6000), focal_mm=4.4)
    assert match.outcome is MatchOutcome.UNKNOWN
    assert match.reason == "tagged as tele; of this Model the catalogue knows zoom, wide, thermal"
    assert len(match.siblings) == 3


def test_visible_says_too_little_where_only_one_of_several_visible_cameras_is_known() -> None:
    assert CATALOGUE.find("DJI", "M3E", sub_camera="VisibleCamera").outcome is MatchOutcome.AMBIGUOUS
    assert CATALOGUE.find("DJI", "M3E", sub_camera="VisibleCamera", size=(5280, 3956)).camera is not None


def test_a_tag_nobody_can_read_counts_as_none() -> None:
    assert CATALOGUE.find("DJI", "M3T", sub_camera="rig-3").outcome is MatchOutcome.AMBIGUOUS
    assert CATALOGUE.find("DJI", "M3T", sub_camera="rig-3", size=(640, 512)).camera is not None
    assert CATALOGUE.find("DJI", "FC6310R", sub_camera="Periscope").camera is not None


@pytest.mark.parametrize("tag", ["InfraredCamera", "NIR"])
def test_a_model_of_one_visible_camera_is_no_thermal_or_band_camera(tag: str) -> None:
    assert CATALOGUE.find("DJI", "FC6310R", sub_camera=tag).outcome is MatchOutcome.UNKNOWN


@pytest.mark.parametrize("tag", ["WideCamera", "ZoomCamera", "VisibleCamera", None])
def test_a_model_of_one_camera_is_it_whatever_the_visible_camera_is_called(tag: str | None) -> None:
    assert CATALOGUE.find("DJI", "FC6310R", sub_camera=tag).camera is not None


@pytest.mark.parametrize(
    ("size", "sub_camera"),
    [
        ((8000, 6000), "wide"),
        ((8000, 4500), "wide"),
        ((640, 512), "thermal"),
        ((1280, 1024), "thermal"),
        ((320, 256), "thermal"),
    ],
)
def test_without_a_tag_the_frame_tells(size: ImageSize, sub_camera: str) -> None:
    match = CATALOGUE.find("DJI", "M3T", size=size)
    assert match.camera is not None
    assert match.camera.sub_camera == sub_camera
    assert match.basis == (Basis.SIZE,)


@pytest.mark.parametrize("size", [(4000, 3000), (2000, 1500), (1500, 1125)])
def test_without_a_tag_the_focal_length_tells_where_two_cameras_write_the_frame(size: ImageSize) -> None:
    assert CATALOGUE.find("DJI", "M3T", size=size).outcome is MatchOutcome.AMBIGUOUS
    match = CATALOGUE.find("DJI", "M3T", size=size, focal_mm=4.4)
    assert match.camera is not None
    assert match.camera.sub_camera == "wide"
    assert Basis.FOCAL in match.basis


def test_without_a_tag_the_35_mm_equivalent_tells_where_there_is_no_focal_length() -> None:
    match = CATALOGUE.find("DJI", "ZH20N", focal_35mm=196)
    assert match.camera is not None
    assert match.camera.focal_mm == 44.5


@pytest.mark.parametrize("size", [(3840, 2160), (640, 480), (512, 640), (1, 1), (0, 0)])
def test_a_frame_that_is_none_of_the_cameras_own_decides_nothing(size: ImageSize) -> None:
    assert CATALOGUE.find("DJI", "M3T", size=size).camera is None


def test_focal_length_and_frame_that_speak_for_two_cameras_are_no_answer() -> None:
    tele = KnownCamera(make="A", models=("B",), title="tele", sub_camera="tele", native_size=(4000, 3000))
    wide = replace(tele, title="wide", sub_camera="wide", native_size=(7000, 5250), focal_mm=4.4)
    match = Catalogue([tele, wide]).find("A", "B", size=(4000, 3000), focal_mm=4.4)
    assert match.outcome is MatchOutcome.AMBIGUOUS
    assert set(match.candidates) == {tele, wide}


def test_a_frame_that_two_cameras_write_is_ambiguous() -> None:
    tele = KnownCamera(make="A", models=("B",), title="tele", sub_camera="tele", native_size=(4000, 3000))
    wide = replace(tele, title="wide", sub_camera="wide", native_size=(8000, 6000))
    match = Catalogue([tele, wide]).find("A", "B", size=(4000, 3000))
    assert match.outcome is MatchOutcome.AMBIGUOUS
    assert match.reason == "not decided by any tag: tele; wide"


@pytest.mark.parametrize(("focal_mm", "expected"), [(12.0, 12), (44.5, 44.5), (43.0, 44.5), (12.5, 12)])
def test_thermal_cameras_under_one_tag_are_told_by_focal_length(focal_mm: float, expected: float) -> None:
    match = CATALOGUE.find("DJI", "ZH20N", sub_camera="InfraredCamera", size=(640, 512), focal_mm=focal_mm)
    assert match.camera is not None
    assert match.camera.focal_mm == expected


@pytest.mark.parametrize("focal_mm", [6.0, 20.0, float("nan"), float("inf"), -12.0])
def test_a_focal_length_of_another_camera_is_not_forced_onto_one(focal_mm: float) -> None:
    match = CATALOGUE.find("DJI", "ZH20N", sub_camera="InfraredCamera", size=(640, 512), focal_mm=focal_mm)
    assert match.outcome is MatchOutcome.UNKNOWN
    assert "fit none of" in match.reason


@pytest.mark.parametrize(
    ("lens", "focal_mm", "expected"),
    [
        (None, 35.0, 35),
        (None, 24.0, 24),
        ("DJI DL 35mm F2.8 LS ASPH", None, 35),
        ("DJI DL 35MM  F2.8 LS ASPH", 35.0, 35),
        ("DJI DL-S 16mm F2.8 ND ASPH", None, 16),
    ],
)
def test_lenses_that_come_off_are_told_by_name_or_focal_length(
    lens: str | None, focal_mm: float | None, expected: float
) -> None:
    match = CATALOGUE.find("DJI", "FC6540", lens=lens, focal_mm=focal_mm, size=(6016, 4008))
    assert match.camera is not None
    assert match.camera.focal_mm == expected


def test_an_unlisted_lens_leaves_the_body_with_its_pitch_and_nothing_to_expect() -> None:
    match = CATALOGUE.find("DJI", "FC6540", focal_mm=50.0, size=(6016, 4008))
    assert match.camera is not None
    assert match.camera.title == "Zenmuse X7, another lens"
    assert match.camera.pitch_um == 3.91584
    assert match.camera.fx_over_w is None
    assert match.camera.focal_mm is None
    assert len(match.siblings) == 3


def test_nothing_is_known_of_the_lens_without_a_focal_length() -> None:
    match = CATALOGUE.find("DJI", "ZenmuseP1", size=(8192, 5460))
    assert match.outcome is MatchOutcome.AMBIGUOUS
    assert len(match.candidates) == 3


def test_a_zoom_lens_moves_what_is_expected_and_another_does_not() -> None:
    zoom = CATALOGUE.find("Canon", "Canon PowerShot SX260 HS", focal_mm=20.0).camera
    prime = CATALOGUE.find("DJI", "FC6310R").camera
    assert zoom is not None
    assert prime is not None
    assert zoom.fx_over_w is not None
    assert zoom.fx_over_w_at(9.0) == pytest.approx(2 * zoom.fx_over_w)
    assert zoom.fx_over_w_at(None) is None
    assert zoom.fx_over_w_at(900.0) is None
    assert prime.fx_over_w_at(None) == prime.fx_over_w_at(24.0) == prime.fx_over_w


def test_a_body_known_by_its_pitch_has_focal_length_over_pitch() -> None:
    body = CATALOGUE.find("SONY", "ILCE-6000").camera
    assert body is not None
    assert body.fx_over_w is None
    assert body.fx_over_w_at(None) is None
    assert body.fx_over_w_at(20.0) == pytest.approx(20.0 * 1000 / 3.91667 / 6000)


def test_search_finds_every_word_anywhere_in_the_names() -> None:
    assert [camera.title for camera in CATALOGUE.search("phantom RTK")] == ["Phantom 4 RTK"]
    assert {camera.sub_camera for camera in CATALOGUE.search("m30t")} == {"wide", "zoom", "thermal"}
    assert CATALOGUE.search("no such camera") == []
    assert CATALOGUE.search("  ") == list(CATALOGUE)


def test_a_part_of_a_word_is_searched_for_only_if_no_camera_has_the_word() -> None:
    titles = {text: {camera.title for camera in CATALOGUE.search(text)} for text in ("L3", "l3d", "Neo 2")}
    assert titles == {"L3": {"Zenmuse L3, cameras"}, "l3d": {"Mavic 4 Pro, main"}, "Neo 2": {"Neo 2"}}
    assert {camera.title.split()[0] for camera in CATALOGUE.search("hero1")} >= {"HERO10", "HERO13"}
    assert {camera.models for camera in CATALOGUE.search("FC6310")} == {("FC6310", "FC6310S")}
    assert [camera.title for camera in CATALOGUE.search("nano")] == ["EVO Nano"]
    assert [camera.title for camera in CATALOGUE.search("nano+")] == ["EVO Nano+"]


def test_a_camera_whose_model_no_source_states_is_found_by_its_title() -> None:
    unseen = [camera for camera in CATALOGUE if not camera.models]
    assert "Zenmuse L3, cameras" in {camera.title for camera in unseen}
    for camera in unseen:
        assert camera_named(camera.title) == camera
        assert CATALOGUE.find(camera.make, camera.title, sub_camera=camera.sub_camera).camera == camera
    left = {one.title: one.reason for one in catalogue_entries(unseen)[1]}
    assert {*left.values()} == {"no source states the Model that its images carry"}
    assert len(left) == len(unseen)


def test_two_entries_for_one_camera_are_refused() -> None:
    one = KnownCamera(make="A", models=("B", "C"), title="one")
    with pytest.raises(InputError, match="one and two share Model"):
        Catalogue([one, KnownCamera(make="a", models=("c",), title="two")])


hostile = (
    st.text() | st.text(alphabet=string.printable) | st.sampled_from(["DJI", "M3T", "FC6540", "\0" * 99])
)


@given(
    make=st.none() | hostile,
    model=st.none() | hostile,
    sub_camera=st.none() | hostile,
    size=st.none() | st.tuples(st.integers(-2, 10**9), st.integers(-2, 10**9)),
    focal_mm=st.none() | st.floats(),
    focal_35mm=st.none() | st.floats(),
    lens=st.none() | hostile,
)
def test_no_text_or_number_breaks_the_search(
    make: str | None,
    model: str | None,
    sub_camera: str | None,
    size: ImageSize | None,
    focal_mm: float | None,
    focal_35mm: float | None,
    lens: str | None,
) -> None:
    match = CATALOGUE.find(
        make, model, sub_camera=sub_camera, size=size, focal_mm=focal_mm, focal_35mm=focal_35mm, lens=lens
    )
    assert (match.camera is not None) == (match.outcome is MatchOutcome.FOUND)
    assert match.reason
    CATALOGUE.search(lens or "")
