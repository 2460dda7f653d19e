"""An editor's mark counts only where it says that something was applied."""

from __future__ import annotations

from calibrary.evidence.edits import edits
from calibrary.records import replace
from tests.evidence.scenes import p4_rtk, xmp


def test_djis_own_crs_properties_say_that_nothing_was_done() -> None:
    original = replace(p4_rtk(), xmp=xmp("crs", HasSettings="False", HasCrop="False", AlreadyApplied="False"))
    assert edits(original) == ()


def test_a_crop_that_was_applied_is_told() -> None:
    cropped = replace(p4_rtk(), xmp=xmp("crs", HasCrop="True", AlreadyApplied="True"))
    assert edits(cropped) == ("cropped by an editor",)


def test_a_lens_profile_that_was_applied_is_told() -> None:
    corrected = replace(p4_rtk(), xmp=xmp("crs", LensProfileEnable="1", AlreadyApplied="True"))
    assert edits(corrected) == ("lens-corrected by an editor",)


def test_a_crop_that_is_only_planned_moves_no_pixel() -> None:
    planned = replace(p4_rtk(), xmp=xmp("crs", HasCrop="True", AlreadyApplied="False"))
    assert edits(planned) == ()
