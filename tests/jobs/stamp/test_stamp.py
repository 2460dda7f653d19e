"""``stamp``: the calibration goes into copies as tags that others read, or the image is refused with the reason."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import calibrary
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.cli.main import main
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import UsageError
from calibrary.jobs.stamp import stamp
from calibrary.jobs.stamp.run import StampedImage
from calibrary.jobs.stamp.tags import _number_list, camera_tags, dji_tags
from calibrary.parsers.fit import compare
from calibrary.records import replace
from calibrary.schemas import require
from tests.imagery import ExifTags, XmpDescription, XmpPacket, attributes, write_jpeg, write_tiff
from tests.imagery.xmp import DRONE_DJI, PIX4D_1
from tests.jobs.extract.fleet import DEWARP, P4R, entry, files, picture
from tests.thorough import examples

SIZE = (5472, 3648)
BROWN = BrownConrady(k1=-0.2671, k2=0.1102, p1=0.00081, p2=-1.2e-5, k3=-0.0334)


def calibration(lens: Distortion | None = BROWN, *, fy: float = 3671.5, **changes: Any) -> Calibration:
    return replace(
        Calibration(
            camera=CameraKey(make="DJI", model="FC6310R", image_size=SIZE),
            intrinsics=Intrinsics(fx=3671.5, fy=fy, cx=2731.97, cy=1847.1, image_size=SIZE),
            distortion=lens,
            grade=Grade.CALIBRATED,
            provenance=Provenance(kind="test", date="2026-05-03"),
        ),
        **changes,
    )


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """A Phantom 4 RTK's image with pixels, a maker's note and a calibration of its own."""
    rng = np.random.default_rng(3)
    return write_jpeg(
        tmp_path / "in/DJI_0001.JPG",
        (240, 160),
        exif=ExifTags(**P4R, pixel_size=(240, 160), maker_note=b"\x01note"),
        xmp=XmpPacket(
            descriptions=(XmpDescription(items=attributes(DRONE_DJI, DewarpData=DEWARP)),), length=3000
        ),
        pixels=rng.integers(0, 255, (160, 240, 3), dtype=np.uint8),
    )


def one(image: Path, made: Calibration, **options: Any) -> StampedImage:
    [found] = stamp(image, made, image.parent.parent / "out", **options).images
    return found


class TestCopies:
    def test_no_pixel_and_no_other_segment_changes(self, image: Path) -> None:
        small = replace(calibration(), intrinsics=calibration().intrinsics.scaled((240, 160)))
        before = image.read_bytes()
        found = one(image, small)
        copy = image.parent.parent / "out" / str(found.output)
        new = copy.read_bytes()
        assert image.read_bytes() == before
        xmp = before.index(b"http://ns.adobe.com/xap") - 4
        assert new[:xmp] == before[:xmp]
        scan = before.index(b"\xff\xda")
        assert new[new.index(b"\xff\xda") :] == before[scan:]
        assert (np.asarray(cv2.imread(str(copy))) == np.asarray(cv2.imread(str(image)))).all()
        assert found.max_error_px == 0.0

    @pytest.mark.parametrize("tags", ["camera", "dji"])
    def test_the_readers_find_what_was_stamped(self, tmp_path: Path, tags: str) -> None:
        made, path = calibration(), picture(tmp_path / "in/a.jpg", **P4R, dewarp=DEWARP)
        found = one(path, made, tags=[tags])
        copy = calibrary.read(tmp_path / "out/a.jpg")
        assert found.outcome == "stamped"
        assert compare(made, copy).exact
        assert copy.provenance.tag in found.tags
        assert copy.provenance.date == ("2026-05-03" if tags == "dji" else None)

    def test_another_reader_of_xmp_finds_pix4d_s_tags(self, tmp_path: Path) -> None:
        path = picture(tmp_path / "in/a.jpg", **P4R)
        one(path, calibration())
        with Image.open(tmp_path / "out/a.jpg") as copy:
            packet = copy.info["xmp"].decode()
        pitch_mm = 0.0024
        values = {name: packet.partition(f'Camera:{name}="')[2].partition('"')[0] for name in CAMERA}
        assert values["ModelType"] == "perspective"
        assert float(values["PerspectiveFocalLength"]) == pytest.approx(3671.5 * pitch_mm, rel=1e-3)
        assert [*map(float, values["PrincipalPoint"].split(","))] == pytest.approx(
            [2731.97 * pitch_mm, 1847.1 * pitch_mm], rel=1e-3
        )
        assert values["PerspectiveDistortion"] == "-0.2671,0.1102,-0.0334,0.00081,-0.000012"

    def test_exiftool_finds_the_tags_and_nothing_else_changed(self, tmp_path: Path) -> None:
        if shutil.which("exiftool") is None:
            pytest.skip("exiftool is not installed; Pillow reads the same tags above")
        path = picture(tmp_path / "in/a.jpg", **P4R, dewarp=DEWARP)
        one(path, calibration())
        before, after = (json.loads(_exiftool(one))[0] for one in (path, tmp_path / "out/a.jpg"))
        changed = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
        assert changed == {
            "SourceFile",
            "XMP-drone-dji:DewarpData",
            *(f"XMP-Camera:{name}" for name in CAMERA),
        }
        day, _, terms = after["XMP-drone-dji:DewarpData"].partition(";")
        assert day == "2026-05-03"
        assert [*map(float, terms.split(","))] == pytest.approx(
            [3671.5, 3671.5, -4.03, 23.1, -0.2671, 0.1102, 0.00081, -1.2e-5, -0.0334]
        )

    def test_bands_in_tiff(self, tmp_path: Path) -> None:
        exif = ExifTags(make="MicaSense", model="RedEdge", focal_mm=(55, 10))
        packet = XmpPacket(
            descriptions=(
                XmpDescription(items=attributes(PIX4D_1, BandName="Blue", ModelType="perspective")),
            )
        )
        path = write_tiff(tmp_path / "in/a.tif", (1280, 960), bits=16, exif=exif, xmp=packet)
        camera = CameraKey(make="MicaSense", model="RedEdge", sub_camera="blue")
        K = Intrinsics(fx=1449.5, fy=1449.5, cx=631.2, cy=470.9, image_size=(1280, 960))
        found = one(path, calibration(camera=camera, intrinsics=K))
        assert (found.outcome, found.max_error_px) == ("stamped", 0.0), found.reason
        assert compare(calibration(intrinsics=K), calibrary.read(tmp_path / "out/a.tif")).exact

    def test_six_radial_terms_are_dewarp_data_k6(self, tmp_path: Path) -> None:
        lens = Rational(k1=0.1, k2=-0.02, p1=1e-4, p2=2e-4, k3=0.003, k4=0.12, k5=-0.01, k6=0.001)
        found = one(picture(tmp_path / "in/a.jpg", **P4R), calibration(lens))
        assert "drone-dji:DewarpDataK6" in found.tags
        assert calibrary.read(tmp_path / "out/a.jpg").distortion == lens

    def test_a_resized_image_is_stamped_in_the_frame_that_its_exif_states(self, tmp_path: Path) -> None:
        exif = ExifTags(**P4R, pixel_size=(5472, 3648))
        path = write_jpeg(tmp_path / "in/a.jpg", (2736, 1824), exif=exif)
        small = calibration().scaled((2736, 1824))
        assert one(path, small).outcome == "stamped"
        assert compare(small, calibrary.read(tmp_path / "out/a.jpg")).exact


CAMERA = (
    "ModelType",
    "PerspectiveFocalLength",
    "PerspectiveFocalLengthUnits",
    "PrincipalPoint",
    "PerspectiveDistortion",
)


def _exiftool(path: Path) -> str:
    command = ["exiftool", "-j", "-G1", "-a", "-u", "-x", "System:all", "-x", "ThumbnailImage"]
    return subprocess.run([*command, str(path)], capture_output=True, text=True, check=True).stdout


class TestRefused:
    @pytest.mark.parametrize(
        ("made", "reason"),
        [
            (
                calibration(camera=CameraKey(make="DJI", model="FC330")),
                "its model is FC6310R, the calibration's FC330",
            ),
            (calibration().scaled((4864, 3243)), "is 5472×3648 px, the calibration of 4864×3243 px"),
            (calibration(camera=CameraKey(serial="0123456789abcdef")), "another unit"),
            (calibration(camera=CameraKey(model="FC6310R", focal_mm=24.0)), "taken at 8.8 mm"),
            (calibration(grade=Grade.DESIGN), "its K is design, and readers"),
            (calibration(grade=Grade.SEED), "its K is seed"),
            (replace(calibration(), intrinsics=replace(calibration().intrinsics, skew=3.0)), "skew of 3 px"),
        ],
    )
    def test_what_the_calibration_is_not_of_and_what_tags_do_not_hold(
        self, tmp_path: Path, made: Calibration, reason: str
    ) -> None:
        path = picture(tmp_path / "in/a.jpg", **P4R, body_serial="A17", dewarp=DEWARP)
        found = one(path, made)
        assert found.outcome == "refused"
        assert reason in str(found.reason)
        assert not (tmp_path / "out").exists()

    def test_an_image_that_the_camera_undistorted(self, tmp_path: Path) -> None:
        path = picture(tmp_path / "in/a.jpg", **P4R | {"dji:DewarpFlag": "1"})
        assert "undistorted it already" in str(one(path, calibration()).reason)
        found = one(path, calibration(NoDistortion()))
        assert (found.outcome, found.max_error_px) == ("stamped", 0.0)

    def test_a_calibration_far_from_what_readers_believe_of_the_camera(self, tmp_path: Path) -> None:
        path = picture(tmp_path / "in/a.jpg", **P4R)
        far = calibration(intrinsics=replace(calibration().intrinsics, fx=5000.0, fy=5000.0))
        found = one(path, far)
        assert (found.outcome, (tmp_path / "out").exists()) == ("refused", False)
        assert "fx 3666.67 px" in str(found.reason)

    def test_a_calibration_that_readers_would_not_believe(self, tmp_path: Path) -> None:
        path = picture(tmp_path / "in/a.jpg", make="DJI", model="FC6310R")
        far = calibration(intrinsics=replace(calibration().intrinsics, fx=9000.0, fy=9000.0))
        found = one(path, far)
        assert found.outcome == "refused"
        assert str(found.reason).startswith(
            "readers would not believe the tags: drone-dji:DewarpData: fx = 9000.0"
        )

    @pytest.mark.parametrize("name", ["a.png", "a.jpg"])
    def test_files_that_hold_no_tags(self, tmp_path: Path, name: str) -> None:
        path = tmp_path / "in" / name
        path.parent.mkdir()
        Image.new("RGB", (54, 36)).save(path, "PNG")
        assert one(path, calibration()).outcome == "unreadable"


class TestFit:
    def test_two_focal_lengths_stay_out_of_the_camera_tags_and_the_cost_is_stated(
        self, tmp_path: Path
    ) -> None:
        path, made = picture(tmp_path / "in/a.jpg", **P4R), calibration(fy=3673.0)
        exact = one(path, made)
        assert exact.tags == ("drone-dji:DewarpData",)
        assert "off by up to 0.675 px; give --max-error-px 0.68" in exact.notes[0]
        wide = one(path, made, tags=["camera"], max_error_px=0.68, force=True)
        assert wide.outcome == "stamped"
        assert wide.max_error_px == pytest.approx(0.675, abs=2e-3)
        assert compare(made, calibrary.read(tmp_path / "out/a.jpg")).max_px == wide.max_error_px

    def test_another_model_is_refused_or_its_error_stated(self, tmp_path: Path) -> None:
        path = picture(tmp_path / "in/a.jpg", **P4R)
        made = calibration(KannalaBrandt(k1=0.9, k2=0.9, k3=0.9, k4=0.9))
        assert "no exact counterpart among brown, rational" in str(one(path, made, max_error_px=0.0).reason)
        fitted = one(path, made)
        assert fitted.tags == ("drone-dji:DewarpDataK6",)
        assert fitted.max_error_px is not None
        assert 0 < fitted.max_error_px < 0.05
        assert compare(made, calibrary.read(tmp_path / "out/a.jpg")).max_px == fitted.max_error_px

    def test_an_unknown_distortion_stays_unknown(self, tmp_path: Path) -> None:
        path = picture(tmp_path / "in/a.jpg", **P4R, dewarp=DEWARP)
        found = one(path, calibration(None))
        assert not {"drone-dji:DewarpData", "Camera:PerspectiveDistortion"} & {*found.tags}
        assert calibrary.read(tmp_path / "out/a.jpg").distortion is None

    @settings(max_examples=examples(20))
    @given(
        st.lists(st.floats(-1, 1), min_size=5, max_size=5),
        st.floats(0.3, 20),
        st.tuples(st.floats(-200, 200), st.floats(-200, 200)),
    )
    def test_every_digit_is_written(
        self, terms: list[float], over_width: float, off: tuple[float, float]
    ) -> None:
        lens = BrownConrady(**dict(zip(("k1", "k2", "p1", "p2", "k3"), terms, strict=True)))
        fx = over_width * SIZE[0]
        K = Intrinsics(fx=fx, fy=fx, cx=2736 + off[0], cy=1824 + off[1], image_size=SIZE)
        made = calibration(lens, intrinsics=K)
        [dji] = dji_tags(made, max_error_px=0.05).properties.values()
        assert "e" not in dji
        values = [float(text) for text in dji.partition(";")[2].split(",")]
        assert values == [fx, fx, K.cx - 2736, K.cy - 1824, *terms]
        camera = {
            key[2]: text
            for key, text in camera_tags(made, (417.3, 417.3), max_error_px=0.05).properties.items()
        }
        assert float(camera["PerspectiveFocalLength"]) * 417.3 == pytest.approx(fx, rel=1e-14)
        k1, k2, p1, p2, k3 = terms
        assert [*map(float, camera["PerspectiveDistortion"].split(","))] == [k1, k2, k3, p1, p2]


class TestCommand:
    def test_each_image_gets_the_entry_of_its_own_camera(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        fleet = tmp_path / "fleet"
        entry(fleet, "dji/fc6310r/5472x3648", fx=3661.25)
        entry(fleet, "dji/fc6310r/4864x3648", fx=3650.0, image_size=(4864, 3648))
        picture(tmp_path / "in/a.jpg", **P4R)
        picture(tmp_path / "in/b.jpg", (4864, 3648), **P4R)
        picture(tmp_path / "in/c.jpg", **P4R | {"model": "FC220"})
        out = tmp_path / "out"
        arguments = ["stamp", str(tmp_path / "in"), "--from-registry", "--registry", str(files(fleet))]
        assert main([*arguments, "--out", str(out), "--json"]) == 1
        document = json.loads(capsys.readouterr().out)
        require(document, "stamp-1")
        assert [one["outcome"] for one in document["images"]] == ["stamped", "stamped", "refused"]
        assert "no entry for DJI FC220" in document["images"][2]["reason"]
        assert [calibrary.read(out / name).intrinsics.fx for name in ("a.jpg", "b.jpg")] == [3661.25, 3650.0]
        assert sorted(path.name for path in out.iterdir()) == ["a.jpg", "b.jpg"]

    def test_a_dry_run_writes_nothing_and_says_what_it_would(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "in/a.jpg", **P4R)
        (tmp_path / "in/torn.jpg").write_bytes(b"\xff\xd8\xff")
        source = picture(tmp_path / "own.jpg", **P4R, dewarp=DEWARP)
        out = tmp_path / "out"
        arguments = ["stamp", str(tmp_path / "in"), "--calibration", str(source), "--out", str(out)]
        assert main([*arguments, "--dry-run"]) == 3
        printed = capsys.readouterr().out
        assert "torn.jpg" in printed
        assert "1 of 2 images would be stamped" in printed
        assert not out.exists()
        assert main(arguments) == 3
        assert main(arguments) == 3, "what is there already stays, unless --force"
        assert "is there already" in capsys.readouterr().err
        assert main([*arguments, "--force"]) == 3
        assert (
            main(["stamp", str(tmp_path / "in/a.jpg"), *arguments[2:4], "--out", str(tmp_path / "in")]) == 3
        )
        assert "would overwrite an image" in capsys.readouterr().err

    def test_one_of_calibration_and_registry(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="one of them"):
            stamp(tmp_path)
        entry(tmp_path / "fleet", "dji/fc6310r/5472x3648")
        with pytest.raises(UsageError, match="one of them"):
            stamp(tmp_path, calibration(), from_registry=True, registry=files(tmp_path / "fleet"))


def test_numbers_of_tags_have_all_digits_no_exponent_and_no_negative_zero() -> None:
    assert _number_list(0.1 + 0.2, -1e-17, -0.0, 3.0) == "0.30000000000000004,-0.00000000000000001,0.0,3.0"
