"""What a file shows of its pixels: each manipulation that leaves a trace is seen, and originals show nothing."""

from __future__ import annotations

from collections import Counter

import pytest

from calibrary.catalogue import camera_named, search_catalogue
from calibrary.evidence.metadata import Encoding, ImageMetadata
from calibrary.evidence.originality import (
    Does,
    Pixels,
    has_lens_correction,
    no_frame,
    originality,
    program_in,
    usual_of,
)
from calibrary.records import replace
from tests.evidence.scenes import M3T_THERMAL, p4_rtk, xmp

OWN = Encoding(segments=("Exif", "MPF"), sampling=((2, 1), (1, 1), (1, 1)))
CANON = ImageMetadata(
    size=(5472, 3648),
    exif_size=(5472, 3648),
    related_size=(5472, 3648),
    make="Canon",
    model="Canon EOS 6D",
    focal_mm=24.0,
    has_exif=True,
    has_maker_note=True,
    has_thumbnail=True,
    byte_order="<",
    encoding=OWN,
)
SAVED = Encoding(
    segments=("JFIF", "Exif"), sampling=((2, 2), (1, 1), (1, 1)), standard_tables=True, standard_codes=True
)


def test_an_original_shows_nothing() -> None:
    found = originality(CANON)
    assert found.pixels is Pixels.ORIGINAL
    assert (found.seen, found.done) == ((), ())


def test_djis_own_crs_properties_say_that_nothing_was_done() -> None:
    original = replace(p4_rtk(), xmp=xmp("crs", HasSettings="False", HasCrop="False", AlreadyApplied="False"))
    assert originality(original).pixels is Pixels.ORIGINAL


def test_a_crop_that_was_applied_is_told() -> None:
    found = originality(replace(p4_rtk(), xmp=xmp("crs", HasCrop="True", AlreadyApplied="True")))
    assert found.pixels is Pixels.ALTERED
    assert found.moved == found.done
    assert found.done[0].startswith("cropped by an editor")


def test_a_lens_profile_that_was_applied_leaves_the_distortion_unknown() -> None:
    corrected = replace(p4_rtk(), xmp=xmp("crs", LensProfileEnable="1", AlreadyApplied="True"))
    found = originality(corrected)
    assert found.pixels is Pixels.RESAVED
    assert found.done == ("lens-corrected by an editor: its distortion is unknown",)
    assert has_lens_correction(corrected)


def test_a_crop_that_is_only_planned_moves_no_pixel() -> None:
    planned = replace(p4_rtk(), xmp=xmp("crs", HasCrop="True", AlreadyApplied="False"))
    assert originality(planned).pixels is Pixels.ORIGINAL


def test_a_program_that_says_that_it_kept_the_frame_and_the_lens_is_believed() -> None:
    kept = replace(
        CANON,
        software="Adobe Photoshop Lightroom Classic 12.0 (Windows)",
        encoding=SAVED,
        xmp=xmp("crs", HasCrop="False", LensProfileEnable="0", AlreadyApplied="True"),
    )
    assert originality(kept).pixels is Pixels.TOUCHED
    assert originality(replace(kept, size=(2736, 1824))).pixels is Pixels.ALTERED


@pytest.mark.parametrize(
    ("change", "seen"),
    [
        ({"size": (2736, 1824)}, "EXIF states 5472×3648, and the file has 2736×1824 px"),
        ({"size": (4104, 2736), "exif_size": (4104, 2736)}, "interoperability directory states 5472×3648"),
        ({"size": (4379, 2919), "exif_size": (4379, 2919), "related_size": None}, "whose sides are even"),
        ({"encoding": replace(OWN, sampling=((1, 2), (1, 1), (1, 1)))}, "the other direction"),
        ({"encoding": replace(OWN, turned_tables=True)}, "rows and columns exchanged"),
        ({"main_size": (6000, 4000)}, "EXIF's first directory states 6000×4000"),
    ],
)
def test_another_frame_is_seen_from_its_size(change: dict[str, object], seen: str) -> None:
    found = originality(replace(CANON, **change))
    assert found.pixels is Pixels.ALTERED
    assert seen in found.seen[0]


