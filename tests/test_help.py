"""``help(calibrary)`` and that of every public name."""

from __future__ import annotations

import inspect
import pkgutil
import pydoc
from importlib import import_module

import pytest

import calibrary

NAMES = [name for name in calibrary.__all__ if not name.startswith("__")]


def test_the_package_explains_itself() -> None:
    told = pydoc.plain(pydoc.render_doc(calibrary))
    assert [name for name in NAMES if name not in told] == []


def test_help_begins_with_the_functions_and_a_signature_names_the_policy() -> None:
    told = pydoc.plain(pydoc.render_doc(calibrary))
    description = told[told.index("DESCRIPTION") : told.index("PACKAGE CONTENTS")]
    functions = [name for name in NAMES if inspect.isfunction(getattr(calibrary, name))]
    assert [name for name in functions if f"``{name}``" not in description] == []
    assert "policy: 'PolicyLike' = <Policy fleet>" in str(inspect.signature(calibrary.extract))


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_explains_itself(name: str) -> None:
    assert len(pydoc.plain(pydoc.render_doc(getattr(calibrary, name)))) > 100


def test_every_class_of_the_package_explains_itself() -> None:
    """help() evaluates the annotations of a Struct: a type that is imported for type checkers alone is a NameError."""
    modules = [
        import_module(one.name)
        for one in pkgutil.walk_packages(calibrary.__path__, "calibrary.")
        if not one.name.endswith("__main__")
    ]
    classes = [
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and value.__module__ == module.__name__
    ]
    assert [one for one in classes if not _has_signature(one)] == []


def _has_signature(kind: type) -> bool:
    try:
        inspect.signature(kind)
    except NameError:
        return False
    except (TypeError, ValueError):  # an enum, a protocol: it has none
        return True
    return True
