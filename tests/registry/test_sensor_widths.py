"""Sensor widths that public databases list by make and model."""

from __future__ import annotations

import pytest

from calibrary.catalogue.sensor_widths import sensor_width


@pytest.mark.parametrize(
    ("make", "model", "mm"),
    [
        ("Canon", "Canon EOS 7D", 22.3),
        ("Canon", "Canon EOS 350D DIGITAL", 22.2),
        ("NIKON CORPORATION", "NIKON D70", 23.7),
        ("SONY", "DSC-P52", 5.312),
        ("Panasonic", "DMC-FZ18", 5.75),
        ("Asahi Optical Co.,Ltd", "PENTAX Optio 430", 7.11),
        ("Eastman Kodak Company", "KODAK Z612 ZOOM DIGITAL CAMERA", 5.75),
        ("OLYMPUS IMAGING CORP.", "E-P3", 17.3),
        ("Minolta Co., Ltd.", "DiMAGE A1", 8.8),
        ("Apple", "iPhone 12 Pro", 5.75),
        ("OLYMPUS IMAGING CORP.", "X450,D535Z,C370Z", 5.27),
        ("SAMSUNG", "SAMSUNG-SGH-I537", 3.0),
        ("asus", "ASUS_Z00ED", 4.69),
        ("SONY", "ILCE-7CM2", 36.0),
        ("NIKON CORPORATION", "NIKON Z6_3", 36.0),
        ("OM Digital Solutions", "OM-5", 17.3),
        ("Hewlett-Packard", "HP PhotoSmart C945 (V01.61)", 7.176),
    ],
)
def test_a_camera_is_found_as_exif_spells_it(make: str, model: str, mm: float) -> None:
    found = sensor_width(make, model)
    assert found is not None
    assert found.mm == pytest.approx(mm, rel=0.01)
    assert any(name in found.source for name in ("OpenSfM", "AliceVision", "lensfun"))


@pytest.mark.parametrize(
    ("make", "model"),
    [
        (None, "NIKON D70"),
        ("NIKON CORPORATION", None),
        ("NIKON CORPORATION", "D7"),
        ("Canon", "NIKON D70"),
        ("SONY", "CYBERSHOT"),
        ("Example", "One"),
        (".*", ".*"),
    ],
    ids=["no make", "no model", "part of a name", "another maker", "a series", "unknown", "a pattern"],
)
def test_a_camera_is_not_guessed(make: str | None, model: str | None) -> None:
    assert sensor_width(make, model) is None


def test_databases_that_differ_by_more_than_3_per_cent_say_nothing() -> None:
    """OpenSfM lists 5.33 mm for the camera of 2002, AliceVision 7.44 mm for that of 2013."""
    assert sensor_width("Canon", "Canon PowerShot S200") is None
