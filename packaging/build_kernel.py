"""Compiles calibrary/kernel/_kernel.c for CPython's stable ABI, one binary for Python 3.11 and later.

Without a compiler the wheel is pure, and the geometry is NumPy's. CALIBRARY_KERNEL=0 asks for the pure wheel, =1 makes
a failed compilation an error.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

# Without contraction results do not depend on the processor; nobody reads errno or floating-point traps.
FLAGS = ("-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-fPIC")


class BuildKernel(BuildHookInterface[Any]):
    """Adds the compiled module to a wheel, or puts it beside its source for an editable install."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and give the wheel the tag of what is in it."""
        wish = os.environ.get("CALIBRARY_KERNEL", "")
        if wish == "0":
            return
        folder = Path(self.root, "src", "calibrary", "kernel")
        self.made = TemporaryDirectory()
        built = Path(self.made.name, "_kernel.pyd" if os.name == "nt" else "_kernel.abi3.so")
        command = _command(folder / "_kernel.c", built)
        try:
            subprocess.run(command, cwd=self.made.name, check=True, capture_output=True, text=True)  # noqa: S603
        except (OSError, subprocess.CalledProcessError) as error:
            if wish == "1":
                raise
            said = (getattr(error, "stderr", "") or str(error)).strip()
            self.app.display_warning(
                f"calibrary's geometry is not compiled, NumPy is used instead: {said[-300:]}"
            )
            return
        if version == "editable":
            # Renamed into place: a process that has the old one loaded keeps it.
            part = folder / f"{built.name}.part"
            part.write_bytes(built.read_bytes())
            part.replace(folder / built.name)
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"
        build_data["force_include"][str(built)] = f"calibrary/kernel/{built.name}"

    def finalize(self, _version: str, _build_data: dict[str, Any], _artifact_path: str) -> None:
        """Remove what was compiled for the wheel."""
        if hasattr(self, "made"):
            self.made.cleanup()


def _command(source: Path, built: Path) -> list[str]:
    include = sysconfig.get_path("include")
    if os.name == "nt":
        libraries = Path(sys.base_prefix, "libs")
        return [
            "cl", "/nologo", "/O2", "/fp:precise", "/std:c11", "/LD", f"/I{include}", str(source),
            f"/Fe{built}", "/link", f"/LIBPATH:{libraries}",
        ]  # fmt: skip
    shared = ["-bundle", "-undefined", "dynamic_lookup"] if sys.platform == "darwin" else ["-shared", "-s"]
    compiler = shlex.split(os.environ.get("CC", "cc"))
    return [*compiler, *FLAGS, *shared, f"-I{include}", str(source), "-o", str(built), "-lm"]
