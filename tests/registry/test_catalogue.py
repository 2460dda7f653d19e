"""The shipped catalogue: every entry, the cameras it has to know, and how an image's camera is found in it."""

from __future__ import annotations

import string
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calibration import ImageSize
from calibrary.errors import InputError, ParseError
from calibrary.known_camera import SUB_CAMERAS, KnownCamera, Projection
from calibrary.registry.catalogue import Basis, Catalogue, Outcome, load_catalogue, to_json
from calibrary.schemas import load, require
from calibrary.strictyaml import line_of, load_yaml

CATALOGUE = load_catalogue()
FILES = sorted(
    item.name for item in files("calibrary.registry.catalogue").iterdir() if item.name.endswith(".yaml")
)
POLICY_SPREAD = 0.03


def text_of(name: str) -> bytes:
    return (files("calibrary.registry.catalogue") / name).read_bytes()


@dataclass(frozen=True)
class Row:
    """A camera with a published focal length: the frame it was told for, and fx / W of that frame."""

    make: str
    model: str
    size: ImageSize
    fx_over_w: float
    focal_mm: float | None = None
    sub_camera: str | None = None

    def __str__(self) -> str:
        parts = (self.make, self.model, self.sub_camera, self.focal_mm, "{}×{}".format(*self.size))
        return " ".join(str(part) for part in parts if part)

    def camera(self) -> KnownCamera:
        match = CATALOGUE.find(
            self.make, self.model, sub_camera=self.sub_camera, size=self.size, focal_mm=self.focal_mm
        )
        assert match.camera is not None, match.reason
        return match.camera

    def expected(self) -> float:
        """The catalogue's fx / W in this row's frame: a scale keeps it, a 1:1 crop keeps fx."""
        camera = self.camera()
        assert camera.fx_over_w is not None
        assert camera.native_size is not None
        native = camera.native_size
        is_crop_of_columns = self.size[1] == native[1] and self.size[0] < native[0]
        return camera.fx_over_w * (native[0] / self.size[0] if is_crop_of_columns else 1.0)