@pytest.mark.parametrize(
    ("change", "seen"),
    [
        ({"encoding": SAVED}, "a JFIF segment, which Canon cameras do not write"),
        ({"encoding": replace(OWN, standard_tables=True)}, "tables are those of libjpeg"),
        ({"encoding": replace(SAVED, standard_codes=False)}, "Huffman codes are computed for it"),
        ({"encoding": replace(OWN, split_tables=True)}, "quantisation tables has a segment of its own"),
        ({"encoding": replace(OWN, progressive=True)}, "progressive"),
        ({"encoding": replace(OWN, segments=("Exif", "Adobe"))}, "Adobe"),
        ({"encoding": replace(OWN, sampling=((1, 1),) * 3)}, "not subsampled"),
        ({"has_maker_note": False}, "MakerNote is missing"),
        ({"has_thumbnail": False}, "thumbnail is missing"),
        ({"byte_order": ">"}, "the other byte order"),
        ({"software": "GIMP 2.10.30"}, "EXIF Software names GIMP 2.10.30"),
    ],
)
def test_saving_an_image_again_is_seen_from_how_it_is_written(change: dict[str, object], seen: str) -> None:
    found = originality(replace(CANON, **change))
    assert found.pixels is Pixels.RESAVED
    assert any(seen in one for one in found.seen)
    assert not found.lens_corrected


@pytest.mark.parametrize(
    "software",
    [
        "DxO PhotoLab 6.3",
        "darktable 4.2.1",
        "RawTherapee 5.9",
        "Capture One 22 Macintosh",
        "ON1 Photo RAW 2023",
        "Adobe Lightroom 8.0.1 (iOS)",
    ],
)
def test_a_raw_developer_leaves_the_distortion_unknown(software: str) -> None:
    developed = replace(CANON, software=software)
    assert has_lens_correction(developed)
    assert software in originality(developed).done[0]


@pytest.mark.parametrize(
    "software", ["v01.09.1691", "10.00.02.46", "Ver.1.03", "9.3.5", "17.1.A.2.55_9_f300", "HDR+ 1.0.3"]
)
def test_a_firmware_is_no_program(software: str) -> None:
    assert program_in(software) is None


@pytest.mark.parametrize("software", ["Nikon Transfer 2.0", "ExifTool 12.40", "PMB 5.0"])
def test_a_program_that_writes_tags_alone_moves_no_pixel(software: str) -> None:
    named = program_in(software)
    assert named is not None
    assert named.does is Does.TAGS
    assert originality(replace(CANON, software=software)).pixels is Pixels.TOUCHED
    assert originality(replace(CANON, software=software)).done == ()


def test_a_thermal_camera_may_write_twice_its_frame() -> None:
    camera = camera_named("Matrice 30T, thermal")
    thermal = ImageMetadata(size=(640, 512), exif_size=(1280, 1024), make="DJI", model="M30T", encoding=OWN)
    assert originality(thermal, camera).pixels is Pixels.ORIGINAL
    assert originality(replace(thermal, size=(320, 256)), camera).pixels is Pixels.ALTERED


def test_a_size_that_the_camera_does_not_write_is_seen() -> None:
    camera = camera_named("FC6310")
    listed = replace(camera, sizes=((5472, 3648), (4864, 3648), (5472, 3078)))
    frame = ImageMetadata(size=(4864, 3648), exif_size=(4864, 3648), make="DJI", model="FC6310", encoding=OWN)
    assert originality(frame, listed).pixels is Pixels.ORIGINAL
    assert (
        originality(replace(frame, size=(3648, 4864), exif_size=(3648, 4864)), listed).pixels
        is Pixels.ORIGINAL
    )
    cut = replace(frame, size=(4376, 2918), exif_size=(4376, 2918))
    assert originality(cut, listed).pixels is Pixels.ALTERED
    assert "this camera writes 5472×3648, 4864×3648, 5472×3078" in originality(cut, listed).seen[0]


@pytest.mark.parametrize(
    ("size", "pixels"),
    [
        ((5472, 3648), Pixels.ORIGINAL),
        ((3648, 5472), Pixels.ORIGINAL),
        ((4864, 3648), Pixels.ORIGINAL),
        ((5472, 3078), Pixels.ORIGINAL),
        ((2736, 1824), Pixels.ORIGINAL),
        ((3840, 2160), Pixels.ORIGINAL),
        ((72, 48), Pixels.ORIGINAL),
        ((4104, 2736), Pixels.ALTERED),
        ((5312, 3536), Pixels.ALTERED),
    ],
)
def test_a_camera_of_whole_frames_writes_them_joined_or_in_another_format(
    size: tuple[int, int], pixels: Pixels
) -> None:
    camera = replace(camera_named("FC6310"), sizes=())
    frame = ImageMetadata(size=size, exif_size=size, make="DJI", model="FC6310", encoding=OWN)
    assert originality(frame, camera).pixels is pixels
    assert originality(frame, replace(camera, make="Canon")).pixels is Pixels.ORIGINAL


