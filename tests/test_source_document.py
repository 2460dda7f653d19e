"""The document the project was created from, sentence by sentence, on files these tests write.

Where the ``fleet`` policy departs from the page, both policies stand side by side.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import exifread
import numpy as np
import pytest
from PIL import Image

import calibrary
from calibrary.cli.main import build_parser, leaves, main
from calibrary.errors import BadRationalError, InputError, MissingTagError
from tests.imagery import (
    ExifTags,
    Namespace,
    XmpDescription,
    XmpPacket,
    attributes,
    write_jpeg,
    write_tiff,
)

P4P = (5472, 3648)
DJI = Namespace("drone-dji", "http://www.dji.com/drone-dji/1.0/")
DEWARP = "2019-03-05;3660.5,3655.25,-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"

Extract = Callable[..., tuple[int, dict[str, Any]]]


def dji_xmp(**properties: str) -> XmpPacket:
    return XmpPacket(descriptions=(XmpDescription(items=attributes(DJI, **properties)),))


def jpeg(path: Path, size: tuple[int, int] = P4P, *, dewarp: str | None = None, **tags: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    exif = ExifTags(**tags) if tags else None
    xmp = dji_xmp(DewarpData=dewarp) if dewarp is not None else None
    return write_jpeg(path, size, exif=exif, xmp=xmp)


@pytest.fixture
def extract(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Extract:
    """Run ``calibrary extract`` in an empty directory; returns the exit code and the JSON report."""
    monkeypatch.chdir(tmp_path)

    def run(*flags: str) -> tuple[int, dict[str, Any]]:
        code = main(["extract", "--json", *flags])
        out = capsys.readouterr().out
        return code, json.loads(out) if out else {}

    return run


def page_function(
    image_path: str,
    sensor_width_mm: float,
    sensor_height_mm: float,
    principal_point: tuple[float, float] | None = None,
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """K by the page's formula, written from its text."""
    with Path(image_path).open("rb") as f:
        tag = exifread.process_file(f, details=False)["EXIF FocalLength"]
    with Image.open(image_path) as image:
        width_px, height_px = image.size
    focal_mm = float(tag.values[0].num) / float(tag.values[0].den)
    fx = (focal_mm / sensor_width_mm) * width_px
    fy = (focal_mm / sensor_height_mm) * height_px
    cx, cy = principal_point or (width_px / 2.0, height_px / 2.0)
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], dtype=np.float64)