ROWS = [
    Row("DJI", "PHANTOM VISION FC200", (4384, 3288), 0.560),
    Row("DJI", "FC300S", (4000, 3000), 0.593, 3.61),
    Row("DJI", "FC300X", (4000, 3000), 0.571, 3.61),
    Row("DJI", "FC330", (4000, 3000), 0.571, 3.61),
    Row("DJI", "FC350", (4000, 3000), 0.571, 3.61),
    Row("DJI", "FC6310", (5472, 3648), 0.669, 8.8),
    Row("DJI", "FC6310", (4864, 3648), 0.754, 8.8),
    Row("DJI", "FC6310R", (5472, 3648), 0.668, 8.8),
    Row("DJI", "FC6510", (5472, 3648), 0.667, 8.8),
    Row("DJI", "FC550", (4608, 3456), 0.895, 15),
    Row("DJI", "FC6540", (6016, 3376), 1.486, 35),
    Row("DJI", "FC6540", (6016, 4008), 1.021, 24),
    Row("DJI", "FC6540", (6016, 4008), 0.681, 16),
    Row("DJI", "FC220", (4000, 3000), 0.768, 4.73),
    Row("DJI", "FC2103", (4056, 3040), 0.738, 4.5),
    Row("DJI", "FC3170", (4000, 3000), 0.703, 4.5),
    Row("DJI", "FC7303", (4000, 3000), 0.724, 4.49),
    Row("DJI", "FC3682", (4000, 3000), 0.723, 6.7),
    Row("DJI", "FC3582", (4032, 3024), 0.696, 6.7),
    Row("DJI", "FC3411", (5472, 3648), 0.611),
    Row("Hasselblad", "L1D-20c", (5472, 3648), 0.817, 10.3),
    Row("DJI", "M3E", (5280, 3956), 0.703, 12.3),
    Row("DJI", "FC4170", (4000, 3000), 4.500),
    Row("DJI", "M3T", (8000, 6000), 0.688),
    Row("DJI", "M3T", (640, 512), 1.185, 9.1),
    Row("DJI", "M30T", (1280, 1024), 1.185, 9.1),
    Row("DJI", "MAVIC2-ENTERPRISE-ADVANCED", (640, 512), 1.187),
    Row("DJI", "ZH20T", (640, 512), 1.758, 13.5),
    Row("DJI", "ZH20N", (640, 512), 1.562, 12),
    Row("DJI", "ZH20N", (640, 512), 5.794, 44.5),
    Row("DJI", "H30T", (1280, 1024), 1.562, 24),
    Row("DJI", "M4T", (640, 512), 1.562, 12),
    Row("DJI", "FLIR", (640, 512), 1.746, 19),
    Row("DJI", "ZenmuseP1", (8192, 5460), 0.994, 35),
    Row("DJI", "FC6360", (1600, 1300), 1.171, 5.74),
    Row("Parrot", "Sequoia", (4608, 3456), 0.782, 4.88),
    Row("Parrot", "Sequoia", (1280, 960), 0.825, 3.98),
    Row("PARROT", "Disco", (1920, 1088), 0.167, 1.83),
    Row("Parrot", "Bebop 2", (4096, 3320), 0.343),
    Row("MicaSense", "RedEdge", (1280, 960), 1.132, 5.5, "Blue"),
    Row("MicaSense", "RedEdge-M", (1280, 960), 1.136, 5.5, "NIR"),
    Row("MicaSense", "Altum", (2064, 1544), 1.086, 8, "Blue"),
    Row("Skydio", "2", (4056, 3040), 0.586, 4.7),
    Row("Skydio", "X2 Narrow", (4056, 3040), 1.195, 7.5),
    Row("Skydio", "VT300-L_93", (8192, 6144), 0.591, 7.74),
    Row("Skydio", "VT300-Z_50", (9248, 6944), 1.370, 9.88),
    Row("Skydio", "VT300-Z_13", (8000, 6000), 5.468, 35),
    Row("Skydio", "VT300-Z_40", (640, 512), 1.774, 13.6),
    Row("Teledyne FLIR", "Hadron 640R EO", (4624, 3472), 0.741, 4.8),
    Row("Teledyne FLIR", "Boson 640", (640, 512), 1.771, 13.6),
    Row("senseFly", "S.O.D.A.", (5472, 3648), 0.810, 10.6),
    Row("senseFly", "senseFly Aeria X", (6000, 4000), 0.809, 18.5),
    Row("SONY", "DSC-RX1RM2", (7952, 5304), 0.975, 35),
    Row("GoPro", "HERO4 Black", (4000, 3000), 0.484, 3),
    Row("GoPro", "HERO6 Black", (4000, 3000), 0.486, 3),
    Row("GoPro", "HERO8 Black", (4000, 3000), 0.477),
    Row("Canon", "Canon PowerShot SX260 HS", (4000, 3000), 0.726, 4.5),
    Row("SONY", "HDR-AS300", (3840, 2160), 0.396, 2.6),
]


@pytest.mark.parametrize("name", FILES)
def test_every_file_holds_to_the_schema(name: str) -> None:
    data = text_of(name)
    require(load_yaml(data, source=name), "catalogue-1", source=name, locate=partial(line_of, data))


@pytest.mark.parametrize("name", FILES)
def test_every_source_begins_with_a_reference_of_its_file(name: str) -> None:
    document = load_yaml(text_of(name), source=name)
    assert isinstance(document, dict)
    references, make = document["references"], document["make"]
    assert isinstance(references, dict)
    cited = {
        text.partition(":")[0] for camera in CATALOGUE if camera.make == make for _, text in camera.sources
    }
    assert cited <= set(references)