@pytest.mark.parametrize(
    ("model", "size"),
    [
        ("FC6540", (6016, 4008)),
        ("FC6540", (6016, 3376)),
        ("FC6310", (3840, 2160)),
        ("FC3582", (4000, 2250)),
        ("L1D-20c", (2688, 1512)),
        ("FC2204", (2688, 1512)),
        ("FC7303", (2688, 1512)),
        ("L2D-20c", (5120, 2700)),
        ("M3E", (5120, 2700)),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_a_mode_of_the_maker_is_original_upright_too(model: str, size: tuple[int, int], turned: bool) -> None:
    named = [camera for camera in search_catalogue(model) if model in camera.models]
    assert named
    written = size[::-1] if turned else size
    frame = ImageMetadata(size=written, exif_size=written, make="DJI", model=model, encoding=OWN)
    assert {originality(frame, camera).pixels for camera in named} == {Pixels.ORIGINAL}


def test_only_models_that_are_known_to_write_something_miss_it() -> None:
    phone = replace(CANON, make="Apple", model="iPhone 7", byte_order=">", related_size=None)
    assert "it has no restart intervals, which Apple cameras write" in originality(phone).seen
    assert originality(replace(phone, encoding=replace(OWN, restarts=True))).pixels is Pixels.ORIGINAL
    assert originality(replace(phone, model="iPhone 4")).pixels is Pixels.ORIGINAL


def test_a_model_of_several_cameras_is_judged_by_the_one_that_was_seen() -> None:
    thermal = ImageMetadata(
        size=(640, 512), make="DJI", model="M3T", encoding=SAVED, has_exif=True, has_thumbnail=True
    )
    assert originality(thermal).pixels is Pixels.RESAVED
    assert originality(replace(thermal, size=(4000, 3000))).pixels is Pixels.ORIGINAL
    written = replace(thermal, encoding=replace(SAVED, segments=("Exif", "MPF", "JFIF")))
    assert originality(written).pixels is Pixels.ORIGINAL
    alone = originality(replace(written, encoding=replace(SAVED, segments=("Exif", "JFIF"))))
    assert alone.seen == ("its second image is missing, which DJI cameras write",)


def test_an_image_that_is_written_otherwise_than_the_rest_of_its_flight_is_seen() -> None:
    unknown = replace(CANON, make="Acme", model="Nine")
    stranger = replace(unknown, encoding=SAVED, size=(4000, 3000), exif_size=(4000, 3000), related_size=None)
    usual = usual_of(Counter({unknown: 9, stranger: 1}))
    assert originality(unknown, usual=usual[unknown]).pixels is Pixels.ORIGINAL
    found = originality(stranger, usual=usual[stranger])
    assert found.pixels is Pixels.RESAVED
    assert "9 of 10 images of this camera" in found.seen[0]


def test_two_ways_of_writing_that_are_equally_frequent_show_nothing() -> None:
    unknown = replace(CANON, make="Acme", model="Nine")
    other = replace(unknown, encoding=SAVED)
    assert usual_of({unknown: 5, other: 5}) == {}
    assert usual_of({unknown: 2}) == {}


@pytest.mark.parametrize(
    "change",
    [
        {"software": "PTGui Pro 12.11"},
        {"software": "Hugin 2019.2.0"},
        {"xmp": xmp("GPano", ProjectionType="equirectangular")},
    ],
)
def test_a_panorama_has_no_k(change: dict[str, object]) -> None:
    why = no_frame(replace(CANON, **change))
    assert why is not None
    assert why.startswith("it is a panorama")


def test_a_frame_has_a_k() -> None:
    assert no_frame(CANON) is None


@pytest.mark.parametrize(
    ("size", "pixels"),
    [
        ((640, 512), Pixels.ORIGINAL),
        ((1280, 1024), Pixels.ORIGINAL),
        ((626, 500), Pixels.ALTERED),
        ((512, 640), Pixels.ALTERED),
    ],
)
def test_a_thermal_camera_writes_its_frame_or_twice_its_frame(size: tuple[int, int], pixels: Pixels) -> None:
    metadata = ImageMetadata(size=size, exif_size=size, make="DJI", model="M3T", has_exif=True)
    assert originality(metadata, M3T_THERMAL).pixels is pixels
