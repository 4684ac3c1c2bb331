"""Whether actuators act against their sign or in exchanged places, from a log and the vehicle file alone.

Every actuator's thrust T_k(t) follows from its recorded command by the vehicle file. What differs between
"as the file has it" and a reversed or exchanged actuator is where and with which sign the thrusts act:

    mean(nu') = c_i [M^-1 B P T]_i + a_i . (1, nu_i, |nu_i| nu_i, couplings) + e_i

over windows of half a second (integral form: the mean of nu' is a difference of smoothed velocities), with P
a signed permutation, B the wrench per newton, and per axis i a free scale c_i >= 0 and free damping: masses,
thrust and drag of the file may be wrong by any factor, signs are what is judged. Windows are whitened by the
autocorrelation of their residuals, so that the likelihood counts independent ones. P is looked for among all
sign patterns, exchanges of like actuators, and both for a pair; each change costs evidence.

Where a combination of actuators is not excited, or an axis not recorded, several P fit alike: only what all
of them have in common is told. Commands that answer the motion are correlated with what disturbs it, which
looks like a reversed actuator; in a closed loop more evidence and a larger share explained are demanded.

Source: likelihood ratio of non-nested models, Vuong, *Econometrica* 57 (1989) 307; prewhitening, Cochrane and
Orcutt, *J. Am. Stat. Assoc.* 44 (1949) 32. Held by ``tests/inspect/test_wiring.py``.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.inspect.feedback import Feedback, feedback

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class WiringSettings:
    """How much evidence it takes that actuators are reversed or exchanged."""

    #: Of the mean accelerations, s: longer than most lags of motors, short against the time constants of
    #: hulls.
    window_s: float = 0.5
    fewest_windows: int = 40  #: Windows of an axis.
    most_actuators: int = 10  #: Actuators whose sign patterns are all tried: 1024.
    #: Log-likelihood over what the file says, beyond the price of the changes, in open loop. Of independent
    #: Gaussian windows 12 is an error in 160,000.
    evidence: float = 12.0
    #: The same in closed loop, where windows are not independent: on a dive of a BlueROV2 Heavy under its
    #: autopilot the right wiring fell behind another one by 44.
    closed_evidence: float = 60.0
    price: float = 3.0  #: Of each change: about the logarithm of the number of actuators to choose from.
    explained_before: float = 0.5  #: Of what free gains explain of an axis: at most by the file's wiring.
    #: The same at least by the changed one. With the right wiring what is left to free gains are lags and
    #: couplings, of which a wrong one explains little: 0.57 at most in axes that the file's explains badly,
    #: on the recordings of a BlueROV2 Heavy and of Beluga.
    explained_after: float = 0.75
    #: Of an axis's motion beyond damping that the commands explain: less is a residue.
    explained_motion: float = 0.03
    alike: float = 6.0  #: Log-likelihood within which the log does not tell wirings apart.
    parts: int = 3  #: Parts of the log in time, each of which is asked.
    #: Of the evidence in the best part: none may prefer the file's wiring by so much.
    part_against: float = 0.25
    usual_m_s: float = 1.0  #: Speed of a vehicle with fins of which none is recorded, m/s.


SETTINGS = WiringSettings()


_COUPLED = {
    "X": (("v", "r"), ("w", "q")),
    "Y": (("", "v"), ("", "r"), ("u", "v"), ("u", "r")),
    "Z": (("", "w"), ("", "q"), ("u", "w"), ("u", "q"), ("u", "u")),
    "K": (("", "p"), ("", "r"), ("u", "r"), ("u", "u")),
    "M": (("", "w"), ("", "q"), ("u", "w"), ("u", "q"), ("u", "u")),
    "N": (("", "v"), ("", "r"), ("u", "v"), ("u", "r")),
}
"""Products of velocities that accelerate an axis of a hull that is the same to port and starboard."""


@dataclass(frozen=True)
class Wiring(Plain):
    """Actuators whose effect contradicts the vehicle file."""

    reversed: tuple[str, ...]  #: Actuators that act against their sign.
    exchanged: tuple[tuple[str, str], ...]  #: Pairs that act in one another's place.
    evidence: float  #: Log-likelihood by which the motion prefers this to the vehicle file.
    #: By axis the share of its motion beyond damping that the commands explain as the file has them, and with
    #: the change.
    explained: dict[str, tuple[float, float]]
    closed: bool  #: Whether commands follow measurements.

    @property
    def actuators(self) -> tuple[str, ...]:
        """All actuators concerned."""
        return tuple(dict.fromkeys((*self.reversed, *itertools.chain(*self.exchanged))))

    def finding(self, trial: str = "") -> Finding:
        """What contradicts the vehicle file, in the trial of a name."""
        return Finding("wiring", Severity.DANGER, trial, asdict(self))


def wiring(trial: Trial, vehicle: Vehicle, *, loops: Sequence[Feedback] | None = None) -> Wiring | None:
    """Reversed and exchanged actuators of a trial; None where nothing clearly contradicts the vehicle file.
    An actuator without a command stands still; `loops`: which commands follow measurements, if known.
    """
    names = [
        name for name in vehicle.actuators if name in trial.commands and np.ptp(trial.commands[name]) > 0.0
    ]
    facts = vehicle.actuator_info()
    if not names or len(names) > SETTINGS.most_actuators:
        return None
    if trial.voltage_v is None and any(facts[name]["needs_voltage"] for name in names):
        return None
    places = [vehicle.actuators.index(name) for name in names]
    each = each_wrench(vehicle, trial)
    force = thrusts(vehicle, each)[:, places] * _dynamic_pressure(trial, vehicle)[:, places]
    effect = np.asarray(np.linalg.solve(vehicle.mass_matrix(), vehicle.allocation_matrix()), float)[:, places]
    seen = [axis for k, axis in enumerate(AXES) if CHANNELS[k] in trial.channels]
    judged = [axis_motion for axis in seen if (axis_motion := _axis(trial, axis, force, effect)) is not None]
    if not judged:
        return None
    hypotheses = _hypotheses(names, vehicle)
    doubt = _judged(judged, names, hypotheses, closed=False)
    # Whether the loop is closed is asked last: it takes longer than all the rest.
    if doubt is None or not any(loop.closed for loop in (feedback(trial) if loops is None else loops)):
        return doubt
    return _judged(judged, names, hypotheses, closed=True)


def each_wrench(vehicle: Vehicle, trial: Trial, *, measured: bool = False) -> Array:
    """Wrench of every actuator by itself (n, actuators, 6), N and N m: of thrusters with the vehicle held, of
    fins at the trial's rms speed.
    """
    from seatrial._core import State, simulate_batch

    if measured:  # a logged signal is behind the motor
        motor = {"K_V": 1.0, "T_1": 0.0, "T_t": 0.0, "n_acc": 1e9, "n_dec": 1e9}
        present = vehicle.coefficients()
        passing = {f"{name}.{key}": value for name in vehicle.actuators for key, value in motor.items()}
        vehicle = vehicle.with_coefficients({key: value for key, value in passing.items() if key in present})
    values = vehicle.coefficients()
    gains = np.diag([values.get(f"{name}.gain", 0.0) for name in vehicle.actuators])

    def wrench(speed: float) -> Array:
        run = simulate_batch(
            vehicle,
            {f"{name}.gain": gains[k] for k, name in enumerate(vehicle.actuators)},
            trial.t,
            dict(trial.measured if measured else trial.commands),
            State(nu=[speed, 0.0, 0.0, 0.0, 0.0, 0.0]),
            free="",
            voltage_v=trial.voltage_v,
            max_step_s=trial.dt,
            rho=trial.rho,
            g=trial.g,
        )
        return np.asarray(run.tau).transpose(1, 0, 2)

    each, fins = wrench(0.0), _fins(vehicle)
    if fins:
        each[:, fins] = wrench(_speed(trial))[:, fins]
    return each


def _fins(vehicle: Vehicle) -> list[int]:
    facts = vehicle.actuator_info()
    return [k for k, name in enumerate(vehicle.actuators) if facts[name]["kind"] == "fin"]


def _speed(trial: Trial) -> float:
    ahead = trial.nu[trial.valid[:, 0], 0]
    return float(np.sqrt(np.mean(ahead**2))) if len(ahead) else SETTINGS.usual_m_s


def _dynamic_pressure(trial: Trial, vehicle: Vehicle) -> Array:
    """Factor (n, actuators) on each thrust: of fins the square of the speed over that of `each_wrench`."""
    factor = np.ones((len(trial), len(vehicle.actuators)))
    ahead = trial.filled("u")
    if ahead is not None and (fins := _fins(vehicle)):
        factor[:, fins] = (ahead * np.abs(ahead) / max(_speed(trial), 1e-3) ** 2)[:, None]
    return factor


def thrusts(vehicle: Vehicle, each: Array) -> Array:
    """Thrust (n, actuators), N, from the wrench of every actuator by itself (n, actuators, 6)."""
    matrix = np.asarray(vehicle.allocation_matrix()).T.copy()
    # A reaction torque turns about the thruster's axis: the force alone tells the thrust, where there is one.
    matrix[:, 3:] *= np.linalg.norm(matrix[:, :3], axis=1, keepdims=True) < 1e-9
    return np.asarray(np.einsum("nki,ki->nk", each, matrix) / (matrix**2).sum(axis=1))


@dataclass(frozen=True)
class _Axis:
    """Whitened windows of an axis without damping: accelerations (w,), thrusts (w, k), effect per N (k,)."""

    axis: str
    y: Array
    force: Array
    effect: Array


def _axis(trial: Trial, axis: str, force: Array, effect: Array) -> _Axis | None:
    """Windows of an axis; None where too few are whole, or no actuator pushes it."""
    from scipy.ndimage import minimum_filter1d, uniform_filter1d

    row = AXES.index(axis)
    size = max(3, round(SETTINGS.window_s / trial.dt))

    def smooth(y: Array) -> Array:
        return np.asarray(uniform_filter1d(y, size, axis=0, mode="nearest"))

    known = {c: trial.nu[:, CHANNELS.index(c)] for c in "uvwpqr" if c in trial.channels}
    own = known[CHANNELS[row]]
    pairs = [(a, b) for a, b in _COUPLED[axis] if b in known and (not a or a in known)]
    couplings = [known[b] * (known[a] if a else 1.0) for a, b in pairs]
    angles = [np.sin(y) for c in ("roll", "pitch") if axis in "KMZX" and (y := trial.filled(c)) is not None]
    damping = np.column_stack([np.ones(len(own)), own, np.abs(own) * own, *couplings, *angles])
    twice = smooth(own)
    ahead, behind = np.roll(twice, -(size // 2)), np.roll(twice, size - size // 2)
    rate = (ahead - behind) / (size * trial.dt)
    whole = minimum_filter1d(trial.valid[:, row].astype(np.uint8), 2 * size + 1, mode="constant") > 0
    at = np.flatnonzero(whole)
    at = at[(at - at[0]) % size == 0] if len(at) else at
    if len(at) < SETTINGS.fewest_windows:
        return None
    y, x, f = rate[at], smooth(smooth(damping))[at], smooth(smooth(force))[at]
    # Runs of neighbouring windows: only between these is there an autocorrelation.
    follows = np.concatenate([[False], np.diff(at) == size])
    free = np.column_stack([x, f])
    left = y - free @ np.linalg.lstsq(free, y, rcond=1e-9)[0]
    memory = float(left[1:][follows[1:]] @ left[:-1][follows[1:]]) / max(float(left @ left), 1e-300)
    memory = float(np.clip(memory, 0.0, 0.95))

    def white(z: Array) -> Array:
        before = np.roll(z, 1, axis=0)
        return np.asarray((z - memory * before)[follows])

    y, x, f = white(y), white(x), white(f)
    if len(y) < SETTINGS.fewest_windows:
        return None
    scale = np.linalg.norm(x, axis=0)
    basis, values, _ = np.linalg.svd(x[:, scale > 0.0] / scale[scale > 0.0], full_matrices=False)
    basis = basis[:, values > 1e-9 * values[0]]
    y, f = y - basis @ (basis.T @ y), f - basis @ (basis.T @ f)
    strength = np.linalg.norm(f * effect[row], axis=0)
    if not strength.any() or not y.any():
        return None
    return _Axis(axis, y, f, effect[row])


Hypothesis = tuple[Array, tuple[int, ...], int]
"""Sign of each command, the place where it acts, and the number of changes."""


def _hypotheses(names: Sequence[str], vehicle: Vehicle) -> list[Hypothesis]:
    """The file's wiring first, then sign patterns, exchanges, and exchanges with reversed members."""
    count = len(names)
    straight = tuple(range(count))
    result: list[Hypothesis] = []
    for signs in itertools.product((1.0, -1.0), repeat=count):
        result.append((np.array(signs), straight, sum(s < 0.0 for s in signs)))
    pairs = list(_like_pairs(names, vehicle))
    for swaps in (*((pair,) for pair in pairs), *itertools.combinations(pairs, 2)):
        members = [k for pair in swaps for k in pair]
        if len(set(members)) < len(members):
            continue
        place = list(straight)
        for a, b in swaps:
            place[a], place[b] = b, a
        result.append((np.ones(count), tuple(place), len(swaps)))
        if len(swaps) == 1:
            for flips in ((1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
                signs_ = np.ones(count)
                signs_[members] = flips
                result.append((signs_, tuple(place), 1 + sum(s < 0.0 for s in flips)))
    return result


def _like_pairs(names: Sequence[str], vehicle: Vehicle) -> Iterator[tuple[int, int]]:
    """Actuators that one could plug in for another: of one kind, with commands of one unit."""
    facts = vehicle.actuator_info()
    kinds = [(facts[name]["kind"], facts[name]["unit"]) for name in names]
    return ((a, b) for a, b in itertools.combinations(range(len(names)), 2) if kinds[a] == kinds[b])


def _judged(
    judged: Sequence[_Axis], names: Sequence[str], hypotheses: Sequence[Hypothesis], *, closed: bool
) -> Wiring | None:
    """The change that the motion asks for; None where it is not clear, or contradicts a part of the log."""
    # Log-likelihood of every wiring over that of the file, summed over the axes.
    signs = np.array([h[0] for h in hypotheses])
    places = np.array([h[1] for h in hypotheses])
    changes = np.array([h[2] for h in hypotheses])
    gain = np.zeros(len(hypotheses))
    shares = np.zeros((len(judged), len(hypotheses)))
    for k, axis in enumerate(judged):
        shares[k] = _explained(axis.y, axis.force, signs * axis.effect[places])
        gain += -0.5 * len(axis.y) * np.log(np.maximum(1.0 - shares[k], 1e-12))
    gain -= gain[0]
    net = gain - SETTINGS.price * changes
    best = int(np.argmax(net))
    if net[best] < (SETTINGS.closed_evidence if closed else SETTINGS.evidence):
        return None
    free = np.array([_free_share(axis) for axis in judged])
    # Some axis must speak clearly against the file and for the change, in every part of the log.
    against = (shares[:, 0] < SETTINGS.explained_before * free) & (
        shares[:, best] > np.maximum(SETTINGS.explained_after * free, SETTINGS.explained_motion)
    )
    if not against.any() or not _in_all_parts(judged, signs, places, best):
        return None
    # Only what all wirings that the log cannot tell apart have in common is named.
    alike = np.flatnonzero(net > net[best] - SETTINGS.alike)
    same_place = np.arange(len(names))
    turned = [name for k, name in enumerate(names) if all(signs[a, k] < 0.0 for a in alike)]
    swapped: set[tuple[int, int]] = {
        (min(int(k), int(places[best, k])), max(int(k), int(places[best, k])))
        for k in same_place
        if places[best, k] != k and all(places[a, k] == places[best, k] for a in alike)
    }
    if not turned and not swapped:
        return None
    clear = {
        axis.axis: (float(shares[k, 0]), float(shares[k, best]))
        for k, axis in enumerate(judged)
        if against[k]
    }
    pairs = tuple((str(names[a]), str(names[b])) for a, b in sorted(swapped))
    return Wiring(tuple(turned), pairs, float(net[best]), clear, closed)


def _explained(y: Array, force: Array, weights: Array) -> Array:
    """Share of y (h,) that each weighting (h, k) of the thrusts explains, with a scale not below zero."""
    along = np.maximum(weights @ (force.T @ y), 0.0)
    size = np.einsum("hk,kj,hj->h", weights, force.T @ force, weights)
    tiny = 1e-9 * max(float(size.max()), 1e-300)
    share = np.where(size > tiny, along**2 / np.maximum(size, tiny), 0.0) / float(y @ y)
    return np.asarray(share)


def _free_share(axis: _Axis) -> float:
    """Share of y that the thrusts explain with free gains."""
    left = axis.y - axis.force @ np.linalg.lstsq(axis.force, axis.y, rcond=1e-6)[0]
    return 1.0 - float(left @ left) / float(axis.y @ axis.y)


def _in_all_parts(judged: Sequence[_Axis], signs: Array, places: Array, best: int) -> bool:
    """Whether no part of the log prefers the file's wiring clearly to the changed one."""
    preference = np.zeros(SETTINGS.parts)
    for axis in judged:
        weights = signs[[0, best]] * axis.effect[places[[0, best]]]
        for part, rows in enumerate(np.array_split(np.arange(len(axis.y)), SETTINGS.parts)):
            share = _explained(axis.y[rows], axis.force[rows], weights)
            left = np.log(np.maximum(1.0 - share, 1e-12))
            preference[part] += 0.5 * len(rows) * float(left[0] - left[1])
    return bool(preference.min() > -SETTINGS.part_against * preference.max())