def test_makers_come_in_the_order_of_their_files_and_each_has_one() -> None:
    makes = list(dict.fromkeys(camera.make for camera in CATALOGUE))
    assert len(makes) == len(FILES)
    assert [make.lower().replace(" ", "-").removesuffix("-robotics") for make in makes] == [
        name.removesuffix(".yaml") for name in FILES
    ]


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_a_published_camera_is_known_with_its_focal_length(row: Row) -> None:
    spread = max(row.camera().spread or 0.0, 0.005)
    assert row.expected() == pytest.approx(row.fx_over_w, rel=spread)


def test_0_8_to_1_5_widths_misses_forty_of_58_cameras() -> None:
    told = [row.expected() for row in ROWS]
    low, high = sum(x < 0.8 for x in told), sum(x > 1.5 for x in told)
    assert (len(told), low, len(told) - low - high, high) == (58, 30, 18, 10)


@pytest.mark.parametrize("camera", CATALOGUE, ids=lambda camera: camera.title)
def test_focal_length_over_pitch_gives_the_expected_fx_or_the_entry_says_why_not(camera: KnownCamera) -> None:
    if None in {camera.focal_mm, camera.pitch_um, camera.native_size, camera.fx_over_w}:
        return
    assert camera.focal_mm is not None
    assert camera.pitch_um is not None
    assert camera.native_size is not None
    derived = camera.focal_mm * 1000 / camera.pitch_um / camera.native_size[0]
    allowed = camera.spread if camera.spread is not None else POLICY_SPREAD
    if derived != pytest.approx(camera.fx_over_w, rel=allowed):
        assert camera.conflicts or not camera.exif_focal_trusted
    if derived != pytest.approx(camera.fx_over_w, rel=POLICY_SPREAD):
        assert camera.conflicts


@pytest.mark.parametrize("camera", CATALOGUE, ids=lambda camera: camera.title)
def test_every_number_has_a_source_and_its_claim_can_be_printed_and_read_back(camera: KnownCamera) -> None:
    record = to_json(camera)
    make = record.pop("make")
    document = {"schema": "calibrary/catalogue-1", "make": make, "cameras": [record]}
    require(document, "catalogue-1")
    numbers = ("native_size", "pitch_um", "focal_mm", "zoom_mm", "focal_35mm", "fx_over_w", "spread")
    for name in numbers:
        assert (getattr(camera, name) is None) == (camera.source(name) is None)
    assert camera.projection is Projection.PERSPECTIVE or camera.source("projection")


@pytest.mark.parametrize("camera", CATALOGUE, ids=lambda camera: camera.title)
def test_every_entry_is_found_by_every_name_it_claims(camera: KnownCamera) -> None:
    for make in (camera.make, *camera.other_makes):
        for model in camera.models:
            match = CATALOGUE.find(
                make,
                model,
                sub_camera=camera.bands[0] if camera.bands else camera.sub_camera,
                size=camera.native_size,
                focal_mm=camera.focal_mm,
                lens=camera.lens,
            )
            assert match.camera is camera, match.reason
            assert match.outcome is Outcome.FOUND
            assert match.candidates == (camera,)
            assert camera not in match.siblings


def test_bands_and_thermal_cameras_never_pass_for_the_only_camera_of_a_model() -> None:
    assert all(camera.sub_camera for camera in CATALOGUE if "thermal" in camera.title.lower())
    for camera in CATALOGUE:
        if camera.sub_camera is None:
            assert not camera.may_answer("thermal")


def test_what_sources_disagree_about_is_said() -> None:
    for model, numbers in {
        "2": ("5.476", "7.564", "6.287"),
        "FC2103": ("6.07", "6.17", "6.18"),
        "L2D-20c": ("17.5", "17.3", "17.72"),
        "Z30": ("4.71", "5.23"),
        "FC6310": ("13.2", "12.83332"),
        "FC300S": ("6.16", "6.3175"),
        "MAVIC2-ENTERPRISE-ADVANCED": ("4.8", "6.4", "7.68"),
        "ZH20T": ("7.68",),
    }.items():
        said = " ".join(text for camera in CATALOGUE if model in camera.models for text in camera.conflicts)
        assert all(number in said for number in numbers), model


