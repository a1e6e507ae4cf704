"""The exported tracker compiled by gcc, and called from Python."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

STRICT = ("gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2")
HARNESS = """
#include "sensor.h"
static sensor_tracker t;
void start(double time) { sensor_init(&t); sensor_begin(&t, time); }
void finish(void) { sensor_finish(&t); }
int feed(const double *u, const double *y, int n)
{ int i, a = 0; for (i = 0; i < n; i++) a = sensor_step(&t, (sensor_real)u[i], (sensor_real)y[i]); return a; }
double reading(double *v, double *u, int *e) { return sensor_read(&t, v, u, e); }
unsigned long save(unsigned char *b) { return sensor_save(&t, b); }
int restore(const unsigned char *b, unsigned long n) { return sensor_restore(&t, b, n); }
int alarm(int i, double *x)
{ x[0] = t.alarm[i].time_s; x[1] = t.alarm[i].detected_s; x[2] = t.alarm[i].before; x[3] = t.alarm[i].after;
  x[4] = t.alarm[i].u; return t.alarm[i].parameter; }
void corrected(const double *y, double *a, int n)
{ int i; for (i = 0; i < n; i++) a[i] = sensor_correct(&t, (sensor_real)y[i]); }
unsigned long saved(void) { return SENSOR_SAVED; }
unsigned long bytes(void) { return sizeof t; }
"""


class Compiled:
    """A tracker in C; one state."""

    def __init__(self, folder: Path, parameters: int, *, single: bool = False, more: tuple[str, ...] = ()) -> None:
        (folder / "harness.c").write_text(HARNESS)
        library = folder / ("single.so" if single else "double.so")
        if not library.exists():
            kind = ["-DSENSOR_FLOAT"] if single else []
            done = [*STRICT, *kind, *more, "-shared", "-fPIC", "-o", library.name, "sensor.c", "harness.c", "-lm"]
            subprocess.run(done, cwd=folder, check=True, capture_output=True, text=True)
        self._library = ctypes.CDLL(str(library))
        self._library.reading.restype = ctypes.c_double
        for name in ("save", "saved", "bytes"):
            getattr(self._library, name).restype = ctypes.c_ulong
        self._parameters = parameters
        self.start(0.0)

    def start(self, time_s: float) -> None:
        self._library.start(ctypes.c_double(time_s))

    def finish(self) -> None:
        self._library.finish()

    def feed(self, u: Any, y: Any) -> int:
        return self._library.feed(_pointer(u), _pointer(y), len(u))

    def read(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        value, u, excited = np.zeros(self._parameters), np.zeros(self._parameters), np.zeros(self._parameters, np.int32)
        rms = self._library.reading(_pointer(value), _pointer(u), excited.ctypes.data_as(ctypes.c_void_p))
        return value, u, excited, rms

    def alarm(self, index: int) -> tuple[int, np.ndarray]:
        numbers = np.zeros(5)
        return self._library.alarm(index, _pointer(numbers)), numbers

    def save(self) -> bytes:
        buffer = ctypes.create_string_buffer(int(self._library.saved()))
        size = int(self._library.save(buffer))
        return buffer.raw[:size]

    def restore(self, saved: bytes) -> bool:
        return bool(self._library.restore(saved, ctypes.c_ulong(len(saved))))

    def corrected(self, y: Any) -> np.ndarray:
        corrected = np.zeros(len(y))
        self._library.corrected(_pointer(y), _pointer(corrected), len(y))
        return corrected

    @property
    def bytes(self) -> int:
        return int(self._library.bytes())


def _pointer(values: Any) -> Any:
    assert values.dtype == np.float64
    assert values.flags.c_contiguous
    return values.ctypes.data_as(ctypes.c_void_p)
