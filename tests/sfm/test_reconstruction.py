"""Reconstructions of other programs: read as they were written, and adjusted as our own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from calibrary.calib.lens_models import Solvable
from calibrary.distortion import FieldOfView, KannalaBrandt
from calibrary.errors import CalibrationError, InputError, ParseError
from calibrary.records import replace
from calibrary.sfm.adjust import adjust
from calibrary.sfm.colmap_folder import is_colmap_folder, read_colmap
from calibrary.sfm.opensfm_folder import is_opensfm_folder, read_opensfm
from calibrary.sfm.reconstruction import Reconstruction, scene_of
from calibrary.sfm.sigma import covariance
from calibrary.sfm.tracks import Scene, Tracks
from tests.sfm.flights import CAMERA, Plan, fly
from tests.sfm.reconstructions import STATED, write_colmap, write_opensfm

SMALL = Plan(relief=0.05, heights=(1.0, 1.4), cross=True, rows=2, columns=4, points=250, outliers=0.0)


@pytest.fixture(scope="module")
def flown() -> tuple[Tracks, Scene]:
    return fly(SMALL, 3)


@pytest.fixture(scope="module")
def text(flown: tuple[Tracks, Scene], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_colmap(tmp_path_factory.mktemp("colmap") / "sparse/0", *flown)


@pytest.fixture(scope="module")
def binary(text: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same model as COLMAP itself reads and writes it."""
    folder = tmp_path_factory.mktemp("binary")
    pycolmap.Reconstruction(str(text)).write_binary(str(folder))
    return folder


@pytest.fixture
def odm(flown: tuple[Tracks, Scene], tmp_path: Path) -> Path:
    return write_opensfm(tmp_path / "opensfm", *flown).parent


def every(model: Reconstruction) -> np.ndarray:
    return np.ones(len(model.names), dtype=np.bool_)


def same(model: Reconstruction, flown: tuple[Tracks, Scene]) -> None:
    """What a model holds is what was flown, whatever its numbers for images and points are."""
    tracks, scene = flown
    back, start, stated = scene_of(model, every(model), 100)
    assert stated.intrinsics.fx == pytest.approx(STATED.intrinsics.fx)
    assert sorted(back.names) == sorted(tracks.names)
    order = [back.names.index(name) for name in tracks.names]
    np.testing.assert_allclose(start.rotations[order], scene.rotations, atol=1e-9)
    np.testing.assert_allclose(start.centres[order], scene.centres, atol=1e-7)
    # A pixel tells which point it is of.
    mine = np.column_stack([tracks.image, tracks.pixels, scene.points[tracks.point]])
    theirs = np.column_stack([np.argsort(order)[back.image], back.pixels, start.points[back.point]])
    np.testing.assert_allclose(theirs[np.lexsort(theirs.T[:2])], mine[np.lexsort(mine.T[:2])], atol=1e-6)


def test_colmaps_text_is_read_as_it_was_written(text: Path, flown: tuple[Tracks, Scene]) -> None:
    same(read_colmap(text), flown)
    # A project is named by its own folder as well.
    assert is_colmap_folder(text.parents[1])


def test_what_colmap_writes_is_read_as_colmap_reads_it(binary: Path, flown: tuple[Tracks, Scene]) -> None:
    model = read_colmap(binary)
    same(model, flown)
    theirs = pycolmap.Reconstruction(str(binary))
    assert (len(model.image), len(model.points)) == (theirs.compute_num_observations(), theirs.num_points3D())
    for at, name in enumerate(model.names):
        image = theirs.find_image_with_name(name)
        np.testing.assert_allclose(model.centres[at], image.projection_center(), atol=1e-9)
        assert int((model.image == at).sum()) == image.num_points3D


def test_opensfms_result_is_read_with_its_positions(odm: Path, flown: tuple[Tracks, Scene]) -> None:
    assert is_opensfm_folder(odm)
    model = read_opensfm(odm)
    same(model, flown)
    assert model.positions is not None
    assert flown[0].positions is not None
    np.testing.assert_allclose(model.positions.places, flown[0].positions.places)
    # A receiver's dilution of precision is no standard deviation; RTK's is one.
    np.testing.assert_allclose(model.positions.std[0], (3.0, 3.0, 5.0))
    document = json.loads((odm / "opensfm/reconstruction.json").read_text())
    document[1]["shots"]["IMG_0000.JPG"]["gps_dop"] = 0.02
    (odm / "opensfm/reconstruction.json").write_text(json.dumps(document))
    rtk = read_opensfm(odm).positions
    assert rtk is not None
    np.testing.assert_allclose(rtk.std[:2], [(0.02, 0.02, 0.03), (3.0, 3.0, 5.0)])


