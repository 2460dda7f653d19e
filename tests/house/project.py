"""Where things stand in the repository."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "src" / "calibrary"
ROOMS = ("calib", "parsers", "registry", "schemas")


def files_of(folder: Path) -> Iterator[Path]:
    """Every file below a folder, itself not through a link, and what was compiled left out."""
    for entry in sorted(folder.iterdir()):
        if entry.is_symlink() or entry.name == "__pycache__" or entry.suffix in {".so", ".pyd"}:
            continue
        if entry.is_dir():
            yield from files_of(entry)
        else:
            yield entry


def python_files() -> Iterator[Path]:
    """Every Python file of the project, each once."""
    for folder in (CORE, *(ROOT / room for room in ROOMS), ROOT / "tests", ROOT / "benchmarks"):
        if folder.is_dir():
            yield from (path for path in files_of(folder) if path.suffix == ".py")
