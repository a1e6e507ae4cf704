"""Packages that add to vibrident, installed into a folder."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path


def install(source: Path, folder: Path) -> None:
    """What ``pip install --target`` does with a pure Python package."""
    project = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (package,) = (source / "src").iterdir()
    shutil.copytree(package, folder / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    groups = project["entry-points"].items()
    text = "\n".join(f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in entries.items()) for group, entries in groups)
    described(folder, project["name"], project["version"], text)


def described(folder: Path, name: str, version: str, entry_points: str) -> None:
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(entry_points, encoding="utf-8")