class TestTheFunction:
    def test_signature_names_order_and_defaults(self) -> None:
        signature = inspect.signature(calibrary.extract_intrinsic_matrix)
        assert list(signature.parameters) == [
            "image_path",
            "sensor_width_mm",
            "sensor_height_mm",
            "max_focal_dev_pct",
            "pp_tol_frac",
            "principal_point",
        ]
        defaults = {n: p.default for n, p in signature.parameters.items() if p.default is not p.empty}
        assert defaults == {"max_focal_dev_pct": 15.0, "pp_tol_frac": 0.05, "principal_point": None}

    @pytest.mark.parametrize("focal", [(88, 10), (10, 3), (8799, 1000)])
    @pytest.mark.parametrize("size", [P4P, (5471, 3647), (640, 512)])
    def test_k_is_bit_identical_to_the_formula(
        self, tmp_path: Path, focal: tuple[int, int], size: tuple[int, int]
    ) -> None:
        path = str(jpeg(tmp_path / "a.jpg", size, make="X", focal_mm=focal))
        K, report = calibrary.extract_intrinsic_matrix(path, 13.2, 8.8)
        assert K.dtype == np.float64
        assert (page_function(path, 13.2, 8.8) == K).all()
        assert (report["fx"], report["cy"]) == (K[0, 0], K[1, 2])

    def test_report_keys(self, tmp_path: Path) -> None:
        path = jpeg(tmp_path / "DJI_0001.JPG", focal_mm=(88, 10))
        _, report = calibrary.extract_intrinsic_matrix(str(path), 13.2, 8.8)
        assert list(report) == [
            "image",
            "fx",
            "fy",
            "cx",
            "cy",
            "focal_deviation_pct",
            "pp_drift_frac",
            "passed",
        ]
        assert report["image"] == "DJI_0001.JPG"

    def test_a_measured_principal_point_is_used_where_one_is_supplied(self, tmp_path: Path) -> None:
        path = jpeg(tmp_path / "a.jpg", focal_mm=(88, 10))
        K, report = calibrary.extract_intrinsic_matrix(str(path), 13.2, 8.8, principal_point=(2700.0, 1800.0))
        assert (K[0, 2], K[1, 2]) == (2700.0, 1800.0)
        assert report["pp_drift_frac"] == max(36 / 5472, 24 / 3648)

    def test_tiff_is_read_as_well(self, tmp_path: Path) -> None:
        path = write_tiff(tmp_path / "a.tif", (1280, 960), exif=ExifTags(focal_mm=(55, 10)))
        K, _ = calibrary.extract_intrinsic_matrix(str(path), 4.8, 3.6)
        assert K[0, 0] == (5.5 / 4.8) * 1280

    def test_the_verification_block_holds_all_but_its_band(self, tmp_path: Path) -> None:
        K, report = calibrary.extract_intrinsic_matrix(
            str(jpeg(tmp_path / "DJI_0001.JPG", focal_mm=(88, 10))), 13.2, 8.8
        )
        W = 5472
        assert K.shape == (3, 3)
        assert K[2, 2] == 1.0
        assert K[0, 1] == 0.0
        assert K[1, 0] == 0.0
        assert report["passed"]
        # The page's own example is 0.667 W and misses the page's own band, like most UAV cameras.
        assert K[0, 0] == pytest.approx(0.667 * W, rel=1e-3)
        assert not 0.8 * W <= K[0, 0] <= 1.5 * W

    def test_a_missing_focal_length_is_a_typed_value_error(self, tmp_path: Path) -> None:
        path = jpeg(tmp_path / "a.jpg", make="DJI")
        with pytest.raises(MissingTagError, match=r"Missing EXIF FocalLength in a\.jpg"):
            calibrary.extract_intrinsic_matrix(str(path), 13.2, 8.8)
        assert issubclass(MissingTagError, ValueError)

    @pytest.mark.parametrize("focal", [(5, 0), (0, 0)])
    def test_a_zero_denominator_is_a_typed_value_error(self, tmp_path: Path, focal: tuple[int, int]) -> None:
        path = jpeg(tmp_path / "a.jpg", focal_mm=focal)
        with pytest.raises(BadRationalError, match="FocalLength"):
            calibrary.extract_intrinsic_matrix(str(path), 13.2, 8.8)
        assert issubclass(BadRationalError, ValueError)

    def test_the_35_mm_equivalent_is_never_substituted(self, tmp_path: Path) -> None:
        path = jpeg(tmp_path / "a.jpg", make="DJI", focal_35mm=24)
        with pytest.raises(MissingTagError, match="35 mm"):
            calibrary.extract_intrinsic_matrix(str(path), 13.2, 8.8)

    @pytest.mark.parametrize("sensor", [(0.0, 8.8), (13.2, -1.0), (float("nan"), 8.8)])
    def test_a_sensor_side_that_is_not_positive_is_refused(
        self, tmp_path: Path, sensor: tuple[float, float]
    ) -> None:
        path = jpeg(tmp_path / "a.jpg", focal_mm=(88, 10))
        with pytest.raises(InputError, match="positive"):
            calibrary.extract_intrinsic_matrix(str(path), *sensor)

    def test_a_file_that_is_no_image_is_refused(self, tmp_path: Path) -> None:
        path = tmp_path / "a.jpg"
        path.write_bytes(b"not an image")
        with pytest.raises(InputError, match=r"a\.jpg"):
            calibrary.extract_intrinsic_matrix(str(path), 13.2, 8.8)


