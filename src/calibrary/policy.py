"""Policies: the limits that a K is checked against, and the two policies that are included."""

from __future__ import annotations

from typing import Annotated, Any, Final, TypeAlias

from calibrary.errors import InputError
from calibrary.records import Json, Meta, Record, fields_json, require_declared

Fraction: TypeAlias = Annotated[float, Meta(ge=0, le=1)]
Band: TypeAlias = tuple[Annotated[float, Meta(gt=0)], Annotated[float, Meta(gt=0)]]
BASES: Final = ("fleet", "source")
"""Names of the policies that a policy file may be based on."""


class Policy(Record, tag_field="schema", tag="calibrary/policy-1"):
    """Limits of the validation rules, as fractions unless the name ends in px.

    Attributes:
        name: name for reports.
        focal_symmetry_max: |fx − fy| / max(fx, fy) above this is an error.
        focal_symmetry_proven: above this, K is unproven (calibrated cameras stay below 0.5 %); None to omit the check.
        principal_point_drift_max: offset from the image centre divided by the side, per axis.
        focal_over_width: (low, high) of fx / W for a K from image metadata that nothing else confirms, such as one
            from an assumed or a stated sensor size.
        measured_over_width: the same for a K that was measured (fields of view of 130 … 1 degrees: 1200 mm before an
            APS-C sensor is 54); None to apply ``focal_over_width`` to it as well.
        known_camera_tolerance: ± tolerance of a known camera's expected fx; None to apply ``focal_over_width`` to
            known cameras as well.
        independent_sources_settle: whether the sources of an unknown camera decide instead of ``focal_over_width``:
            valid if two independent ones agree, unproven with one, rejected if they contradict each other.
        source_agreement: largest relative difference between independent focal lengths that agree.
        skew_max: |skew| / fx; a bundle adjustment may leave a small skew, metadata never contains one.
        group_spread_max: (max − min) / fx over the images of one camera.
        assumed_sensor_is_unproven: whether a K from an assumed sensor size is unproven.
        distortion_monotonic: whether the distortion must be monotonic up to the image corners.
        fixed_sigma_px: a K may be kept fixed if its projections are known to this, in px …
        fixed_share: … over this share of the image, with observations nearby if it is known where they were …
        fixed_sigma_focal: … and fx to this fraction, which is the error of a flying height.
        map_sigma_focal: in maps that GNSS without corrections places (heights to metres) a K may be kept fixed if fx is
            known to this fraction; left free over flat ground, fx takes up what it likes of the height.
        start_sigma_focal: a K may be a start if fx is known to this fraction.
        metrology_sigma_px: for measuring, projections are known to this in px …
        metrology_sigma_focal: … and fx to this fraction.
        flying_height_m: height at which an uncertainty is also told in cm.
        maker_sigma_px: standard deviation over the frame in px that is granted to a calibration that a maker writes
            into images without one; None to grant none, so that it is a start.
        drift_significance: p-value below which the difference of two calibrations exceeds their measured uncertainty.
        drift_focal: two calibrations differ in practice if the image scale changes by more than this share of f …
        drift_rms_px: … or the projections over the whole image, after the best rotation, by more than this RMS in px …
        drift_max_px: … or by more than this maximum in px.

    >>> strict = calibrary.Policy(name="strict", drift_rms_px=0.1)
    >>> calibrary.compare("camera.xml", "camera.xml", policy=strict).alarm
    False
    """

    name: Annotated[str, Meta(min_length=1, max_length=60)]
    focal_symmetry_max: Fraction = 0.15
    focal_symmetry_proven: Fraction | None = 0.02
    principal_point_drift_max: Fraction = 0.05
    focal_over_width: Band = (0.8, 1.5)
    measured_over_width: Band | None = (0.23, 60.0)
    known_camera_tolerance: Fraction | None = 0.03
    independent_sources_settle: bool = True
    source_agreement: Fraction = 0.05
    skew_max: Fraction = 0.001
    group_spread_max: Fraction = 0.005
    assumed_sensor_is_unproven: bool = True
    distortion_monotonic: bool = True
    fixed_sigma_px: Annotated[float, Meta(ge=0)] = 0.5
    fixed_share: Fraction = 0.4
    fixed_sigma_focal: Fraction = 0.001
    map_sigma_focal: Fraction = 0.003
    start_sigma_focal: Fraction = 0.02
    metrology_sigma_px: Annotated[float, Meta(ge=0)] = 0.1
    metrology_sigma_focal: Fraction = 0.0001
    flying_height_m: Annotated[float, Meta(gt=0)] = 100.0
    maker_sigma_px: Annotated[float, Meta(ge=0)] | None = None
    drift_significance: Fraction = 0.01
    drift_focal: Fraction = 0.0005
    drift_rms_px: Annotated[float, Meta(ge=0)] = 0.5
    drift_max_px: Annotated[float, Meta(ge=0)] = 1.0

    def __repr__(self) -> str:
        """The name alone, so that a signature does not show every limit."""
        return f"<Policy {self.name}>"

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        """Fill in values that the file does not state from its base policy; the default base is ``fleet``."""
        base = document.pop("base", FLEET.name)
        if base not in BASES:
            raise InputError(f"is not one of {', '.join(BASES)}", place="base")
        return fields_json(POLICIES[str(base)]) | document if "name" in document else document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        said = "the policy with the limits that this one does not state; fleet when absent"
        schema["properties"]["base"] = {"enum": list(BASES), "description": said}
        return schema

    def __post_init__(self) -> None:
        require_declared(self)
        for name in ("focal_over_width", "measured_over_width"):
            band = getattr(self, name)
            if band is not None and not band[0] < band[1]:
                raise InputError(
                    f"{name} is [{band[0]:g}, {band[1]:g}], expected the lower before the higher",
                    source=self.name,
                )


FLEET = Policy(name="fleet")
"""The default: checks known cameras against their expected values, unknown ones against the sources in their
images."""

SOURCE = Policy(
    name="source",
    focal_symmetry_proven=None,
    measured_over_width=None,
    known_camera_tolerance=None,
    skew_max=0.0,
    independent_sources_settle=False,
    assumed_sensor_is_unproven=False,
    distortion_monotonic=False,
)
"""The literal limits of the source document: 15 %, 5 % and 0.8 … 1.5 W for every camera."""

POLICIES = {policy.name: policy for policy in (FLEET, SOURCE)}
