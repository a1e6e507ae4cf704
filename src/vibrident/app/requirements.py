"""Check the packages that vibrident and its extras require: present, new enough, able to load.

Each is loaded in another process: what it breaks there breaks nothing here.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence

from packaging.requirements import Requirement

from vibrident.base.fields import NamedTexts

# for all imports: twenty of processor time, on a machine that does other work too
MAX_SECONDS = 600.0
MISSING = "missing"
_NOT_FOR_USERS = ("dev", "test", "docs")
#: What is loaded beside an extra's own packages, because it tests them.
_SELF_TESTS: NamedTexts = {"jax": "vibrident.base.backend"}

#: Imports modules, given as [package, module] pairs, and prints a line of JSON for each.
_IMPORT = """
import contextlib, importlib, io, json, sys, warnings
warnings.simplefilter("ignore")
out = sys.stdout
for package, module in json.loads(sys.argv[1]):
    print(json.dumps([package, None]), file=out, flush=True)
    problem = ""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            importlib.import_module(module)
    except BaseException as error:
        problem = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    print(json.dumps([package, problem]), file=out, flush=True)
"""


def requirements_by_extra() -> dict[str, list[Requirement]]:
    """Return extra → what it requires, of the extras for users; first the core, without a name."""
    extras: dict[str, list[Requirement]] = {}
    for line in importlib.metadata.requires("vibrident") or ():
        marker = re.search(r"extra\s*==\s*['\"]([\w.-]+)['\"]", line)
        extra = marker.group(1) if marker else ""
        requirement = Requirement(line)
        # an extra may have another one in it
        if requirement.name != "vibrident" and extra not in _NOT_FOR_USERS:
            extras.setdefault(extra, []).append(requirement)
    return dict(sorted(extras.items()))


def unusable_packages(requirements: Iterable[Requirement]) -> NamedTexts:
    """Return package → why it cannot be used, or that it is missing."""
    unfit = {}
    loadable = []
    for requirement in requirements:
        try:
            version = importlib.metadata.version(requirement.name)
        except importlib.metadata.PackageNotFoundError:
            unfit[requirement.name] = MISSING
            continue
        if requirement.specifier.contains(version, prereleases=True):
            loadable.append(requirement.name)
        else:
            unfit[requirement.name] = f"{version}, but {requirement.specifier} is needed"
    return _not_loading(list(dict.fromkeys(loadable))) | unfit


def _not_loading(packages: list[str]) -> dict[str, str]:
    """Return package → the error of its import, of those that do not load."""
    # The search reads the files of every installed package: once for all.
    owners = importlib.metadata.packages_distributions()
    pending = [(package, module) for package in packages for module in _modules(package, owners)]
    problems: NamedTexts = {}
    while pending:
        done, crash = _imported(pending)
        for package, problem in done:
            if problem:
                problems.setdefault(package, problem)
        pending = pending[len(done) :]
        if pending and crash:  # it ended in the middle of the next one
            problems.setdefault(pending[0][0], crash)
            pending = pending[1:]
    return problems


def _imported(pairs: list[tuple[str, str]]) -> tuple[list[tuple[str, str]], str]:
    """Import modules in another process; return the finished ones, and why it stopped early."""
    words = [sys.executable, "-c", _IMPORT, json.dumps(pairs)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    try:
        done = subprocess.run(
            words,
            env=environment,
            capture_output=True,
            text=True,
            timeout=MAX_SECONDS,
            check=False,
        )
        text = done.stdout
        crash = f"its import ended Python with status {done.returncode}"
    except subprocess.TimeoutExpired as error:
        text = _text(error.stdout)
        crash = f"its import took more than {MAX_SECONDS:g} s"
    lines = [json.loads(line) for line in text.splitlines() if line.endswith("]")]
    return [(package, problem) for package, problem in lines if problem is not None], crash


def _text(output: str | bytes | None) -> str:
    return output.decode(errors="replace") if isinstance(output, bytes) else output or ""


def _modules(package: str, owners: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the modules by which a package is loaded: that of its name, else all it has.

    ``owners``: packages of each module.
    """
    tops = [
        module
        for module, owner_names in owners.items()
        if not module.startswith("_") and _plain(package) in map(_plain, owner_names)
    ]
    named = [module for module in tops if _plain(module) == _plain(package)]
    importable = [module for module in named or sorted(tops) if module.isidentifier()]
    return importable + [module for name, module in _SELF_TESTS.items() if name == package]


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
