"""The exported tracker on a Cortex-M4F: built by arm-none-eabi-gcc, run in qemu, counted."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.support.random_record import Real
from tests.support.sources import ROOT

EXAMPLE = ROOT / "examples" / "online" / "cortex-m4f"
GCC, QEMU = "arm-none-eabi-gcc", "qemu-system-arm"
STRICT = (GCC, "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2")
M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-DSENSOR_FLOAT")
BOARD = (QEMU, "-M", "mps2-an386", "-nographic", "-semihosting", "-icount", "shift=0", "-kernel")
#: What an image of the tracker alone keeps.
ENTRIES = ("init", "begin", "step", "finish", "changing", "read", "correct", "save", "restore")


def missing() -> str | None:
    """The tool that is not here."""
    absent = [tool for tool in (GCC, QEMU) if shutil.which(tool) is None]
    return f"there is no {absent[0]}" if absent else None


@dataclass(frozen=True)
class CortexOutput:
    """What the example printed: value and u of each parameter; of each alarm its place, time, and values before and
    after; instructions a sample, mean and most; bytes of tracker and stack; and the state that it saved."""

    parameters: list[list[float]]
    alarms: list[list[float]]
    instructions: list[float]
    ram: list[float]
    state: bytes


def run(sources: Path, u: Real, y: Real) -> CortexOutput:
    """The example with the exported ``sensor.h`` and ``sensor.c`` of a folder, over these samples."""
    folder = sources / "cortex"
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    for name in ("sensor.h", "sensor.c"):
        shutil.copy(sources / name, folder)
    np.column_stack([u, y]).astype("<f4").tofile(folder / "samples.f32")
    linked = ("--specs=rdimon.specs", "-nostartfiles", "-T", "mps2-an386.ld", "-o", "track.elf")
    subprocess.run([*STRICT, *M4F, *linked, "main.c", "sensor.c", "-lm"], cwd=folder, check=True)
    ran = [*BOARD, "track.elf"]
    text = subprocess.run(
        ran, cwd=folder, check=True, capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL
    ).stdout

    def numbers(word: str) -> list[list[float]]:
        lines = [line for line in text.splitlines() if line.startswith(word)]
        return [[float(number) for number in re.findall(r"(?<![\w.])-?\d[\w.+-]*", line)] for line in lines]

    return CortexOutput(
        [row[1:] for row in numbers("parameter")],
        numbers("alarm"),
        numbers("instructions")[0],
        numbers("ram")[0],
        (folder / "state.bin").read_bytes(),
    )


def flash(sources: Path) -> int:
    """Bytes of code and constants of the tracker, with what it needs of libm and libgcc, and nothing else."""
    entry_options = [f"-Wl,-u,sensor_{name}" for name in ENTRIES]
    linked = ("-ffunction-sections", "-nostartfiles", "--specs=nosys.specs", "-Wl,--gc-sections,-e,sensor_step")
    subprocess.run(
        [*STRICT, *M4F, *linked, *entry_options, "-o", "alone.elf", "sensor.c", "-lm"], cwd=sources, check=True
    )
    text = subprocess.check_output(["arm-none-eabi-size", "alone.elf"], cwd=sources, text=True)
    return sum(int(size) for size in text.splitlines()[1].split()[:2])
