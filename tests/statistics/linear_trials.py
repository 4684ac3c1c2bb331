"""Synthetic joint estimates: a model linear in its unknowns, with errors of known memory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.statistics.linearisation import Linearisation, Piece, Unknown

Array = NDArray[np.float64]

DT = 0.1


@dataclass(frozen=True)
class Design:
    """Derivatives (n, C, m) per trial; the truth is zero."""

    jacobians: tuple[Array, ...]
    unknowns: tuple[Unknown, ...]

    @property
    def channels(self) -> int:
        return len(self.jacobians[0][0])


def flat(
    name: str, *, prior_sd: float = math.inf, lower: float = -math.inf, upper: float = math.inf
) -> Unknown:
    return Unknown(name, "coefficient", "kg/s", lower, upper, upper - lower, 0.0, prior_sd)


def memory(series: Array, pole: float) -> Array:
    """First-order lag along the first axis, variance kept for white noise."""
    out = np.empty_like(series)
    out[0] = series[0]
    gain = math.sqrt(1.0 - pole**2)
    for k in range(1, len(series)):
        out[k] = pole * out[k - 1] + gain * series[k]
    return out


def trials(lengths: Sequence[int], *, inputs: int, seed: int, channels: int = 2) -> Design:
    """Inputs in turn stepped, periodic, drifting and white, seen by all channels, and a bias per trial."""
    rng = np.random.default_rng(seed)
    jacobians = []
    for trial, n in enumerate(lengths):
        jacobian = np.zeros((n, channels, inputs + len(lengths)))
        k = np.arange(n)
        for j in range(inputs):
            if j % 4 == 0:
                hold = int(rng.integers(40, 150))
                x = memory(np.repeat(rng.uniform(-1.0, 1.0, n // hold + 1), hold)[:n], 0.95)
            elif j % 4 == 1:
                x = np.sin(2.0 * np.pi * k / rng.uniform(30.0, 200.0) + rng.uniform(0.0, 6.0))
            else:
                x = memory(rng.normal(size=n), 0.98 if j % 4 == 2 else 0.0)
            jacobian[:, :, j] = x[:, None] * rng.normal(size=channels)
        jacobian[:, 0, inputs + trial] = 1.0
        jacobians.append(jacobian)
    names = [f"c{j}" for j in range(inputs)] + [f"bias {t}" for t in range(len(lengths))]
    return Design(tuple(jacobians), tuple(flat(name) for name in names))


def errors(design: Design, rho: float, rng: np.random.Generator, seeds: int) -> list[Array]:
    """AR(1) errors (n, seeds, C) of unit variance per trial, channels correlated by 0.4."""
    mix = np.linalg.cholesky(0.4 + 0.6 * np.eye(design.channels)).T
    return [memory(rng.normal(size=(len(j), seeds, design.channels)) @ mix, rho) for j in design.jacobians]


def estimates(design: Design, drawn: Sequence[Array], *, piece: int = 200) -> list[Linearisation]:
    """Least-squares estimate of each seed, in segments of ``piece`` samples that share their ends."""
    m, channels = len(design.unknowns), design.channels
    rows = np.concatenate([jacobian.reshape(-1, m) for jacobian in design.jacobians])
    precision = np.array([unknown.prior_sd**-2.0 for unknown in design.unknowns])
    inverse = np.linalg.pinv(rows.T @ rows + np.diag(precision), hermitian=True)
    seeds = drawn[0].shape[1]
    stacked = np.concatenate([error.transpose(0, 2, 1).reshape(-1, seeds) for error in drawn])
    values = (inverse @ (rows.T @ stacked)).T
    found = []
    for seed in range(seeds):
        pieces = []
        for trial, (jacobian, error) in enumerate(zip(design.jacobians, drawn, strict=True)):
            residual = error[:, seed] - jacobian @ values[seed]
            for start in range(0, len(jacobian) - 1, piece):
                part = slice(start, min(start + piece + 1, len(jacobian)))
                count = len(residual[part])
                counted = np.ones((count, channels), dtype=bool)
                counted[0] = start == 0
                pieces.append(
                    Piece(
                        trial=f"trial {trial}",
                        t=np.asarray(DT * np.arange(part.start, part.stop), dtype=np.float64),
                        residual=np.where(counted, residual[part], 0.0),
                        counted=counted,
                        weight=np.ones((count, channels)),
                        jacobian=np.where(counted[:, :, None], jacobian[part], 0.0),
                        nu=np.zeros((count, 6)),
                    )
                )
        found.append(
            Linearisation(
                design.unknowns,
                values[seed],
                ("u", "v", "w", "p", "q", "r")[:channels],
                np.ones(channels),
                DT,
                tuple(pieces),
            )
        )
    return found


def one(design: Design, rho: float, seed: int = 0) -> Linearisation:
    """One estimate."""
    return estimates(design, errors(design, rho, np.random.default_rng(seed), 1))[0]


def with_column(design: Design, unknown: Unknown, column: Sequence[Array]) -> Design:
    """A design with one more unknown whose derivatives (n, C) are given per trial."""
    return replace(
        design,
        jacobians=tuple(
            np.concatenate([jacobian, one_[:, :, None]], axis=2)
            for jacobian, one_ in zip(design.jacobians, column, strict=True)
        ),
        unknowns=(*design.unknowns, unknown),
    )


def own_coefficients(
    design: Design, drawn: Sequence[Array], sd: Array, rng: np.random.Generator, *, part: int
) -> list[Array]:
    """Errors, and in each part of so many samples coefficients of its own that scatter by ``sd``."""
    total = []
    for jacobian, error in zip(design.jacobians, drawn, strict=True):
        moved = error.copy()
        for first in range(0, len(jacobian), part):
            own = rng.normal(size=(error.shape[1], len(sd))) * sd
            moved[first : first + part] += np.einsum(
                "nci,si->nsc", jacobian[first : first + part, :, : len(sd)], own
            )
        total.append(moved)
    return total
