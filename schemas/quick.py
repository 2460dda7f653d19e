"""Keywords of JSON Schema that do not stop at what is right.

jsonschema makes a validator of its own for every value it descends to, which is most of its time on a document of
numbers. Here a scalar under a schema of simple keywords is judged at once. Whatever is wrong, or not simple,
goes jsonschema's own way, so every error is jsonschema's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, TypeAlias

if TYPE_CHECKING:
    from jsonschema import ValidationError

__all__ = ["QuickKeywords", "judge_of"]

Judge: TypeAlias = Callable[[object], bool]
Schema: TypeAlias = Mapping[str, Any]
Keyword: TypeAlias = "Callable[[Any, Any, Any, Schema], Iterator[ValidationError]]"

KINDS: Final[Mapping[str, tuple[type, ...]]] = {
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "null": (type(None),),
}
BOUNDS: Final = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "minLength", "maxLength")
SIMPLE: Final = frozenset({"type", "pattern", "const", "enum", "description", *BOUNDS})


class QuickKeywords:
    """``items``, ``properties`` and ``additionalProperties`` that pass over scalars which are right."""

    def __init__(self, ordinary: Mapping[str, Any]) -> None:
        """Stand before jsonschema's own keywords."""
        self._ordinary = ordinary
        # Each schema's judge, made once; the schema is held, so that no other comes to bear its id.
        self._judges: dict[int, tuple[object, Judge | None]] = {}

    @property
    def by_name(self) -> dict[str, Keyword]:
        """For ``jsonschema.validators.extend``."""
        return {
            "items": self.items,
            "properties": self.properties,
            "additionalProperties": self.additional_properties,
        }

    def items(self, validator: Any, wanted: Any, found: Any, schema: Schema) -> Iterator[ValidationError]:
        """The members of a list."""
        judge = self._judge(wanted)
        if judge is None or type(found) is not list or "prefixItems" in schema or not all(map(judge, found)):
            yield from self._ordinary["items"](validator, wanted, found, schema)

    def properties(self, validator: Any, wanted: Any, found: Any, _: Schema) -> Iterator[ValidationError]:
        """The members of a map that have a schema of their own."""
        if not isinstance(found, dict):
            return
        for name, value in found.items():
            if name in wanted:
                judge = self._judge(wanted[name])
                if judge is None or not judge(value):
                    yield from validator.descend(value, wanted[name], path=name, schema_path=name)

    def additional_properties(
        self, validator: Any, wanted: Any, found: Any, schema: Schema
    ) -> Iterator[ValidationError]:
        """The other members of a map."""
        if type(found) is dict:
            others = found.keys() - schema.get("properties", {}).keys()
            judge = self._judge(wanted) if "patternProperties" not in schema else None
            if not others or (judge is not None and all(judge(found[name]) for name in others)):
                return
        yield from self._ordinary["additionalProperties"](validator, wanted, found, schema)

    def _judge(self, schema: object) -> Judge | None:
        made = self._judges.get(id(schema))
        if made is None:
            made = self._judges[id(schema)] = (schema, judge_of(schema))
        return made[1]


def judge_of(schema: object) -> Judge | None:
    """What says whether a value surely keeps to a schema, and False where that is for others to find out.

    Returns:
        None for a schema that is not simple.
    """
    if not isinstance(schema, Mapping) or not schema.keys() <= SIMPLE:
        return None
    choices = schema.get("enum", [schema["const"]] if "const" in schema else None)
    if choices is not None and ("enum" in schema) == ("const" in schema):
        return None
    if choices is not None and not all(isinstance(choice, str) for choice in choices):
        return None
    named = schema.get("type", list(KINDS))
    kinds = frozenset(
        kind for name in ([named] if isinstance(named, str) else named) for kind in KINDS.get(name, ())
    )
    pattern = re.compile(schema["pattern"]).search if "pattern" in schema else None
    least, most, above, below, shortest, longest = (schema.get(name) for name in BOUNDS)

    def judge(value: object) -> bool:
        kind = type(value)
        if kind not in kinds or (choices is not None and value not in choices):
            return False
        if isinstance(value, str):
            fits = (shortest is None or len(value) >= shortest) and (longest is None or len(value) <= longest)
            return fits and (pattern is None or pattern(value) is not None)
        if kind is float or kind is int:
            number: Any = value
            if kind is float and not math.isfinite(number):
                return False
            return (
                (least is None or number >= least)
                and (most is None or number <= most)
                and (above is None or number > above)
                and (below is None or number < below)
            )
        return True

    return judge