@pytest.mark.parametrize(
    "model",
    ["E90", "CGO3+", "FC1102", "FC7203", "FC2200", "FC2204", "FC8482", "FC4370", "FC4382", "L2D-20c"]
    + [
        "XT705",
        "XL705",
        "XT701",
        "XT709",
        "XL715",
        "ANAFI",
        "ANAFIUSA",
        "ANAFITHERMAL",
        "ANAFIAI",
        "ZH20",
        "Z30",
    ],
)
def test_a_sensor_without_a_published_focal_length_is_known_too(model: str) -> None:
    assert any(
        camera.pitch_um is not None or camera.sensor_width_mm is not None
        for camera in CATALOGUE
        if model in camera.models
    )


@pytest.mark.parametrize("model", ["PHANTOM VISION FC200", "Disco", "Bebop 2", "HERO4 Black", "HERO6 Black"])
def test_a_fisheye_says_so_and_why(model: str) -> None:
    camera = next(camera for camera in CATALOGUE if model in camera.models)
    assert camera.projection is Projection.FISHEYE
    assert camera.source("projection")


def test_the_bands_of_a_sequoia_are_fisheye_and_its_rgb_camera_is_not() -> None:
    find = partial(CATALOGUE.find, "Parrot", "Sequoia")
    for band in ("Green", "GRE", "RED", "REG", "RedEdge", "NIR"):
        camera = find(sub_camera=band).camera
        assert camera is not None
        assert camera.projection is Projection.FISHEYE
    rgb = find(sub_camera="Red,Green,Blue").camera
    assert rgb is not None
    assert rgb.projection is Projection.PERSPECTIVE


def test_only_the_skydio_2_writes_a_focal_length_that_is_wrong() -> None:
    assert [camera.models[0] for camera in CATALOGUE if not camera.exif_focal_trusted] == ["2"]


@pytest.mark.parametrize("make", ["DJI", "dji", " DJI ", "DJI\0\0\0"])
@pytest.mark.parametrize("model", ["FC6310R", "fc6310r", "  FC6310R", "FC6310R\0"])
def test_letter_case_and_padding_do_not_matter(make: str, model: str) -> None:
    match = CATALOGUE.find(make, model)
    assert match.camera is not None
    assert match.camera.title == "Phantom 4 RTK"
    assert match.basis == (Basis.MODEL,)


@pytest.mark.parametrize("model", ["FC631", "FC63100", "C6310", "6310R", "FC6310 R", "FС6310R", "", "R"])
def test_a_part_of_a_name_or_a_lookalike_is_no_match(model: str) -> None:
    assert CATALOGUE.find("DJI", model).outcome is Outcome.UNKNOWN


def test_one_model_does_not_match_under_another_make() -> None:
    assert CATALOGUE.find("GoPro", "FC6310R").outcome is Outcome.UNKNOWN
    assert CATALOGUE.find(None, "FC6310R").outcome is Outcome.UNKNOWN
    assert CATALOGUE.find("DJI", None).outcome is Outcome.UNKNOWN


def test_hasselblad_cameras_are_known_under_dji_as_well() -> None:
    assert (
        CATALOGUE.find("DJI", "L1D-20c").camera is CATALOGUE.find("Hasselblad", "L1D-20c").camera is not None
    )


@pytest.mark.parametrize(
    ("tag", "sub_camera"),
    [("WideCamera", "wide"), ("InfraredCamera", "thermal"), ("Visible", "wide"), ("thermal", "thermal")],
)
def test_a_tag_tells_cameras_of_one_model_apart(tag: str, sub_camera: str) -> None:
    match = CATALOGUE.find("DJI", "M3T", sub_camera=tag, size=(8000, 6000) if sub_camera == "wide" else None)
    assert match.camera is not None
    assert match.camera.sub_camera == sub_camera
    assert match.basis[0] is Basis.TAG
    assert [camera.sub_camera for camera in match.siblings] == [
        {"wide": "thermal", "thermal": "wide"}[sub_camera]
    ]


