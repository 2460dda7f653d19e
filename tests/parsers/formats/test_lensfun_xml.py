"""lensfun's database: its polynomials, written down here once more in its own unit, from the corner of the frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import InputError, MissingTagError, ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

SIZE = (4000, 3000)
PTLENS = '<distortion model="ptlens" focal="8.8" a="0.0235" b="-0.1157" c="0.035"/>'
BODY = "<camera><maker>DJI</maker><model>FC9310</model><mount>djiFC9310</mount><cropfactor>2.73</cropfactor></camera>"


def lens(*rows: str, name: str = "FC9310 &amp; compatibles", mount: str = "djiFC9310", more: str = "") -> str:
    return (
        f"<lens><maker>DJI</maker><model>{name}</model><mount>{mount}</mount>{more}<cropfactor>2.73</cropfactor>"
        f"<aspect-ratio>4:3</aspect-ratio><calibration>{''.join(rows)}<tca model='poly3' focal='8.8' vr='1.0002'/>"
        "<vignetting model='pa' focal='8.8' aperture='2.8' k1='-0.8' k2='0.4' k3='-0.1'/></calibration></lens>"
    )


def database(*parts: str, head: str = "") -> bytes:
    return f"{head}<lensdatabase version='1'>{''.join(parts)}</lensdatabase>".encode()


def read(*parts: str, head: str = "") -> Sequence[Calibration]:
    return parsers.decode(database(*parts, head=head), name="mil.xml", image_size=SIZE)


SAMPLES = {"lensfun_xml": Sample(database(BODY, lens(PTLENS)))}


def radii(
    polynomial: Callable[[float], float], focal: float, *, is_fisheye: bool = False
) -> NDArray[np.float64]:
    """Radius in px of rays along x at some angles, by lensfun's formula: the frame's half shorter side is 1."""
    px_per_mm = 5000 / (math.hypot(36, 24) / 2.73)
    angles = np.linspace(0.01, 0.6, 12)
    ideal = focal * px_per_mm * (angles if is_fisheye else np.tan(angles)) / 1500
    return np.array([1500 * polynomial(rho) for rho in ideal])


@pytest.mark.parametrize(
    ("row", "polynomial"),
    [
        ('model="poly3" focal="8.8" k1="-0.012"', lambda r: r * (1 + 0.012 - 0.012 * r**2)),
        ('model="poly5" focal="8.8" k1="0.01" k2="-0.003"', lambda r: r * (1 + 0.01 * r**2 - 0.003 * r**4)),
        (
            'model="ptlens" focal="8.8" a="0.0235" b="-0.1157" c="0.035"',
            lambda r: r * (0.0235 * r**3 - 0.1157 * r**2 + 0.035 * r + 1 - 0.0235 + 0.1157 - 0.035),
        ),
        ('model="none" focal="8.8"', lambda r: r),
    ],
)
@pytest.mark.parametrize("kind", ["", "<type>rectilinear</type>", "<type>fisheye</type>"])
def test_the_radius_is_that_of_its_polynomial(
    row: str, polynomial: Callable[[float], float], kind: str
) -> None:
    [item] = read(lens(f"<distortion {row}/>", more=kind))
    angles = np.linspace(0.01, 0.6, 12)
    seen = item.project(np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)]))
    expected = radii(polynomial, 8.8, is_fisheye="fisheye" in kind)
    np.testing.assert_allclose(
        seen, np.column_stack([2000 + expected, 0 * expected + 1500]), rtol=0, atol=1e-8
    )


def test_acm_is_adobes_polynomial_in_focal_lengths() -> None:
    row = '<distortion model="acm" focal="8.8" k1="-0.1" k2="0.05" k3="-0.01" k4="0.001" k5="-0.002"/>'
    [item] = read(lens(row))
    f, x, y = item.intrinsics.fx, 0.3, -0.2
    r2 = x * x + y * y
    grown = 1 - 0.1 * r2 + 0.05 * r2**2 - 0.01 * r2**3 + 2 * (0.001 * y - 0.002 * x)
    expected = [[2000 + f * (x * grown - 0.002 * r2), 1500 + f * (y * grown + 0.001 * r2)]]
    np.testing.assert_allclose(item.project([[x, y, 1.0]]), expected, rtol=0, atol=1e-9)


def test_a_measured_focal_length_goes_before_the_nominal_one() -> None:
    nominal, measured = read(lens(PTLENS, PTLENS.replace("/>", ' real-focal="8.5"/>')))
    assert measured.intrinsics.fx == pytest.approx(8.5 * 5000 * 2.73 / math.hypot(36, 24))
    constant = 1 - 0.0235 + 0.1157 - 0.035
    assert nominal.intrinsics.fx == pytest.approx(measured.intrinsics.fx * 8.8 * constant / 8.5)


def test_it_is_a_prior_of_the_one_camera_with_its_mount_or_of_a_lens() -> None:
    other = lens('<distortion model="poly3" focal="50" k1="0.01"/>', name="50 mm", mount="M42")
    fixed, loose = read(BODY, lens(PTLENS), other)
    assert (fixed.camera.make, fixed.camera.model, fixed.camera.focal_mm) == ("DJI", "FC9310", 8.8)
    assert (loose.camera.model, loose.camera.lens, loose.camera.focal_mm) == (None, "50 mm", 50.0)
    assert fixed.grade is Grade.PRIOR
    assert any("never the calibration of one camera" in note for note in fixed.notes)


def test_a_pixel_is_that_of_the_one_camera_and_the_radius_that_of_the_lens() -> None:
    body = BODY.replace("2.73", "2.63")
    [item], [of_lens] = read(body, lens(PTLENS)), read(lens(PTLENS))
    assert item.intrinsics.fx == pytest.approx(of_lens.intrinsics.fx * 2.63 / 2.73)
    assert item.distortion == of_lens.distortion
    assert item.provenance.assumptions[0].endswith("by the crop factor of the camera itself")


def test_a_lens_calibrated_on_several_sensors_is_told_apart_by_their_crop_factor() -> None:
    other = lens(PTLENS).replace("2.73", "1.6")
    cameras = read(lens(PTLENS), other, lens(PTLENS.replace('"8.8"', '"10"')))
    assert [item.camera.sub_camera for item in cameras] == ["crop 2.73", "crop 1.6", None]


def test_lenses_without_a_counterpart_are_left_out_and_named() -> None:
    odd = lens(PTLENS, more="<type>equisolid</type>")
    off = lens(PTLENS, more="<center x='0.1' y='0'/>")
    [item] = read(odd, lens(PTLENS), off)
    assert item.provenance.tag == "lens 2, 8.8 mm"
    named = "2 of 3 profiles are left out: a centre off the middle, the projection 'equisolid'"
    assert named in item.notes
    with pytest.raises(UnsupportedModelError, match="equisolid"):
        read(odd)


def test_its_own_document_type_is_read_past_and_any_other_is_refused() -> None:
    head = '<?xml version="1.0"?>\n<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">\n'
    [item] = read(lens(PTLENS), head=head)
    assert item.camera.focal_mm == 8.8
    bomb = '<!DOCTYPE lensdatabase [<!ENTITY a "8.8">]>'
    with pytest.raises(ParseError, match="document type"):
        read(lens(PTLENS), head=bomb)


def test_the_size_of_the_image_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(database(lens(PTLENS)), name="x.xml")


def test_zeros_are_no_distortion() -> None:
    [item] = read(lens('<distortion model="poly3" focal="50" k1="0"/>'))
    assert item.distortion == NoDistortion()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (lens(PTLENS.replace('"8.8"', '"0"')), "lens 1.*focal"),
        (lens(PTLENS.replace('"0.035"', '"x"')), "lens 1, 8.8 mm, c"),
        (lens(PTLENS.replace('"0.035"', '"1.5"')), "factor of the focal length"),
        (lens(PTLENS).replace("2.73", "-1"), "cropfactor"),
        (lens(PTLENS).replace("4:3", "4:x"), "aspect-ratio"),
        (lens(PTLENS.replace(" c=", " q=")), "'lens.calibration.distortion.q'"),
        (lens(PTLENS.replace('"8.8"', '"1e200"')), "no finite terms"),
        (lens(PTLENS).replace("4:3", "1:1e-320"), "aspect-ratio: this is inf, expected at most 100:1"),
        (BODY, "no lens with a distortion profile"),
    ],
)
def test_a_broken_profile_is_named(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(text)


def test_a_profile_inside_another_is_that_of_the_inner_one() -> None:
    data = f"<lens><mount>other</mount>{lens(PTLENS)}</lens>".encode()
    [item] = parsers.decode(data, name="x.xml", image_size=SIZE, format="lensfun_xml")
    assert item.camera.lens == "FC9310 & compatibles"
