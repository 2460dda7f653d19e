"""Which paths a registry may write, and no others.

What :mod:`calibrary.registry.git.paths` lets through is safe anywhere; a registry holds entries and a few files
beside them.
"""

from __future__ import annotations

import re

from calibrary.errors import RegistryError
from calibrary.registry.git.paths import is_safe_name

__all__ = ["CAMERAS", "check_path"]

CAMERAS = "cameras"
DEEPEST = 8
SINGLE_FILES = frozenset({".gitattributes", "README.md", "registry.yaml"})
WORKFLOW = re.compile(r"\.github/workflows/[a-z0-9][a-z0-9._-]*\.yml\Z")
SCHEMA = re.compile(r"schema/[a-z0-9][a-z0-9._-]*\.json\Z")
NAME = re.compile(r"[a-z0-9_][a-z0-9._~+-]*\Z")


def check_path(path: str) -> str:
    """The path itself, if a registry may hold a file there.

    Raises:
        RegistryError: it is no ``cameras/**.yaml`` and none of the few files beside it.
    """
    if path in SINGLE_FILES or WORKFLOW.match(path) or SCHEMA.match(path):
        return path
    root, *names = path.split("/")
    if (
        root != CAMERAS
        or not 1 <= len(names) <= DEEPEST
        or not names[-1].endswith(".yaml")
        or any(name.endswith(".yaml") for name in names[:-1])
        or not all(NAME.match(name) and is_safe_name(name) for name in names)
    ):
        raise RegistryError(
            f"{path!r} is no place in a registry: wanted cameras/<make>/<model>/<variant>.yaml in lower-case "
            f"letters, digits and . _ ~ + -, or one of {', '.join(sorted(SINGLE_FILES))}, schema/*.json, "
            ".github/workflows/*.yml"
        )
    return path