def test_a_tag_that_fits_no_known_camera_is_not_overruled_by_the_frame() -> None:
    match = CATALOGUE.find("DJI", "M3T", sub_camera="TeleCamera", size=(8000, 6000), focal_mm=4.4)
    assert match.outcome is Outcome.UNKNOWN
    assert match.reason == "tagged as tele; of this Model the catalogue knows wide, thermal"
    assert len(match.siblings) == 2


def test_visible_says_too_little_where_only_one_of_several_visible_cameras_is_known() -> None:
    assert CATALOGUE.find("DJI", "M3E", sub_camera="VisibleCamera").outcome is Outcome.AMBIGUOUS
    assert CATALOGUE.find("DJI", "M3E", sub_camera="VisibleCamera", size=(5280, 3956)).camera is not None


def test_a_tag_nobody_can_read_counts_as_none() -> None:
    assert CATALOGUE.find("DJI", "M3T", sub_camera="rig-3").outcome is Outcome.AMBIGUOUS
    assert CATALOGUE.find("DJI", "M3T", sub_camera="rig-3", size=(640, 512)).camera is not None
    assert CATALOGUE.find("DJI", "FC6310R", sub_camera="Periscope").camera is not None


@pytest.mark.parametrize("tag", ["InfraredCamera", "NIR"])
def test_a_model_of_one_visible_camera_is_no_thermal_or_band_camera(tag: str) -> None:
    assert CATALOGUE.find("DJI", "FC6310R", sub_camera=tag).outcome is Outcome.UNKNOWN


@pytest.mark.parametrize("tag", ["WideCamera", "ZoomCamera", "VisibleCamera", None])
def test_a_model_of_one_camera_is_it_whatever_the_visible_camera_is_called(tag: str | None) -> None:
    assert CATALOGUE.find("DJI", "FC6310R", sub_camera=tag).camera is not None


