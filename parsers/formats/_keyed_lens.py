"""The distortion of a keyed sheet: only what its model, stated or beyond doubt, says it is."""

from __future__ import annotations

from calibrary.distortion import MODELS as KINDS
from calibrary.distortion import Distortion, NoDistortion, distortion_from
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.convention import Convention, YAxis
from calibrary.parsers.formats._keyed_options import DISTORTION
from calibrary.parsers.formats._keyed_sheet import Sheet
from calibrary.parsers.formats._keyed_terms import COEFFICIENTS, MODELS

__all__ = ["DISTORTION", "model_named", "read", "rows", "unknown_term"]

BROWN = frozenset({"k1", "k2", "k3", "p1", "p2"})
RATIONAL = BROWN | {"k4", "k5", "k6"}
MIRRORED = frozenset({"brown", "rational", "kannala-brandt", "none"})
"""Models that mirroring y leaves what they are, but for the sign of p1."""


def model_named(text: str | None) -> str | None:
    """The library's name of what a file calls a distortion model, None when it is none."""
    return None if text is None else MODELS.get("".join(c for c in text.lower() if c.isalnum()))


def read(
    sheet: Sheet, convention: Convention, *, metric: bool, asked: str | None, source: str
) -> tuple[Distortion | None, tuple[str, ...]]:
    """The lens and what had to be taken for granted; None when the sheet says nothing of it.

    Raises:
        ParseError: nothing tells which model the coefficients belong to.
        UnsupportedModelError: the model is not one of the known ones, or has no such coefficient.
    """
    values = {name: _number(sheet, name, source) for name in COEFFICIENTS if name in sheet.values}
    given = {name: value for name, value in values.items() if value}
    model, assumed = _model(sheet, given, metric=metric, asked=asked, source=source)
    if model is None:
        return (NoDistortion() if values else None), ()
    if not values and model != "none":
        raise ParseError(
            f"it names the distortion model {model} and gives no coefficient; add them, zero where measured as zero",
            source=source,
            place="distortion_model",
        )
    if not given and model != "kannala-brandt":  # whose zeros are a lens, the equidistant one
        return NoDistortion(), ()
    if convention.y_axis is YAxis.UP:
        given = _turned(given, model, convention, source)
    try:
        kind = distortion_from(model, dict.fromkeys(_names(model), 0.0) | given)
    except InputError as error:
        raise UnsupportedModelError(error.message, source=source, place=error.place) from None
    return kind, assumed


def rows(distortion: Distortion | None) -> list[tuple[str, object]]:
    """The keys and values of a lens; none where it is unknown."""
    if distortion is None:
        return []
    return [("distortion_model", distortion.model), *distortion.coefficients.items()]


def unknown_term(key: str, source: str) -> UnsupportedModelError:
    """What to say of a coefficient that would be lost."""
    return UnsupportedModelError(
        f"{strict.shown(key)} looks like a part of the distortion and is no known one; wanted "
        f"{', '.join(COEFFICIENTS[:8])} …; take it out if it is none, or export Agisoft XML where a program wrote it",
        source=source,
        place=key,
    )


def _model(
    sheet: Sheet, given: dict[str, float], *, metric: bool, asked: str | None, source: str
) -> tuple[str | None, tuple[str, ...]]:
    """The model's name and what was assumed for it; None without coefficients and without a word."""
    if asked is not None and any(name in sheet.values for name in COEFFICIENTS):
        return asked, ()
    stated = sheet.values.get("model")
    if stated is not None:
        name = model_named(stated.text)
        if name is None:
            raise UnsupportedModelError(
                f"the distortion model {strict.shown(stated.text)} is not known, wanted one of "
                f"{', '.join(DISTORTION.values)}",
                source=source,
                place=stated.key,
            )
        return name, ()
    camera = sheet.values.get("camera")
    if camera is not None and (name := model_named(camera.text)) is not None:
        return name, (f"{camera.key} = {camera.text} names the distortion model",)
    if not given:
        return None, ()
    if metric:
        raise _undecided("with lengths in millimetres, k1 may be per mm²", source)
    if given.keys() <= BROWN:
        return "brown", ("k1, k2, k3, p1, p2 are OpenCV's, on x/z and y/z",)
    if given.keys() <= RATIONAL and {"k5", "k6"} & sheet.values.keys() and {"p1", "p2"} & sheet.values.keys():
        return "rational", ("k1 … k6, p1, p2 are OpenCV's, on x/z and y/z",)
    raise _undecided(f"{', '.join(given)} belong to more than one model", source)


def _undecided(why: str, source: str) -> ParseError:
    return ParseError(
        f"{why}; add distortion_model = {', '.join(DISTORTION.values[1:-1])} or {DISTORTION.values[-1]}, or give "
        "options={'distortion': 'brown'} (--set distortion=brown)",
        source=source,
        place="distortion_model",
    )


def _number(sheet: Sheet, name: str, source: str) -> float:
    value = sheet.values[name]
    if value.unit is not None:
        raise UnsupportedModelError(
            f"a coefficient in {strict.shown(value.unit)} acts on lengths of the sensor, not on x/z and y/z; "
            "nothing says which way it maps, so ask for the calibration as Agisoft XML or OpenCV YAML",
            source=source,
            place=value.key,
        )
    return value.numbers[0]


def _names(model: str) -> tuple[str, ...]:
    return KINDS[model].names()


def _turned(given: dict[str, float], model: str, convention: Convention, source: str) -> dict[str, float]:
    """The same lens with y down."""
    if model not in MIRRORED:
        raise UnsupportedModelError(
            f"the {model} model with y up has no counterpart here; give it with y down", source=source
        )
    p1, p2 = convention.tangential_from_file(given.get("p1", 0.0), given.get("p2", 0.0))
    return {**given, "p1": p1, "p2": p2} if {"p1", "p2"} & given.keys() else given
