"""From a keyed sheet's lengths to pixels: every one by its own unit, through the pitch of the pixels."""

from __future__ import annotations

from calibrary.calibration import ASPECT_TOLERANCE, ImageSize
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.format import ReadContext
from calibrary.parsers.formats._keyed_options import UNIT
from calibrary.parsers.formats._keyed_sheet import Sheet
from calibrary.parsers.formats._keyed_terms import Value

__all__ = ["Scale"]

MM = {"mm": 1.0, "um": 1e-3}


class Scale:
    """How large the images are, and how long a pixel is.

    Attributes:
        size: (width, height) px.
        assumptions: what had to be taken for granted.

    Raises:
        ParseError: a focal length is missing, or the sizes contradict each other.
        MissingTagError: neither the file nor the caller says the image size.
    """

    def __init__(self, sheet: Sheet, context: ReadContext) -> None:
        self.values = sheet.values
        self.source = context.name
        self.unit = context.option(UNIT.name)
        self.assumptions: tuple[str, ...] = ()
        self._require_focals()
        self.size: ImageSize = context.size(self._size())

    @property
    def is_metric(self) -> bool:
        """Whether a focal length is in millimetres, and coefficients therefore may be."""
        return any(self._unit(self.values[name]) != "px" for name in ("f", "fx", "fy") if name in self.values)

    def focals(self) -> tuple[float, float]:
        """Of x and of y, px."""
        first, second = ("f", "f") if "f" in self.values else ("fx", "fy")
        return self.length(first, across=True), self.length(second, across=False)

    def length(self, name: str, *, across: bool) -> float:
        """A length in px of the image's width (``across``) or height."""
        value = self.values[name]
        unit = self._unit(value)
        if unit == "px":
            return value.numbers[0]
        return value.numbers[0] * MM[unit] / self._pitch_mm()[0 if across else 1]

    def _require_focals(self) -> None:
        given = [name for name in ("f", "fx", "fy") if name in self.values]
        if not given:
            raise ParseError(
                "there is no focal length; add fx_px and fy_px, or focal_length_mm with pixel_pitch_um",
                source=self.source,
            )
        if given in (["f"], ["fx", "fy"]):
            return
        if "f" in given:
            raise ParseError(
                f"{self.values['f'].key} and {self.values[given[1]].key} both say the focal length",
                source=self.source,
            )
        missing = "fy" if given == ["fx"] else "fx"
        raise ParseError(
            f"there is no {missing}; add it, or write focal_length where pixels are square",
            source=self.source,
        )

    def _size(self) -> ImageSize | None:
        """The image size as the file says it."""
        whole = self.values.get("size")
        sides = [self.values[name] for name in ("width", "height") if name in self.values]
        for value in (whole, *sides):
            if value is not None and value.unit not in (None, "px"):
                raise ParseError(
                    f"an image size in {value.unit} is none in pixels; the sensor's is called sensor_width_mm",
                    source=self.source,
                    place=value.key,
                )
        if len(sides) == 1:
            raise ParseError("of width and height only one is there", source=self.source, place=sides[0].key)
        found = [strict.image_size(*whole.numbers, source=self.source, place=whole.key)] if whole else []
        if sides:
            found.append(
                strict.image_size(
                    sides[0].numbers[0], sides[1].numbers[0], source=self.source, place=sides[0].key
                )
            )
        if len(set(found)) > 1:
            raise ParseError(
                "it says two image sizes, {}×{} and {}×{}".format(*found[0], *found[1]), source=self.source
            )
        return found[0] if found else None

    def _unit(self, value: Value) -> str:
        unit = value.unit or self.unit
        if unit is None:
            raise ParseError(
                f"it has no unit; write {value.key}_px or {value.key}_mm, or give options={{'unit': 'px'}} "
                "(--set unit=px)",
                source=self.source,
                place=value.key,
            )
        if unit != "px" and unit not in MM:
            raise ParseError(
                f"its unit {strict.shown(unit)} is not known, wanted px or mm",
                source=self.source,
                place=value.key,
            )
        return unit

    def _pitch_mm(self) -> tuple[float, float]:
        """The pixel's width and height, from its own keys and from the sensor's, which must agree."""
        own, sensor = self._stated_pitch(), self._sensor_pitch()
        found = own or sensor
        if found is None:
            raise ParseError(
                "millimetres become pixels through the pixel pitch, which is missing; add pixel_pitch_um, or "
                "sensor_width_mm",
                source=self.source,
            )
        if (
            own
            and sensor
            and any(abs(a / b - 1) > ASPECT_TOLERANCE for a, b in zip(own, sensor, strict=True))
        ):
            raise ParseError(
                f"a pixel pitch of {own[0] * 1e3:g} µm and a sensor of {sensor[0] * self.size[0]:g} mm for "
                f"{self.size[0]} px ({sensor[0] * 1e3:g} µm) contradict each other",
                source=self.source,
            )
        return found

    def _stated_pitch(self) -> tuple[float, float] | None:
        if "pitch" in self.values:
            pitch = self._mm("pitch")
            return pitch, pitch
        if "pitch_x" in self.values and "pitch_y" in self.values:
            return self._mm("pitch_x"), self._mm("pitch_y")
        return None

    def _sensor_pitch(self) -> tuple[float, float] | None:
        width, height = self.size
        if "sensor" in self.values:
            across, down = (self._mm("sensor", index) for index in (0, 1))
            return across / width, down / height
        if "sensor_width" not in self.values:
            return None
        pitch = self._mm("sensor_width") / width
        if "sensor_height" in self.values:
            return pitch, self._mm("sensor_height") / height
        self.assumptions = ("pixels are square",)
        return pitch, pitch

    def _mm(self, name: str, index: int = 0) -> float:
        value = self.values[name]
        if value.unit not in MM:
            raise ParseError(
                f"it needs a unit of its own, mm or µm (found {value.unit or 'none'}); write {value.key}_mm or "
                f"{value.key}_um",
                source=self.source,
                place=value.key,
            )
        number = value.numbers[index] * MM[value.unit]
        if not number > 0:
            raise ParseError(f"{value.text} is no length", source=self.source, place=value.key)
        return number