@pytest.mark.parametrize(
    ("size", "sub_camera"),
    [
        ((8000, 6000), "wide"),
        ((4000, 3000), "wide"),
        ((2000, 1500), "wide"),
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


def test_without_a_tag_the_focal_length_tells_in_a_resized_file() -> None:
    assert CATALOGUE.find("DJI", "M3T", size=(1500, 1125)).outcome is Outcome.AMBIGUOUS
    match = CATALOGUE.find("DJI", "M3T", size=(1500, 1125), focal_mm=4.4)
    assert match.camera is not None
    assert match.camera.sub_camera == "wide"
    assert match.basis == (Basis.FOCAL,)


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
    assert match.outcome is Outcome.AMBIGUOUS
    assert set(match.candidates) == {tele, wide}


def test_a_frame_that_two_cameras_write_is_ambiguous() -> None:
    tele = KnownCamera(make="A", models=("B",), title="tele", sub_camera="tele", native_size=(4000, 3000))
    wide = replace(tele, title="wide", sub_camera="wide", native_size=(8000, 6000))
    match = Catalogue([tele, wide]).find("A", "B", size=(4000, 3000))
    assert match.outcome is Outcome.AMBIGUOUS
    assert match.reason == "nothing tells which: tele; wide"


@pytest.mark.parametrize(("focal_mm", "expected"), [(12.0, 12), (44.5, 44.5), (43.0, 44.5), (12.5, 12)])
def test_thermal_cameras_under_one_tag_are_told_by_focal_length(focal_mm: float, expected: float) -> None:
    match = CATALOGUE.find("DJI", "ZH20N", sub_camera="InfraredCamera", size=(640, 512), focal_mm=focal_mm)
    assert match.camera is not None
    assert match.camera.focal_mm == expected


@pytest.mark.parametrize("focal_mm", [6.0, 20.0, float("nan"), float("inf"), -12.0])
def test_a_focal_length_of_another_camera_is_not_forced_onto_one(focal_mm: float) -> None:
    match = CATALOGUE.find("DJI", "ZH20N", sub_camera="InfraredCamera", size=(640, 512), focal_mm=focal_mm)
    assert match.outcome is Outcome.UNKNOWN
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
    assert match.outcome is Outcome.AMBIGUOUS
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


def test_search_finds_every_word_anywhere_in_the_names() -> None:
    assert [camera.title for camera in CATALOGUE.search("phantom RTK")] == ["Phantom 4 RTK"]
    assert {camera.sub_camera for camera in CATALOGUE.search("m3t")} == {"wide", "thermal"}
    assert CATALOGUE.search("no such camera") == []
    assert CATALOGUE.search("  ") == list(CATALOGUE)


def test_two_entries_for_one_camera_are_refused() -> None:
    one = KnownCamera(make="A", models=("B", "C"), title="one")
    with pytest.raises(InputError, match="one and two share Model"):
        Catalogue([one, KnownCamera(make="a", models=("c",), title="two")])


OWN = """\
schema: "calibrary/catalogue-1"
make: "Acme"
cameras:
  - title: "Mapper"
    models: ["M1"]
    native_size: {value: [6000, 4000], source: "data sheet"}
    pitch_um: {value: 3.9, source: "data sheet"}
"""


def test_a_catalogue_of_ones_own_is_read_from_a_file_or_a_folder(tmp_path: Path) -> None:
    (tmp_path / "acme.yaml").write_text(OWN)
    for path in (tmp_path, tmp_path / "acme.yaml"):
        camera = load_catalogue(path).find("ACME", "m1").camera
        assert camera is not None
        assert camera.pitch_um == 3.9
        assert camera.source("pitch_um") == "data sheet"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"M1"', "2", "acme.yaml: line 5, cameras[0].models[0]: 2, wanted text: quote it"),
        ("value: 3.9,", "value: -3.9,", "line 7, cameras[0].pitch_um.value: -3.9, wanted more than 0.1"),
        ('{value: 3.9, source: "data sheet"}', "3.9", "line 7, cameras[0].pitch_um: 3.9, wanted a map"),
        (
            ', source: "data sheet"}\n    pitch',
            "}\n    pitch",
            "line 6, cameras[0].native_size: lacks source",
        ),
        ("pitch_um:", "pitch:", "'pitch' is no key here, did you mean pitch_um?"),
        (
            "[6000, 4000]",
            "[6000, 4000.0]",
            "line 6, cameras[0].native_size.value[1]: 4000.0, wanted a whole number",
        ),
        ("[6000, 4000]", "[6000]", "cameras[0].native_size.value: [6000], wanted at least 2 items"),
        ('make: "Acme"\n', "", "acme.yaml: line 1: lacks make"),
        ("catalogue-1", "catalogue-9", "'calibrary/catalogue-9', wanted 'calibrary/catalogue-1'"),
        ('title: "Mapper"', "title: 017", "017 starts with 0"),
        ('title: "Mapper"', 'title: "Mapper"\n    title: "x"', "line 5: key title is there twice"),
        ('["M1"]', '["M1"]\n    sub_camera: "infrared"', "'infrared', wanted 'blue', 'green'"),
    ],
)
def test_what_is_wrong_in_a_catalogue_of_ones_own_is_said_with_its_line(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert old in OWN
    (tmp_path / "acme.yaml").write_text(OWN.replace(old, new, 1))
    with pytest.raises(ParseError) as caught:
        load_catalogue(tmp_path / "acme.yaml")
    assert said in str(caught.value)


def test_a_catalogue_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_catalogue(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="no catalogue here"):
        load_catalogue(tmp_path)


def test_the_vocabulary_of_the_schema_is_the_one_of_the_code() -> None:
    camera = load("catalogue-1")["$defs"]["camera"]["properties"]  # type: ignore[index,call-overload]
    assert set(camera["sub_camera"]["enum"]) == SUB_CAMERAS  # type: ignore[index,call-overload,arg-type]


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
    assert (match.camera is not None) == (match.outcome is Outcome.FOUND)
    assert match.reason
    CATALOGUE.search(lens or "")