class TestTheThresholds:
    @pytest.mark.parametrize(("height_mm", "passed"), [(8.8 * 0.86, True), (8.8 * 0.84, False)])
    def test_focal_symmetry_within_fifteen_per_cent(
        self, tmp_path: Path, height_mm: float, *, passed: bool
    ) -> None:
        path = jpeg(tmp_path / "a.jpg", focal_mm=(88, 10))
        _, report = calibrary.extract_intrinsic_matrix(str(path), 13.2, height_mm)
        assert report["passed"] is passed

    @pytest.mark.parametrize(("cx", "passed"), [(2736 + 273, True), (2736 + 274, False)])
    def test_principal_point_within_five_per_cent(self, tmp_path: Path, cx: float, *, passed: bool) -> None:
        path = jpeg(tmp_path / "a.jpg", focal_mm=(88, 10))
        _, report = calibrary.extract_intrinsic_matrix(str(path), 13.2, 8.8, principal_point=(cx, 1824.0))
        assert report["passed"] is passed

    def test_focal_plausibility_holds_every_camera_under_source_and_knows_better_under_fleet(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        """An FC6310R is 0.67 W: rejected by the page's band, right by what is known of it."""
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10))
        code, report = extract("--policy", "source")
        assert (code, report["cameras"][0]["verdict"]) == (1, "rejected")
        code, report = extract("--policy", "fleet")
        assert (code, report["cameras"][0]["verdict"]) == (0, "valid")

    def test_modern_cameras_hold_two_per_cent_which_fleet_asks_for_and_source_does_not(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        """A 4:3 camera run with the 3:2 sensor deviates by 11.1 % and is wrong; 15 % lets it through."""
        jpeg(tmp_path / "input/a.jpg", (4000, 3000), make="X", model="Y", focal_mm=(122, 10))
        sensor = ("--sensor-width-mm", "13.2", "--sensor-height-mm", "8.8")
        assert extract("--policy", "source", *sensor)[1]["cameras"][0]["verdict"] == "valid"
        assert extract("--policy", "fleet", *sensor)[1]["cameras"][0]["verdict"] == "unproven"


class TestTheFlags:
    @pytest.mark.parametrize(
        ("flag", "default"),
        [
            ("--image-dir", "./input/"),
            ("--sensor-width-mm", "13.2"),
            ("--sensor-height-mm", "8.8"),
            ("--max-focal-deviation-pct", "15"),
            ("--principal-point-tolerance-px", "0.05"),
            ("--fallback-k", None),
            ("--output-matrix", "K_matrix.npy"),
            ("--strict-validation", None),
        ],
    )
    def test_eight_flags_with_their_defaults(self, flag: str, default: str | None) -> None:
        extract = next(one for one in leaves(build_parser()) if one.prog == "calibrary extract")
        action = next(one for one in extract._actions if flag in one.option_strings)
        assert default is None or action.default == default or default in str(action.help)

    def test_the_matrix_is_written_as_npy(self, tmp_path: Path, extract: Extract) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10))
        code, _ = extract()
        K = np.load(tmp_path / "K_matrix.npy")
        assert code == 0
        assert K.shape == (3, 3)
        assert K.dtype == np.float64
        assert K[0, 1] == K[1, 0] == 0.0

    def test_the_principal_point_tolerance_is_a_fraction_under_both_names(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10), dewarp=DEWARP)
        assert extract()[0] == 0
        assert extract("--principal-point-tolerance-px", "0.001")[0] == 1
        assert extract("--principal-point-tolerance", "0.001")[0] == 1

    def test_max_focal_deviation_is_in_per_cent(self, tmp_path: Path, extract: Extract) -> None:
        jpeg(tmp_path / "input/a.jpg", make="X", model="Y", focal_mm=(132, 10))
        sensor = ("--sensor-width-mm", "13.2", "--sensor-height-mm", "9.7", "--policy", "source")
        assert extract(*sensor)[0] == 0
        assert extract(*sensor, "--max-focal-deviation-pct", "5")[0] == 1

    def test_strict_validation_stops_at_the_first_breach_and_writes_nothing(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10))
        jpeg(tmp_path / "input/b.jpg")
        code, report = extract("--strict-validation")
        assert (code, report) == (1, {})
        assert [p.name for p in tmp_path.iterdir()] == ["input"]

    def test_without_it_all_images_are_judged(self, tmp_path: Path, extract: Extract) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10))
        jpeg(tmp_path / "input/b.jpg")
        code, report = extract()
        assert code == 1
        assert sorted(c["verdict"] for c in report["cameras"]) == ["rejected", "valid"]


