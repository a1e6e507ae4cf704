"""Is this installation fit to identify a sensor? Each check says what it found and what to do."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass

from vibrident.data.registry import READERS, SOURCES
from vibrident.export.registry import EXPORTS
from vibrident.fit.registry import DEPARTURES, ESTIMATORS
from vibrident.physics.registry import MODELS

OLDEST, NEWEST = (3, 11), (3, 14)  # Python versions that it is tested with
REGISTRIES = (MODELS, ESTIMATORS, DEPARTURES, READERS, SOURCES, EXPORTS)  # of what plug-ins can add
CLOSE = 4.0  # a sound estimate lies this close to the truth, in standard uncertainties


@dataclass(frozen=True)
class Check:
    """One thing looked at."""

    subject: str  # what
    found: str  # what was found
    sound: bool = True  # False where results could be wrong or missing
    remedy: str = ""  # what to do; also a hint where all is sound but could be better


def examine() -> list[Check]:
    """Make every check, in order; one that fails does not keep the others from being made."""
    checks: list[Callable[[], list[Check]]] = [_python, _packages, _extras, _plug_ins, _jax, _cache, _identification]
    results: list[Check] = []
    for check in checks:
        try:
            results += check()
        except Exception as error:  # whatever is broken here is what the doctor is asked about
            found = f"{type(error).__name__}: {error}"
            results.append(Check(check.__name__.strip("_"), found, False, "see the message; reinstall vibrident"))
    return results


def _python() -> list[Check]:
    fits = OLDEST <= sys.version_info[:2] <= NEWEST
    wanted = f"use Python {OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}.{NEWEST[1]}"
    return [Check("Python", f"{platform.python_version()}, {platform.machine()}", fits, "" if fits else wanted)]


def _requirements() -> list[tuple[str, str]]:
    """Package and extra (empty for the core) of every requirement of the installed vibrident."""
    pairs = []
    for line in importlib.metadata.requires("vibrident") or ():
        name = re.match(r"[\w.-]+", line)
        extra = re.search(r"extra\s*==\s*['\"]([\w.-]+)['\"]", line)
        if name:
            pairs.append((name.group(), extra.group(1) if extra else ""))
    return pairs


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _packages() -> list[Check]:
    core = sorted({package for package, extra in _requirements() if not extra})
    missing = [package for package in core if _version(package) is None]
    if missing:
        return [Check("Packages", f"missing: {', '.join(missing)}", False, f"pip install {' '.join(missing)}")]
    return [Check("Packages", f"{len(core)} of {len(core)} present")]


def _extras() -> list[Check]:
    extras: dict[str, list[str]] = {}
    for package, extra in _requirements():
        if extra and extra not in ("dev", "test"):
            extras.setdefault(extra, []).append(package)
    checks = []
    for extra, packages in sorted(extras.items()):
        missing = [package for package in packages if _version(package) is None]
        found = f"not installed: {', '.join(missing)}" if missing else "installed"
        remedy = f"if you want it: pip install 'vibrident[{extra}]'" if missing else ""
        checks.append(Check(f"Extra {extra}", found, True, remedy))
    return checks


def _plug_ins() -> list[Check]:
    """What other packages add; one that cannot be used leaves the rest working."""
    return [
        Check(
            "Plug-in", plug_in.line, True, f"correct, update or uninstall {plug_in.package}" if plug_in.problem else ""
        )
        for registry in REGISTRIES
        for plug_in in registry.plug_ins()
    ]


def _jax() -> list[Check]:
    versions = {package: _version(package) or "missing" for package in ("jax", "jaxlib")}
    if "missing" in versions.values():
        return [Check("JAX", "not installed; linear sensors need none")]
    found = ", ".join(f"{package} {version}" for package, version in versions.items())
    from vibrident.base import backend  # refuses to load where the arithmetic is wrong

    install = f"pip install 'jax=={backend.TRUSTED}' 'jaxlib=={backend.TRUSTED}'"
    error = backend.arithmetic_error()
    right = error < backend.LEAST_ERROR
    wide = backend.jnp.asarray(1.0).dtype == "float64"
    device = backend.jax.devices()[0]
    return [
        Check("JAX", f"{found}, on {device.platform}"),
        Check("Sum of matrix products", f"relative error {error:.1e}", right, "" if right else install),
        Check("Precision", "float64" if wide else "float32", wide, "" if wide else "unset JAX_ENABLE_X64"),
    ]


def _cache() -> list[Check]:
    if _version("jax") is None:
        return []
    from vibrident.base.backend import cache_folder

    folder = cache_folder()
    if folder is None:
        return [Check("Kernel cache", "switched off", True, "unset VIBRIDENT_CACHE: repeated runs start faster")]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        remedy = "set VIBRIDENT_CACHE to a folder that can be written; without it every run compiles anew"
        return [Check("Kernel cache", f"{folder}: {error.strerror or error}", False, remedy)]
    kernels = sum(1 for _ in os.scandir(folder))
    return [Check("Kernel cache", f"{folder}, {kernels} files")]


def _identification() -> list[Check]:
    """Identify a simulated sensor by the network and by maximum likelihood; compare with the truth."""
    from vibrident.fit.estimators import AUTO, ranked
    from vibrident.fit.identification import identify
    from vibrident.physics.simulation import SENSORS, simulate
    from vibrident.use.comparison import deviations

    frequencies = (100.0, 300.0, 500.0, 630.0, 800.0)
    calibration = simulate(
        "paper", frequencies_hz=frequencies, sampling_rate_hz=12800.0, samples=2000, response_noise=0.01, seed=7
    )
    checks = []
    for estimator in (AUTO, *(one.name for one in ranked() if one.trains_network)):
        begin = time.perf_counter()
        result = identify(calibration, estimator=estimator)
        elapsed = time.perf_counter() - begin
        off = deviations(result, SENSORS["paper"].parameters)
        far, name = max((float("inf") if d.in_u is None else abs(d.in_u), name) for name, d in off.items())
        found = f"at most {far:.1f} u from the truth ({name.replace('_', ' ')}), {elapsed:.1f} s"
        remedy = "" if far < CLOSE else "reinstall vibrident; if it stays, report it as a bug"
        checks.append(Check(f"Identification, {result.estimator}", found, far < CLOSE, remedy))
    return checks
