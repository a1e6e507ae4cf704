"""Version, dependencies and supported Pythons are the same wherever a release names them."""

from __future__ import annotations

import re
import tomllib

import yaml
from release.__main__ import SUPPORTED
from tests.support.sources import ROOT

import vibrident

#: Name on PyPI to name on conda-forge, where they differ.
CONDA_NAMES = {"soundfile": "pysoundfile", "matplotlib": "matplotlib-base"}
MAX_CHANGELOG_LINES = 40


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def project() -> dict:
    return tomllib.loads(read("pyproject.toml"))["project"]


def recipe() -> dict:
    return yaml.safe_load(read("conda-recipe/recipe.yaml"))


def test_the_version_is_the_same_everywhere():
    assert yaml.safe_load(read("CITATION.cff"))["version"] == vibrident.__version__
    assert str(recipe()["context"]["version"]) == vibrident.__version__
    assert re.findall(r"(?m)^## (\S+)$", read("CHANGELOG.md"))[0] == vibrident.__version__


def test_the_changelog_is_short():
    assert len(read("CHANGELOG.md").splitlines()) <= MAX_CHANGELOG_LINES


def test_the_conda_recipe_has_the_dependencies_of_pyproject():
    expected = {f"python {project()['requires-python']}"}
    for requirement in project()["dependencies"]:
        name, bound = re.fullmatch(r"([\w-]+)(\S*)", requirement).groups()
        expected.add(f"{CONDA_NAMES.get(name, name)} {bound}")
    assert set(recipe()["requirements"]["run"]) == expected


def test_supported_pythons_are_those_of_the_classifiers():
    classifiers = project()["classifiers"]
    stated = [line for line in classifiers if re.search(r"Python :: 3\.\d+$", line)]
    assert stated == [f"Programming Language :: Python :: {version}" for version in SUPPORTED]
    assert project()["requires-python"] == f">={SUPPORTED[0]}"
