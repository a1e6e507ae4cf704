"""Load JAX (extra ``network``) with float64, a compilation cache, and a check of its arithmetic.

Import ``jax``, ``jnp``, ``lax``, ``equinox`` and ``optax`` from here only. JAX 0.10.2 to 0.12.0.1
return wrong results for small batched matrix products in float64 on CPU, unless XLA is given a
flag, which is set here for those versions. On every version but 0.10.1, which was sound, the
product is computed when JAX is loaded, and a wrong result is refused.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import os
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.base.extras import library

TRUSTED = "0.10.1"
FIRST_FAULTY = (0, 10, 2)
LAST_FAULTY = (0, 12, 0, 1)
# memory maps of a process at which its kernels are freed; Linux's usual limit is 65 530
MAX_MEMORY_MAPS = 40_000
MAX_ARITHMETIC_ERROR = 1e-12  # relative, of sound arithmetic
_REMEDY_FLAG = "--xla_cpu_experimental_ynn_fusion_type="


def _with_remedy(flags: str, version: str) -> str:
    """Return XLA's flags with the one that a faulty version needs.

    XLA ends a process whose flags it does not know.
    """
    faulty = (
        FIRST_FAULTY
        <= tuple(int(number) for number in version.split(".") if number.isdigit())
        <= LAST_FAULTY
    )
    return f"{flags} {_REMEDY_FLAG}".strip() if faulty and _REMEDY_FLAG not in flags else flags


def _required(name: str) -> Any:
    return library(
        name,
        "network",
        "Springs, learned residuals, Adam and the paper's experiments need JAX, which is not "
        "installed.",
        "this model, setting or command; linear sensors need none",
    )


try:
    _installed = importlib.metadata.version("jax")
except importlib.metadata.PackageNotFoundError:
    _installed = ""
# Cached kernels carry two tuning hints that XLA's loader reports as "unsupported features" on
# stderr, harmlessly.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
if _REMEDY_FLAG in (_flags := _with_remedy(os.environ.get("XLA_FLAGS", ""), _installed)):
    os.environ["XLA_FLAGS"] = _flags

_required("jax")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from jax import lax  # noqa: E402

__all__ = ["TRUSTED", "arithmetic_error", "cache_folder", "jax", "jnp", "lax", "release_kernels"]


def __getattr__(name: str) -> Any:
    if name in ("equinox", "optax"):
        return _required(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def cache_folder() -> Path | None:
    """Return the folder of compiled kernels: ``$VIBRIDENT_CACHE``, else the user's cache.

    None if the variable is empty.
    """
    folder = os.environ.get("VIBRIDENT_CACHE")
    if folder is not None:
        return Path(folder) if folder else None
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "vibrident" / f"jax-{_installed}"


def arithmetic_error() -> float:
    """Return the largest relative error of the computation that faulty JAX releases get wrong.

    ``jit`` of ``sum(vmap(A @ x))`` in float64 against NumPy; 0 to a few ulp where JAX is sound,
    1e235 or NaN where not.
    """
    rng = np.random.default_rng(20240501)
    matrix = rng.standard_normal((3, 3))
    vectors = rng.standard_normal((512, 3))
    computed = jax.jit(lambda a, x: jnp.sum(jax.vmap(lambda v: a @ v)(x), axis=0))(matrix, vectors)
    expected = np.sum(vectors @ matrix.T, axis=0)
    error = np.max(np.abs(np.asarray(computed) - expected)) / np.max(np.abs(expected))
    return float(error) if np.isfinite(error) else float("inf")


def release_kernels(most_maps: int = MAX_MEMORY_MAPS) -> bool:
    """Free compiled kernels before the process runs out of memory maps; return whether it did.

    Linux allows a process 65 530 maps; beyond, XLA crashes. Identifying thousands of data sets of
    many lengths reaches that. Freed kernels are loaded again from the cache on disk.
    """
    maps = Path("/proc/self/maps")
    if not maps.exists() or maps.read_bytes().count(b"\n") < most_maps:
        return False
    jax.clear_caches()
    return True


def _configure() -> None:
    jax.config.update("jax_enable_x64", True)
    folder = cache_folder()
    if folder is not None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            return  # a read-only home only costs compile time
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _require_sound_arithmetic() -> None:
    if _installed == TRUSTED:
        return
    error = arithmetic_error()
    if not error < MAX_ARITHMETIC_ERROR:
        raise InputError(
            "JAX computes wrong numbers on this machine.",
            expected=f"a relative error below {MAX_ARITHMETIC_ERROR:g} in a sum of matrix products",
            found=f"{error:g}, with JAX {_installed}",
            where=f"XLA_FLAGS={os.environ.get('XLA_FLAGS', '')}",
            remedy=f"⟦install = jax=={TRUSTED} jaxlib=={TRUSTED}⟧",
        )


_configure()
_require_sound_arithmetic()
