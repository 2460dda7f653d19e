"""COLMAP's files and database, against pycolmap: every model it lists, point by point and file by file."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from calibrary import parsers
from calibrary.calibration import Grade
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    Division,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    NoDistortion,
    RadTanThinPrismFisheye,
    Rational,
    ThinPrism,
    ThinPrismFisheye,
)
from calibrary.errors import ParseError, UnknownFormatError, UnsupportedModelError
from calibrary.interop.colmap import COLMAP_MODELS, PANORAMAS
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera
from tests.parsers.formats.colmap_peer import PEER_MODELS, WITH_K, peer, rays, read

WITH_PANORAMAS = pytest.mark.skipif(
    "EQUIRECTANGULAR" not in PEER_MODELS, reason="pycolmap 4.0 has neither panoramas nor EUCM"
)


def peer_files(folder: Path, items: Sequence[pycolmap.Camera]) -> tuple[bytes, bytes]:
    """(text, binary) as pycolmap writes them."""
    reconstruction = pycolmap.Reconstruction()
    for item in items:
        reconstruction.add_camera(item)
    reconstruction.write_text(folder)
    reconstruction.write_binary(folder)
    return (folder / "cameras.txt").read_bytes(), (folder / "cameras.bin").read_bytes()


def read_by_peer(folder: Path, name: str, data: bytes) -> dict[int, pycolmap.Camera]:
    """The cameras that pycolmap reads out of a file of ours, in an otherwise empty reconstruction of its own."""
    empty = pycolmap.Reconstruction()
    if name.endswith(".txt"):
        empty.write_text(folder)
    else:
        empty.write_binary(folder)
    (folder / name).write_bytes(data)
    reconstruction = pycolmap.Reconstruction()
    if name.endswith(".txt"):
        reconstruction.read_text(folder)
    else:
        reconstruction.read_binary(folder)
    return dict(reconstruction.cameras)


def line(text: str) -> bytes:
    return f"{text}\n".encode()


@WITH_PANORAMAS
def test_the_table_lists_every_model_of_pycolmap_with_its_number() -> None:
    ours = {model.name: model.number for model in COLMAP_MODELS}
    ours |= {name: number for number, (name, _) in PANORAMAS.items()}
    assert ours == {name: int(pycolmap.CameraModelId.__members__[name]) for name in PEER_MODELS}
    for model in COLMAP_MODELS:
        assert model.count == len(peer(model.name).params)


@pytest.mark.parametrize("model", WITH_K)
def test_a_model_projects_point_by_point_as_pycolmap_does(model: str, tmp_path: Path) -> None:
    theirs = peer(model)
    expected = np.asarray(theirs.img_from_cam(rays()))
    assert np.isfinite(expected).all()
    for data, name in zip(peer_files(tmp_path, [theirs]), ("cameras.txt", "cameras.bin"), strict=True):
        [ours] = read(data, name)
        np.testing.assert_allclose(ours.project(rays()), expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.project(ours.unproject(expected)), expected, rtol=0, atol=1e-9)
        assert ours.intrinsics.image_size == SIZE
        assert ours.grade is Grade.ADJUSTED


@pytest.mark.parametrize("name", ["cameras.txt", "cameras.bin"])
def test_every_model_goes_back_to_pycolmap_digit_for_digit(name: str, tmp_path: Path) -> None:
    theirs = [peer(model, number=7 * index + 3) for index, model in enumerate(WITH_K)]
    data = peer_files(tmp_path, theirs)[name.endswith(".bin")]
    again, verdict = parsers.encode(
        read(data, name), {"t": "colmap_text", "b": "colmap_binary"}[name[8]], name=name
    )
    assert str(verdict) == "exact (0.000 px)"
    back = read_by_peer(tmp_path, name, again)
    assert sorted(back) == [item.camera_id for item in theirs]
    for item in theirs:
        copy = back[item.camera_id]
        assert copy.model == item.model
        assert (copy.width, copy.height) == SIZE
        assert list(copy.params) == list(item.params)


@WITH_PANORAMAS
def test_a_panorama_has_no_k_and_is_refused_by_name(tmp_path: Path) -> None:
    for data, name in zip(peer_files(tmp_path, [peer("EQUIRECTANGULAR")]), ("c.txt", "c.bin"), strict=True):
        with pytest.raises(UnsupportedModelError, match="EQUIRECTANGULAR, which has no K"):
            read(data, name)


@WITH_PANORAMAS
def test_among_other_cameras_a_panorama_is_left_out_with_a_note(tmp_path: Path) -> None:
    both = [peer("PINHOLE", 1), peer("EQUIRECTANGULAR", 2), peer("OPENCV", 3)]
    for data, name in zip(peer_files(tmp_path, both), ("c.txt", "c.bin"), strict=True):
        first, last = read(data, name)
        assert (first.camera.sub_camera, last.camera.sub_camera) == ("1", "3")
        assert all("camera 2 is EQUIRECTANGULAR" in item.notes[0] for item in (first, last))


@pytest.mark.parametrize(
    ("lens", "model"),
    [
        (None, "OPENCV"),
        (NoDistortion(), "PINHOLE"),
        (BrownConrady(k1=0.1, k2=0.02, p1=1e-3, p2=-2e-3), "OPENCV"),
        (BrownConrady(k1=0, k2=0, p1=0, p2=0), "OPENCV"),
        (BrownConrady(k1=0.1, k2=0.02, p1=1e-3, p2=-2e-3, k3=-0.01), "FULL_OPENCV"),
        (Rational(k1=0.1, k2=0.02, p1=1e-3, p2=-2e-3, k3=-0.01, k4=0.3, k5=0, k6=0), "FULL_OPENCV"),
        (ThinPrism(k1=0.1, k2=0, p1=0, p2=0, k3=0, k4=0, k5=0, k6=0, s1=0, s2=0, s3=0, s4=0), "OPENCV"),
        (KannalaBrandt(k1=0.1, k2=0.02, k3=0.003, k4=0.0004), "OPENCV_FISHEYE"),
        (FieldOfView(omega=0.7), "FOV"),
        pytest.param(ExtendedUnified(alpha=0.0, beta=1.3), "EUCM", marks=WITH_PANORAMAS),
        (Division(k=-0.1), "DIVISION"),
        (
            ThinPrismFisheye(k1=0.1, k2=0, p1=1e-3, p2=0, k3=0, k4=0, sx1=0, sy1=0),
            "THIN_PRISM_FISHEYE",
        ),
        (
            RadTanThinPrismFisheye(
                k0=0.1, k1=0, k2=0, k3=0, k4=0, k5=0, p0=1e-3, p1=0, s0=0, s1=0, s2=0, s3=0
            ),
            "RAD_TAN_THIN_PRISM_FISHEYE",
        ),
    ],
    ids=repr,
)
def test_a_lens_goes_to_the_model_that_holds_it_with_two_focal_lengths(
    lens: Distortion | None, model: str
) -> None:
    given = camera(lens).to_colmap()
    assert given.model == model
    theirs = pycolmap.Camera(**given._asdict())
    ours = camera(lens).project(rays())
    np.testing.assert_allclose(ours, np.asarray(theirs.img_from_cam(rays())), rtol=0, atol=1e-9)


def test_what_colmap_has_no_model_for_is_refused() -> None:
    prism = ThinPrism(k1=0.1, k2=0, p1=0, p2=0, k3=0, k4=0, k5=0, k6=0, s1=1e-3, s2=0, s3=0, s4=0)
    with pytest.raises(UnsupportedModelError, match="thin-prism"):
        camera(prism).to_colmap()
    with pytest.raises(UnsupportedModelError, match="skew"):
        camera(skew=0.1).to_colmap()


def test_a_model_with_one_focal_length_is_kept_while_it_holds_the_camera() -> None:
    [one] = read(line("1 SIMPLE_RADIAL 5472 3648 3650.1 2741.3 1815.9 -0.0213"))
    assert parsers.encode([one], "colmap_text")[0].splitlines()[-1].split()[1] == b"SIMPLE_RADIAL"
    oblong = replace(one, intrinsics=replace(one.intrinsics, fy=3648.7))
    data, verdict = parsers.encode([oblong], "colmap_text")
    assert data.splitlines()[-1].split()[1] == b"OPENCV"
    assert verdict.outcome is Fidelity.EXACT


def test_a_lens_without_terms_reads_as_none() -> None:
    [item] = read(line("1 OPENCV 5472 3648 3650.1 3648.7 2741.3 1815.9 0 0 0 0"))
    assert item.distortion == NoDistortion()
    [item] = read(line("1 FULL_OPENCV 5472 3648 3650.1 3648.7 2741.3 1815.9 .1 0 0 0 .01 0 0 0"))
    assert item.distortion == BrownConrady(k1=0.1, k2=0, p1=0, p2=0, k3=0.01)


def test_colmaps_series_for_tiny_angles_is_pointed_out() -> None:
    [item] = read(line("1 FOV 5472 3648 3650.1 3648.7 2741.3 1815.9 0.0071"))
    assert "series" in item.notes[0]
    assert read(line("1 FOV 5472 3648 3650.1 3648.7 2741.3 1815.9 0.71"))[0].notes == ()


def test_a_camera_keeps_its_number() -> None:
    [item] = read(line("42 PINHOLE 5472 3648 3650.1 3648.7 2741.3 1815.9"))
    assert item.camera.sub_camera is None
    assert parsers.encode([item], "colmap_text")[0].splitlines()[-1].startswith(b"42 ")
    [item] = read(parsers.encode([item], "colmap_binary")[0], "cameras.bin")
    assert item.provenance.tag == "camera 42"


def test_without_its_heading_a_line_tells_what_it_is() -> None:
    [item] = read(line("# by hand\n\n1 SIMPLE_RADIAL 800 1200 2468.36 400 600 -0.556541"))
    assert item.intrinsics.image_size == (800, 1200)
    with pytest.raises(UnknownFormatError):
        read(line("1 0.85 0.1 0.2 0.3 1.5 2.5 3.5 1 image.jpg"))


def test_a_heading_that_counts_more_cameras_betrays_a_cut_file() -> None:
    data, _ = parsers.encode(
        [replace(camera(), camera=replace(camera().camera, sub_camera=n)) for n in "12"], "colmap_text"
    )
    cut = b"".join(data.splitlines(keepends=True)[:-1])
    with pytest.raises(ParseError, match="cut short"):
        read(cut)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 OPENCV 5472 3648 3650.1 3648.7 2741.3 1815.9 0 0 0", "7 parameters, expected 8"),
        ("1 PINHOLE 5472 3648 3650.1 3648.7 2741.3 nan", "not finite"),
        ("1 PINHOLE 5472 3648 3650,1 3648.7 2741.3 1", "decimal point"),
        ("1 PINHOLE 5472 3648 0 3648.7 2741.3 1", "focal lengths"),
        ("1 PINHOLE 0 3648 3650.1 3648.7 2741.3 1", "image size"),
        ("1 PINHOLE 5472", "3 words"),
        ("-1 PINHOLE 5472 3648 3650.1 3648.7 2741.3 1", "from 0"),
        ("1 FOV 5472 3648 3650.1 3648.7 2741.3 1 54", "degrees"),
        ("1 PINHOLE 5 5 1 1 1 1\n1 PINHOLE 5 5 1 1 1 1", "two cameras 1"),
    ],
)
def test_a_broken_line_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(line(text), format="colmap_text")


def test_a_model_of_a_later_colmap_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedModelError, match="'METASHAPE'"):
        read(line("1 METASHAPE 5472 3648 1 1 1 1"), format="colmap_text")
    with pytest.raises(UnsupportedModelError, match="model 18"):
        read(struct.pack("<QIiQQ4d", 1, 1, 18, 5472, 3648, 1, 1, 1, 1), "cameras.bin", format="colmap_binary")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (struct.pack("<Q", 0), "states 0 cameras"),
        (struct.pack("<Q", 1 << 40), "states 1099511627776 cameras; at most 1000000"),
        (struct.pack("<QIiQQ4d", 1, 1, 1, 5472, 3648, 1, 1, 1, float("nan")), "not finite"),
        (struct.pack("<QIiQQ4d", 1, 1, 1, 0, 3648, 1, 1, 1, 1), "image size"),
        (struct.pack("<QIiQQ4d", 1, 1, 1, 5472, 3648, 1, 1, 1, 1) + b"\0", "1 bytes follow"),
        (
            struct.pack("<Q", 30)
            + b"".join(struct.pack("<IiQQ4d", at, 1, 1 << 63, 9, 1, 1, 1, 1) for at in range(30)),
            "camera 1 of 30: the image size is 9.22337e\\+18×9",
        ),
        (struct.pack("<QIiQQ3d", 1, 1, 1, 5472, 3648, 1, 1, 1), "ends inside"),
    ],
)
def test_a_broken_binary_names_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(data, "cameras.bin", format="colmap_binary")


def test_a_binary_file_of_something_else_is_not_claimed() -> None:
    for data in (bytes(64), struct.pack("<QIiQQ4d", 1, 1, 1, 5472, 3648, 1, 1, 1, 1) + b"\0"):
        with pytest.raises(UnknownFormatError):
            read(data, "images.bin")
