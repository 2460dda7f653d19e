"""The shipped catalogue: what every entry holds, and the cameras that have to be in it."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.resources import files

import pytest

from calibrary.calibration import ImageSize
from calibrary.catalogue import LARGEST_BINNING, Basis, Catalogue, Maker, load_catalogue
from calibrary.known_camera import KnownCamera, Projection
from calibrary.records import from_json, to_json
from calibrary.schemas import require
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
    """A camera with a published focal length: the image size it was published for, and fx / W of that frame."""

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

SENSOR_ONLY = (
    *("E90", "CGO3+", "XT705", "XL705", "XT701", "XT709", "XL715"),
    *("ANAFI", "ANAFIUSA", "ANAFITHERMAL", "ANAFIAI", "ZH20", "Z30", "L2D-20c"),
    *("FC1102", "FC7203", "FC2200", "FC2204", "FC8482", "FC4370", "FC4382"),
)


@pytest.mark.parametrize("name", FILES)
def test_every_file_holds_to_the_schema(name: str) -> None:
    data = text_of(name)
    require(load_yaml(data, source=name), "catalogue-1", source=name, locate=partial(line_of, data))


def faults(camera: KnownCamera, references: Collection[str]) -> Iterator[str]:
    """What is wrong with an entry; the steps to a new one are in the docstring of ``calibrary.catalogue``."""
    for field, text in camera.sources:
        if (source := text.partition(":")[0]) not in references:
            yield f"the source of {field} begins with {source!r}, which the file's references do not explain"
    yield from _faults_of_arithmetic(camera)
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
            if match.camera != camera or match.candidates != (camera,) or camera in match.siblings:
                yield f"an image of {make} {model} does not find it: {match.reason}; state sub_camera or lens"
    if camera.sub_camera is None and ("thermal" in camera.title.lower() or camera.may_answer("thermal")):
        yield "it would pass for the only camera of its Model: state sub_camera"


def _faults_of_arithmetic(camera: KnownCamera) -> Iterator[str]:
    size, expected, pitch = camera.native_size, camera.fx_over_w, camera.pitch_um
    if size is not None and expected is not None and pitch is not None and camera.focal_mm is not None:
        derived = camera.focal_mm * 1000 / pitch / size[0]
        allowed = camera.spread if camera.spread is not None else POLICY_SPREAD
        is_far = derived != pytest.approx(expected, rel=POLICY_SPREAD)
        if not camera.conflicts and (
            is_far or (camera.exif_focal_trusted and derived != pytest.approx(expected, rel=allowed))
        ):
            yield f"focal_mm ÷ pitch_um gives {derived:.3f} W, not fx_over_w {expected:g}: say why under conflicts"
    by_width = camera.source("fx_over_w") or ""
    printed = re.search(r"([\d.]+) mm ÷ (\d+) px", camera.source("pitch_um") or "")
    if printed and pitch != pytest.approx(float(printed[1]) / float(printed[2]) * 1000, rel=5e-4):
        yield f"pitch_um is not {printed[0]}, its source"
    printed = re.search(r"= ([\d.]+) px", by_width)
    if printed and size and expected != pytest.approx(float(printed[1]) / size[0], abs=6e-4 + 0.5 / size[0]):
        yield f"fx_over_w is not {printed[1]} px ÷ {size[0]} px, its source"
    printed = re.search(r"([\d.]+) mm ÷ ([\d.]+) mm", by_width)
    if printed and expected != pytest.approx(float(printed[1]) / float(printed[2]), abs=6e-4):
        yield f"fx_over_w is not {printed[0]}, its source"


@pytest.mark.parametrize("name", FILES)
def test_nothing_is_wrong_with_an_entry(name: str) -> None:
    maker = from_json(Maker, load_yaml(text_of(name), source=name), source=name)
    found = [
        f"{name}, {one.title}: {fault}" for one in maker.cameras for fault in faults(one, maker.references)
    ]
    assert not found, "\n".join(found)


def test_makers_come_in_the_order_of_their_files_and_each_has_one() -> None:
    makes = list(dict.fromkeys(camera.make for camera in CATALOGUE))
    assert len(makes) == len(FILES)
    stems = [re.sub(r"[^a-z0-9]+", "-", make.lower()).strip("-").removesuffix("-robotics") for make in makes]
    assert stems == [name.removesuffix(".yaml") for name in FILES]


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_a_published_camera_is_known_with_its_focal_length(row: Row) -> None:
    spread = max(row.camera().spread or 0.0, 0.005)
    assert row.expected() == pytest.approx(row.fx_over_w, rel=spread)


def test_0_8_to_1_5_widths_misses_forty_of_58_cameras() -> None:
    printed = [row.expected() for row in ROWS]
    low, high = sum(x < 0.8 for x in printed), sum(x > 1.5 for x in printed)
    assert (len(printed), low, len(printed) - low - high, high) == (58, 30, 18, 10)


def test_every_number_has_a_source_and_its_claim_can_be_printed_and_read_back() -> None:
    for camera in CATALOGUE.cameras:
        record = to_json(camera)
        assert from_json(KnownCamera, record) == camera
        make = record.pop("make")
        document = {"schema": "calibrary/catalogue-1", "make": make, "cameras": [record]}
        require(document, "catalogue-1")
        numbers = ("native_size", "pitch_um", "focal_mm", "zoom_mm", "focal_35mm", "fx_over_w", "spread")
        for name in numbers:
            assert (getattr(camera, name) is None) == (camera.source(name) is None)
        assert camera.projection is Projection.PERSPECTIVE or camera.source("projection")


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


@pytest.mark.parametrize("model", SENSOR_ONLY)
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


@dataclass(frozen=True)
class Tagged:
    """What an image of a camera carries, and the entry and fx / W that its own numbers lead to."""

    make: str
    model: str
    size: ImageSize
    focal_mm: float | None
    title: str
    fx_over_w: float | None
    focal_35mm: float | None = None
    tag: str | None = None
    sub_camera: str | None = None
    lens: str | None = None

    def __str__(self) -> str:
        return f"{self.make} {self.model} {self.size[0]}×{self.size[1]}"

    def camera(self) -> KnownCamera:
        match = CATALOGUE.find(
            self.make,
            self.model,
            sub_camera=self.tag,
            size=self.size,
            focal_mm=self.focal_mm,
            focal_35mm=self.focal_35mm,
            lens=self.lens,
        )
        assert match.camera is not None, match.reason
        return match.camera


FIXED = [
    Tagged("DJI", "FC220", (4000, 2250), 4.73, "Mavic Pro", 0.767, 26),
    Tagged("DJI", "FC300S", (4000, 2250), 3.61, "Phantom 3 Advanced", 0.586, 20),
    Tagged("DJI", "FC8482", (4032, 3024), 6.72, "Mini 4 Pro", 0.693, 24),
    Tagged("Hasselblad", "L2D-20c", (5280, 3956), 12.3, "Mavic 3 and Mavic 3 Cine, wide", 0.703, 24),
    Tagged("DJI", "FLIR", (640, 512), 19, "Zenmuse XT2 and XT thermal, 19 mm", 1.746, sub_camera="thermal"),
    Tagged("DJI", "XT2", (640, 512), 13, "Zenmuse XT2 and XT thermal, 13 mm", 1.195, sub_camera="thermal"),
    Tagged("DJI", "XT2", (4000, 3000), 8, "Zenmuse XT2, visible", 1.076, sub_camera="rgb"),
    Tagged("DJI", "M30T", (1280, 1024), 9.1, "Matrice 30T, thermal", 1.185, 40, None, "thermal"),
    Tagged(
        "DJI", "M3T", (640, 512), 9.1, "Mavic 3 Thermal and Matrice 3TD, thermal", 1.185, 40, None, "thermal"
    ),
    Tagged("DJI", "M4T", (1280, 1024), 12, "Matrice 4T and 4TD, thermal", 1.5625, 52, None, "thermal"),
    Tagged("DJI", "M4T", (8064, 6048), 6.72, "Matrice 4T and 4TD, wide", 0.693, 24, None, "wide"),
    Tagged(
        "Teledyne FLIR",
        "Boson 640",
        (640, 512),
        13.6,
        "Boson 640, 13.6 mm (Teal 2)",
        1.771,
        None,
        "IR",
        "thermal",
    ),
    Tagged("Parrot", "Chlorophyll", (1280, 964), 3.98, "Sequoia, bands, early firmware", 0.829, 30),
    Tagged("Delair", "UX11-3B", (5048, 4228), 12, "UX11", 1.4235),
    Tagged("Apple", "iPhone 6 Plus", (3264, 2448), 4.15, "iPhone 6 Plus", 0.8487, 29, None, "wide"),
    Tagged("Apple", "iPhone 7", (4032, 3024), 3.99, "iPhone 7", 0.8159, 28, None, "wide"),
    Tagged("Apple", "iPhone 8", (4032, 3024), 3.99, "iPhone 8", 0.8159, 28, None, "wide"),
    Tagged("Apple", "iPhone 12 Pro", (4032, 3024), 4.2, "iPhone 12 Pro, main", 0.7304, 26, None, "wide"),
    Tagged(
        "Apple", "iPhone 13 Pro Max", (4032, 3024), 5.7, "iPhone 13 Pro Max, main", 0.7345, 26, None, "wide"
    ),
    Tagged("samsung", "SM-G935L", (4032, 3024), 4.2, "Galaxy S7 edge", 0.751, 26, None, "wide"),
    Tagged("samsung", "SM-G965W", (4032, 3024), 4.3, "Galaxy S9+, main", 0.751, 26, None, "wide"),
    Tagged("samsung", "SM-G975F", (4032, 3024), 4.32, "Galaxy S10+, main", 0.751, 26, None, "wide"),
    Tagged("samsung", "SM-S906U", (4000, 3000), 5.4, "Galaxy S22+, main", 0.6645, 23, None, "wide"),
]

BODIES = [
    Tagged("Canon", "Canon PowerShot S100", (4000, 3000), 5.2, "PowerShot S100", 0.699),
    Tagged("Canon", "Canon IXUS 125 HS", (4608, 3456), 4.3, "IXUS 125 HS", 0.698),
    Tagged("Canon", "Canon PowerShot A2500", (4608, 3456), 5, "PowerShot A2500", 0.8117),
    Tagged("Canon", "Canon EOS 5D Mark III", (5760, 3840), 35, "EOS 5D Mark III", 0.972),
    Tagged("NIKON CORPORATION", "NIKON D3100", (4608, 3072), 55, "D3100", 2.381),
    Tagged("SONY", "ILCE-7M3", (6000, 4000), 24, "α7 III", 24 / 35.6),
]


@pytest.mark.parametrize("tagged", FIXED, ids=str)
def test_a_real_images_tags_lead_to_its_camera_and_focal_length(tagged: Tagged) -> None:
    camera = tagged.camera()
    assert (camera.title, camera.sub_camera) == (tagged.title, tagged.sub_camera)
    assert camera.fx_over_w == pytest.approx(tagged.fx_over_w, rel=max(camera.spread or 0.0, 0.005))


@pytest.mark.parametrize("tagged", BODIES, ids=str)
def test_where_the_lens_changes_the_pitch_makes_k_of_the_images_focal_length(tagged: Tagged) -> None:
    camera = tagged.camera()
    assert (camera.title, camera.fx_over_w) == (tagged.title, None)
    assert tagged.focal_mm is not None
    assert camera.pitch_um is not None
    assert camera.native_size == tagged.size
    fx_over_w = tagged.focal_mm * 1000 / camera.pitch_um / tagged.size[0]
    assert fx_over_w == pytest.approx(tagged.fx_over_w, rel=5e-3)


@pytest.mark.parametrize(
    ("model", "focal_mm"), [("iPhone 12 Pro", 1.54), ("iPhone 12 Pro", 6.0), ("iPhone 7", 2.87)]
)
def test_a_phones_other_cameras_are_not_its_main_one(model: str, focal_mm: float) -> None:
    assert CATALOGUE.find("Apple", model, size=(4032, 3024), focal_mm=focal_mm).camera is None


@pytest.mark.parametrize(
    ("model", "tag", "sub_camera"),
    [
        ("M3E", "ZoomCamera", "zoom"),
        ("M3M", "RedEdge", "multispectral"),
        ("M3M", "VisibleCamera", "rgb"),
        ("M30T", "WideCamera", "wide"),
        ("M4E", "MediumTeleCamera", "medium-tele"),
        ("M4TD", "MediumTeleCamera", "medium-tele"),
        ("M4T", "TeleCamera", "tele"),
        ("M4D", "WideCamera", "wide"),
        ("M3T", "ZoomCamera", "zoom"),
        ("M30T", "ZoomCamera", "zoom"),
        ("H30", "ZoomCamera", "zoom"),
        ("ZH20N", "WideCamera", "wide"),
        ("ZH20T", "ZoomCamera", "zoom"),
    ],
)
def test_a_tag_finds_each_camera_of_a_payload(model: str, tag: str, sub_camera: str) -> None:
    camera = CATALOGUE.find("DJI", model, sub_camera=tag).camera
    assert camera is not None
    assert camera.sub_camera == sub_camera


@pytest.mark.parametrize(
    ("factor", "basis"),
    [(1.0, True), (0.5, True), (1.0 / LARGEST_BINNING, True), (0.75, False), (0.5 / LARGEST_BINNING, False)],
)
def test_a_size_tells_a_camera_where_it_is_the_whole_frame_or_that_binned(factor: float, basis: bool) -> None:
    two = [
        KnownCamera(
            make="Acme",
            models=("A",),
            title=name,
            sub_camera=name,
            native_size=size,
            sources=(("native_size", "data sheet"),),
        )
        for name, size in (("wide", (4000, 3000)), ("tele", (5000, 5000)))
    ]
    found = Catalogue(two).find("Acme", "A", size=(round(4000 * factor), round(3000 * factor)))
    assert (Basis.SIZE in found.basis) is basis
