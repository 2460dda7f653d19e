"""Objects of MATLAB classes in its binary files: their properties as plain values, by the file's subsystem.

A variable of a class contains only numbers of objects. The properties of all objects are in one place, the subsystem,
an array of bytes at the end of the file that is a small file itself, with one cell array of ``FileWrapper__``::

    cell 0           int32 version, int32 number of names, int32[8] offsets of regions, the names, each ended by a zero
      region 0       for each class: namespace, name, 0, 0                       numbers of names count from 1
      region 1, 3    for each object saved through saveobj, or as it is: a count, then name, kind, value for each
                     property, padded to 8 bytes
      region 2       for each object: class, 0, 0, its number in region 1, its number in region 3, dependency
    cell 2 …         the values of properties of kind 1; kind 2 is a number itself, and 0 a name

The calibration classes of the Computer Vision Toolbox are saved as the struct that ``toStruct`` gives, under the
property ``any``. Defaults of classes, enumerations and dynamic properties are not read.

Source: the format is not published; mat-io's ``docs/subsystem_data_format.md`` (foreverallama/matio, MIT) describes it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from itertools import pairwise

from calibrary.errors import ParseError
from calibrary.records import Json

MARK = 0xDD000000
"""First number of a reference to objects."""
HEAD_BYTES = 40
MAX_DEPTH = 6
MOST_VALUES = 20_000
"""Objects and values of their properties; a session of the calibrator has some for each of its photographs.

Properties may share a cell, so the file's length does not bound them.
"""
LIMIT = "the most that are looked into; save its cameraParams alone, as a struct: s = toStruct(cameraParams)"
AFTER = {2: 1, 3: 2, 4: 3}
"""Cells after the values of properties, by version."""
AS_SAVED = "any"


class Objects:
    """The objects of a file."""

    def __init__(
        self, cells: Sequence[bytes], meta: bytes, order: str, value: Callable[[bytes], Json]
    ) -> None:
        """Take the metadata apart.

        Args:
            cells: of the wrapper, as matrices of a MAT file.
            meta: the bytes in the first.
            order: of bytes, "<" or ">".
            value: reads a cell.

        Raises:
            ValueError: the metadata is not of a version that is known, or damaged.
        """
        version, _ = struct.unpack_from(f"{order}2i", meta)
        if version not in AFTER:
            raise ValueError(f"version {version} of MATLAB's objects is not known")
        starts = struct.unpack_from(f"{order}8i", meta, 8)
        if not HEAD_BYTES <= starts[0] <= starts[1] <= starts[2] <= starts[3] <= starts[4] <= len(meta):
            raise ValueError("the regions of MATLAB's objects are not in order")
        self._names = [name.decode("latin-1") for name in meta[HEAD_BYTES : starts[0]].split(b"\0") if name]
        regions = [
            struct.unpack_from(f"{order}{(end - start) // 4}i", meta, start)
            for start, end in pairwise(starts[:5])
        ]
        self._objects = regions[2]
        self._saved, self._plain = (_records(region) for region in (regions[1], regions[3]))
        self._values = cells[2 : len(cells) - AFTER[version]]
        self._value = value
        self._decoded: dict[int, Json] = {}
        self._values_left = MOST_VALUES

    def resolved(self, value: Json, depth: int = 0) -> Json:
        """A value with the properties of the objects that it refers to, as mappings; several objects are a list.

        Raises:
            ParseError: there are more values than are looked into.
            ValueError: the metadata is damaged.
        """
        self._count()
        if depth > MAX_DEPTH:
            return None
        if isinstance(value, dict):
            return {key: self.resolved(item, depth + 1) for key, item in value.items()}
        if not (isinstance(value, list) and value and value[0] == MARK):
            return value
        numbers = [int(item) for item in value if isinstance(item, int | float)]
        if len(numbers) < 4 or not 1 <= numbers[1] <= len(numbers) - 3:
            raise ValueError("a reference to MATLAB's objects is damaged")
        found = [self._properties(number, depth + 1) for number in numbers[2 + numbers[1] : -1]]
        return found[0] if len(found) == 1 else found

    def _count(self) -> None:
        self._values_left -= 1
        if self._values_left < 0:
            raise ParseError(f"it has over {MOST_VALUES} values in MATLAB's objects, {LIMIT}")

    def _properties(self, number: int, depth: int) -> Json:
        self._count()
        if not 0 < number < len(self._objects) // 6:
            raise ValueError(f"object {number} is not there")
        _, _, _, saved, plain, _ = self._objects[6 * number : 6 * number + 6]
        records, index = (self._saved, saved) if saved else (self._plain, plain)
        if not 0 <= index < len(records):
            raise ValueError(f"the properties of object {number} are not there")
        table: dict[str, Json] = {}
        for name, kind, at in records[index]:
            if not 1 <= name <= len(self._names) or (kind == 1 and not 0 <= at < len(self._values)):
                raise ValueError(f"a property of object {number} is not there")
            value = self.resolved(self._cell(at) if kind == 1 else at if kind == 2 else None, depth)
            if value is not None:
                table[self._names[name - 1]] = value
        whole = table.get(AS_SAVED)
        return whole if isinstance(whole, dict) else table

    def _cell(self, at: int) -> Json:
        if at not in self._decoded:
            self._decoded[at] = self._value(self._values[at])
        return self._decoded[at]


def _records(region: Sequence[int]) -> list[list[tuple[int, int, int]]]:
    """The properties of each object: number of the name, kind, value."""
    found: list[list[tuple[int, int, int]]] = []
    at = 0
    while at < len(region):
        count = region[at]
        numbers = region[at + 1 : at + 1 + 3 * count]
        if count < 0 or len(numbers) < 3 * count:
            raise ValueError("the list of an object's properties is cut short")
        found.append([(numbers[i], numbers[i + 1], numbers[i + 2]) for i in range(0, 3 * count, 3)])
        at += 1 + 3 * count
        at += at % 2
    return found
