"""Invented load-cell records of CWolf, of which the truth is known: staircases of plateaus with noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl

FACTOR = {"stern": 4.0 * 0.933013, "vertical": 2.0}
"""Load along X or Z per newton of one actuator: four canted propellers, two vertical thrusters."""

TRUTH = {
    "stern": {1.0: (0.0, 0.004, 1.9e-5), -1.0: (0.0, 0.003, 1.4e-5)},
    "vertical": {1.0: (0.0, 0.001, 7e-6), -1.0: (0.0, 0.0008, 6e-6)},
}
"""a0, a1, a11 of a single actuator ahead and astern, N per rpm and rpm²."""

STEPS = (300, 500, 700, 900, 1100, 1300, 1500, 1700, 1850, 2000)


def staircase(steps: Sequence[float] = STEPS, *, rest: int = 2) -> list[float]:
    """Commands of the plateaus: at rest before and after."""
    return [*[0.0] * rest, *map(float, steps), *[0.0] * rest]


def thrust(group: str, signal: float) -> float:
    """True thrust of one actuator in N."""
    if signal == 0.0:
        return 0.0
    a0, a1, a11 = TRUTH[group][float(np.sign(signal))]
    s = abs(signal)
    return float(np.sign(signal) * (a0 + a1 * s + a11 * s * s))


def record(
    commands: Sequence[float],
    *,
    group: str = "stern",
    seed: int = 0,
    rate_hz: float = 10.0,
    hold_s: float = 8.0,
    noise_n: float = 3.0,
    repeat_n: float = 1.0,
    bias_n: float = 4.0,
    axis: str = "X",
    wrong: Mapping[int, float] | None = None,
    columns: Sequence[str] | None = None,
) -> pl.DataFrame:
    """Table of a pull: noise per sample, scatter per plateau, one zero error; the flow settles within 1 s.

    ``wrong`` adds newtons to the load of whole plateaus by their number; ``columns`` names the commands.
    """
    rng = np.random.default_rng(seed)
    each = round(hold_s * rate_hz)
    load, command = [], []
    last = 0.0
    for number, value in enumerate(commands):
        steady = FACTOR[group] * thrust(group, value) + (wrong or {}).get(number, 0.0)
        level = steady + repeat_n * rng.standard_normal()
        decay = np.exp(-np.arange(each) / rate_hz / 0.2)
        load.append(level + (last - level) * decay + noise_n * rng.standard_normal(each))
        command.append(np.full(each, value))
        last = level
    t = np.arange(each * len(commands)) / rate_hz
    names = columns or {"stern": ("SbU", "SbL", "PU", "PL"), "vertical": ("VTB", "VTS")}[group]
    table = {"t_s": t, f"load.{axis}_n": np.concatenate(load) + bias_n}
    return pl.DataFrame(table | {f"cmd.{name}": np.concatenate(command) for name in names})


def quiet(commands: Sequence[float], *, group: str = "stern", axis: str = "X") -> pl.DataFrame:
    """Table of a pull without noise, scatter and bias."""
    return record(commands, group=group, axis=axis, noise_n=0.0, repeat_n=0.0, bias_n=0.0)


def write_bench(folder: Path, pulls: str, *, vehicle: str = "cwolf", more: str = "") -> Path:
    """Path of a bench file with these pulls."""
    path = folder / "bench.toml"
    path.write_text(f'format = 1\nname = "basin"\nvehicle = "{vehicle}"\n{more}\n{pulls}', encoding="utf-8")
    return path


def pull(name: str, *, group: str = "stern", keys: str = 'axis = "X"') -> str:
    """Text of a pull whose file is ``NAME.csv``."""
    return f'[[pulls]]\nname = "{name}"\nfile = "{name}.csv"\ngroup = "{group}"\n{keys}\n'


def both_ways(folder: Path, *, seed: int = 0, more: str = "", group: str = "stern") -> Path:
    """Path of a bench file with a pull ahead and one astern (down and up of the vertical thrusters)."""
    axis = "X" if group == "stern" else "Z"
    for k, (name, sign) in enumerate((("ahead", 1.0), ("astern", -1.0))):
        made = record(
            staircase([sign * s for s in STEPS]),
            group=group,
            seed=2 * seed + k,
            bias_n=4.0 - 7.0 * k,
            axis=axis,
        )
        made.write_csv(folder / f"{name}.csv")
    keys = f'axis = "{axis}"'
    return write_bench(
        folder, pull("ahead", group=group, keys=keys) + pull("astern", group=group, keys=keys), more=more
    )