class TestTheEdgeCaseMatrix:
    def test_stripped_calibration_falls_back_to_the_centre_and_is_flagged_uncalibrated(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10))
        code, report = extract()
        [camera] = report["cameras"]
        assert code == 0
        assert report["uncalibrated"]
        assert camera["uncalibrated"]
        assert camera["calibration"]["distortion"] is None
        K = camera["calibration"]["intrinsics"]
        assert (K["cx"], K["cy"]) == (2736.0, 1824.0)

    def test_with_its_calibration_the_run_is_not_flagged(self, tmp_path: Path, extract: Extract) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10), dewarp=DEWARP)
        _, report = extract()
        assert not report["uncalibrated"]
        assert report["cameras"][0]["calibration"]["distortion"]["k1"] == -0.268

    def test_a_35_mm_equivalent_never_stands_in_for_the_focal_length(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310", focal_35mm=24)
        code, report = extract("--policy", "source")
        [camera] = report["cameras"]
        assert (code, camera["verdict"]) == (1, "rejected")
        assert "K" not in camera["calibration"]
        assert "35 mm" in camera["why"]
        # The fleet policy knows the lens of this camera, which nothing in the image confirms.
        code, report = extract("--policy", "fleet")
        [camera] = report["cameras"]
        assert (code, camera["verdict"], camera["calibration"]["grade"]) == (1, "unproven", "design")

    def test_a_frame_with_fx_unlike_fy_is_routed_to_the_fallback_k(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg", (3840, 2160), make="X", model="Y", focal_mm=(88, 10))
        np.save(tmp_path / "K.npy", np.array([[4000.0, 0, 1920], [0, 4000.0, 1080], [0, 0, 1]]))
        sensor = ("--sensor-width-mm", "13.2", "--sensor-height-mm", "8.8")
        code, report = extract(*sensor, "--policy", "source")
        assert (code, report["cameras"][0]["verdict"]) == (1, "rejected")
        code, report = extract(*sensor, "--policy", "source", "--fallback-k", "K.npy")
        [camera] = report["cameras"]
        assert code == 0
        assert camera["calibration"]["intrinsics"]["fx"] == 4000.0
        assert camera["fallback"][0]["outcome"] == "taken"

    def test_a_zero_denominator_is_a_row_and_not_a_crash(self, tmp_path: Path, extract: Extract) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC330", focal_mm=(5, 0))
        code, report = extract()
        assert code == 1
        assert "5/0" in report["cameras"][0]["why"]

    def test_mixed_sensors_give_one_k_each_and_no_average(self, tmp_path: Path, extract: Extract) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10))
        jpeg(tmp_path / "input/b.jpg", (4000, 3000), make="DJI", model="FC330", focal_mm=(361, 100))
        code, report = extract()
        assert code == 0
        focal = sorted(c["calibration"]["intrinsics"]["fx"] for c in report["cameras"])
        assert focal == [pytest.approx(3610 / 1.57937), pytest.approx(8800 / 2.4)]
        assert len(list(tmp_path.glob("K_matrix.*.npy"))) == 2
        assert not (tmp_path / "K_matrix.npy").exists()

    def test_a_cropped_frame_is_computed_against_its_true_size(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        """The page scales by the file's width; a known camera's crop keeps its pixels instead."""
        jpeg(tmp_path / "input/a.jpg", (4864, 3648), make="DJI", model="FC6310", focal_mm=(88, 10))
        K, _ = calibrary.extract_intrinsic_matrix(str(tmp_path / "input/a.jpg"), 11.674, 8.755)
        assert K[0, 0] == (8.8 / 11.674) * 4864
        _, report = extract()
        calibrated = report["cameras"][0]["calibration"]["intrinsics"]
        assert calibrated["fx"] == pytest.approx(8800 / 2.4)
        assert calibrated["fx"] == pytest.approx(K[0, 0], rel=1e-3)
        assert calibrated["cx"] == 2432.0


class TestTheFallbacks:
    def test_their_order_is_file_seed_registry_after_an_explicit_k(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg")
        _, report = extract()
        steps = [step["step"] for step in report["cameras"][0]["fallback"]]
        assert steps == ["fallback-k", "calibration-file", "self-calibration-seed", "registry"]

    def test_the_seed_is_eight_tenths_of_the_longer_side_and_no_k(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg")
        code, report = extract()
        [camera] = report["cameras"]
        K = camera["seed"]["intrinsics"]
        assert (K["fx"], K["fy"], K["cx"], K["cy"]) == (0.8 * 5472, 0.8 * 5472, 2736.0, 1824.0)
        assert "--ImageReader.single_camera 1 --ImageReader.camera_model PINHOLE" in camera["seed"]["colmap"]
        assert (code, "K" in camera["calibration"]) == (1, False)
        assert not (tmp_path / "K_matrix.npy").exists()
        assert np.load(tmp_path / "K_matrix_seed.npy")[0, 0] == 0.8 * 5472

    def test_a_calibration_file_beside_the_images_comes_before_the_seed(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        jpeg(tmp_path / "input/a.jpg")
        (tmp_path / "input/camera.xml").write_text(
            '<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n  <projection>frame</projection>\n'
            "  <width>5472</width>\n  <height>3648</height>\n  <f>3660.5</f>\n  <cx>-4.5</cx>\n  <cy>22.75</cy>\n"
            "  <k1>0.01</k1>\n</calibration>\n"
        )
        code, report = extract()
        [camera] = report["cameras"]
        assert code == 0
        assert camera["calibration"]["intrinsics"]["fx"] == 3660.5
        assert camera["calibration"]["intrinsics"]["cx"] == 2736 - 4.5
        assert [s["outcome"] for s in camera["fallback"]] == ["not there", "taken"]

    def test_the_registry_comes_last(self, tmp_path: Path, extract: Extract) -> None:
        jpeg(tmp_path / "input/a.jpg", make="DJI", model="FC6310R")
        entry = tmp_path / "registry/cameras/dji/fc6310r/5472x3648.yaml"
        entry.parent.mkdir(parents=True)
        entry.write_text(
            "schema: calibrary/entry-1\n"
            "camera: {make: DJI, model: FC6310R, image_size: [5472, 3648]}\n"
            "intrinsics: {pixel_origin: corner, fx: 3661.25, fy: 3655.5, cx: 2731.0, cy: 1846.0}\n"
            "distortion: {model: brown, k1: -0.26, k2: 0.11, p1: 0.0, p2: 0.0, k3: -0.03}\n"
            "grade: calibrated\n"
        )
        code, report = extract("--registry", "folder:registry")
        [camera] = report["cameras"]
        assert code == 0
        assert camera["calibration"]["intrinsics"]["fx"] == 3661.25
        assert camera["fallback"][-1]["step"] == "registry"
        assert camera["fallback"][-1]["outcome"] == "taken"


def test_grouping_by_model_alone_would_mix_two_cameras(tmp_path: Path, extract: Extract) -> None:
    """The page groups by EXIF Model; one Model is two cameras here, and each gets its own K."""
    for name, size, source, focal in (
        ("wide", (8000, 6000), "WideCamera", (440, 100)),
        ("thermal", (640, 512), "InfraredCamera", (910, 100)),
    ):
        path = tmp_path / f"input/{name}.jpg"
        path.parent.mkdir(exist_ok=True)
        xmp = dji_xmp(ImageSource=source)
        write_jpeg(path, size, exif=ExifTags(make="DJI", model="M3T", focal_mm=focal), xmp=xmp)
    _, report = extract()
    focal_px = {c["id"]: round(c["calibration"]["intrinsics"]["fx"], 1) for c in report["cameras"]}
    assert focal_px == {"dji-m3t-thermal-640x512": 758.3, "dji-m3t-wide-8000x6000": 5473.6}