def test_the_camera_follows_from_the_observations_and_not_from_what_the_program_states(
    binary: Path, flown: tuple[Tracks, Scene]
) -> None:
    tracks, scene = flown
    model = read_colmap(binary)
    found = adjust(*scene_of(model, every(model), 100)[:2], model=Solvable.BROWN).bundle
    ours = adjust(replace(tracks, positions=None), scene, model=Solvable.BROWN).bundle
    np.testing.assert_allclose(found.scene.parameters[:4], ours.scene.parameters[:4], atol=0.05)
    np.testing.assert_allclose(np.diag(covariance(found)), np.diag(covariance(ours)), rtol=0.02)
    assert abs(found.scene.parameters[0] - CAMERA.intrinsics.fx) < 4 * covariance(found)[0, 0] ** 0.5
    assert abs(found.scene.parameters[0] - STATED.intrinsics.fx) > 4


def test_of_many_images_those_are_chosen_that_differ(binary: Path) -> None:
    model = read_colmap(binary)
    tracks, scene, _ = scene_of(model, every(model), 10)
    assert len(tracks.names) == 10
    high = scene.centres[:, 2] > 95
    assert 3 <= int(high.sum()) <= 7


def test_a_point_that_an_image_shows_twice_is_of_no_use(text: Path) -> None:
    model = read_colmap(text)
    twice = replace(
        model,
        image=np.append(model.image, model.image[0]),
        point=np.append(model.point, model.point[0]),
        pixels=np.vstack([model.pixels, model.pixels[:1] + 3]),
    )
    before, after = (len(scene_of(one, every(one), 100)[0].image) for one in (model, twice))
    assert after in {before - 1, before - 2}


def test_other_lens_models_are_a_start_too(text: Path) -> None:
    model = read_colmap(text)

    def start(**by: object) -> Scene:
        other = {name: replace(one, **by) for name, one in model.cameras.items()}
        return scene_of(replace(model, cameras=other), every(model), 100)[1]

    assert start(distortion=KannalaBrandt(k1=0.1, k2=0.0, k3=0.0, k4=0.0)).model is Solvable.FISHEYE
    assert start(distortion=FieldOfView(omega=0.9)).model is Solvable.BROWN
    wide = replace(STATED.intrinsics, fx=400.0, fy=400.0)
    assert start(distortion=FieldOfView(omega=0.9), intrinsics=wide).model is Solvable.FISHEYE


def test_what_shows_too_little_is_said(text: Path) -> None:
    model = read_colmap(text)
    few = replace(model, image=model.image[:40], point=model.point[:40], pixels=model.pixels[:40])
    with pytest.raises(CalibrationError, match="need 3"):
        scene_of(few, every(few), 100)
    assert len(scene_of(model, every(model), 3)[0].names) == 3


@pytest.mark.parametrize("part", ["images", "points3D"])
@pytest.mark.parametrize("share", [0.0005, 0.01, 0.3, 0.7, 0.999])
def test_a_binary_file_that_was_cut_short_is_refused(
    binary: Path, tmp_path: Path, part: str, share: float
) -> None:
    for file in binary.iterdir():
        data = file.read_bytes()
        (tmp_path / file.name).write_bytes(data[: int(len(data) * share)] if file.stem == part else data)
    with pytest.raises(ParseError):
        read_colmap(tmp_path)


@pytest.mark.parametrize(
    ("part", "row"),
    [
        ("images.txt", "1 0.5 0.5 0.5 x 0 0 1 1 a.jpg\n\n"),
        ("images.txt", "1 1 0 0 0 0 0 1 1\n\n"),
        ("images.txt", "1 1 0 0 0 0 0 1 1 a.jpg\n1 2\n"),
        ("images.txt", "1 0 0 0 0 0 0 1 1 a.jpg\n5 6 8\n"),
        ("images.txt", "# no image\n"),
        ("points3D.txt", "1 2 3\n"),
        ("points3D.txt", "1 nan 0 0 1 1 1 0.5 1 1\n"),
    ],
)
def test_a_broken_text_file_is_refused(text: Path, tmp_path: Path, part: str, row: str) -> None:
    for file in text.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / part).write_text(row)
    with pytest.raises(ParseError):
        read_colmap(tmp_path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"rotation": [', '"rotation": ["a", '),
        ('"camera": "v2 example"', '"camera": "v2 other"'),
        ('"coordinates"', '"places"'),
        ("[{", "{"),
        ('"shots"', '"views"'),
    ],
)
def test_a_broken_reconstruction_is_refused(odm: Path, old: str, new: str) -> None:
    path = odm / "opensfm/reconstruction.json"
    broken = path.read_text().replace(old, new)
    assert broken != path.read_text()
    path.write_text(broken)
    with pytest.raises(ParseError):
        read_opensfm(odm)


def test_a_folder_without_a_model_is_none(tmp_path: Path) -> None:
    assert not is_colmap_folder(tmp_path)
    assert not is_opensfm_folder(tmp_path)
    for read in (read_colmap, read_opensfm):
        with pytest.raises(InputError, match="expected"):
            read(tmp_path)
