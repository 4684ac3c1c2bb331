"""A trial: one recording on a common time base, in SI and NED/FRD, with every bad sample masked.

`Trial.read` is the way of a log into the library, step by step in the files of this room: a reader makes a
table, the column map turns it into signals (`table`), defects are masked (`defects`), the corrections that
are given applied (`corrections`), sensors brought to O (`corrections.to_origin`), signs and latencies
corrected against the pose (`alignment`), the pose's frame levelled (`attitude.level`), and everything put on
one time base (`signals`, `assembly`). `Trial.report` says what was done.
Held by ``tests/trial/test_trial.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import ANGLES, CHANNELS
from seatrial.base.errors import TrialError, nearest
from seatrial.base.files import write_table
from seatrial.base.work import Clock, Progress, callers_errors_pass
from seatrial.trial import alignment, attitude, table
from seatrial.trial.assembly import assemble, smooth, spline
from seatrial.trial.columns import GROUPS, Mixer
from seatrial.trial.corrections import to_origin
from seatrial.trial.recording import Reader, recording
from seatrial.trial.signals import RecordingReport, common, own_samples

if TYPE_CHECKING:
    import polars as pl
    from scipy.interpolate import CubicSpline

    from seatrial._core import Record

Input = Literal["commands", "measured", "tau"]

_INPUT_COLUMNS = {
    "commands": "the columns cmd.<actuator>",
    "measured": "the columns meas.<actuator>",
    "tau": "the columns tau.X_n ... tau.N_nm",
}

_STEADY_S = 0.25  # a segment starts where the samples this close are valid too

_STEPS = {
    "table": 0.03,
    "units and frames": 0.07,
    "defects": 0.15,
    "signs and latencies": 0.7,
    "time base": 0.05,
}
"""Steps of the reading, each with its share of the time that a long log takes."""


class _Reading:
    """Tells before each step of `_STEPS` how far the reading of a recording is."""

    def __init__(self, name: str, tell: Callable[[Progress], None] | None) -> None:
        self._name, self._tell, self._clock = name, tell, Clock()

    def begin(self, step: str) -> None:
        if self._tell is None:
            return
        number = list(_STEPS).index(step)
        share = sum(list(_STEPS.values())[:number])
        elapsed, left = self._clock.elapsed_s, self._clock.left_s(share, 1.0 - share)
        what = f"reading {self._name}"
        self._tell(Progress(what, number, len(_STEPS), share, elapsed, left, detail=step))


@dataclass(frozen=True, eq=False)
class Trial:
    """One recording on a uniform time base; made by `Trial.read`.

    Attributes
    ----------
    name, source
        What to call it, and the file or frame it came from.
    t
        Uniform times in s, shape (n,), from the recording's own first time on.
    observed, valid
        The twelve `CHANNELS` (n, 12) in SI, NaN where absent, and which samples may be used.
    position, attitude, nu
        NED in m (n, 3), quaternion body -> NED (n, 4), body velocities in m/s and rad/s (n, 6), filled
        linearly where masked; zeros where absent. `valid` says which are measured.
    commands, measured
        By actuator (n,), in its own unit, as commanded and as logged.
    tau, voltage_v, current, water
        Wrench in N and N m (n, 6), supply in V (n,), current NED in m/s (n, 3), velocity through the water in
        m/s (n, 3); None where not recorded.
    rho, g
        Density in kg/m^3 and gravity in m/s^2 of this trial; None: the vehicle's.
    surface
        Where the surface is, m down from the zero of z; None: not known, and all is under water.
    report
        What was found, corrected, masked and derived.
    samples
        Per channel of a sensor with stamps other than the time base its good samples at them: stamps in s and
        values in SI, (m,) each, corrected as the rest.
    states
        Position (n, 3), attitude (n, 4) and velocities (n, 6) from which simulations restart, as a filter
        knew them; None: the smoothed ones.
    silent
        Samples (n,) at which the command in force is unknown; no simulation runs across them. None: nowhere.
    """

    name: str
    source: str
    t: Array
    observed: Array
    valid: Mask
    position: Array
    attitude: Array
    nu: Array
    commands: dict[str, Array]
    measured: dict[str, Array]
    tau: Array | None
    voltage_v: Array | None
    current: Array | None
    water: Array | None
    rho: float | None
    g: float | None
    report: RecordingReport
    samples: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    states: tuple[Array, Array, Array] | None = None
    silent: Mask | None = None
    surface: float | None = None

    @classmethod
    @callers_errors_pass
    def read(
        cls,
        source: Any,
        *,
        reader: str | Reader | None = None,
        columns: Mapping[str, Any] | None = None,
        name: str | None = None,
        rate_hz: float | None = None,
        align: bool = True,
        level: bool = True,
        sensor_positions: Mapping[str, Sequence[float]] | None = None,
        corrections: Mapping[str, Any] | None = None,
        mixer: Mixer | None = None,
        rho: float | None = None,
        g: float | None = None,
        surface: float | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Trial:
        """Trial from a log or table in any format of `seatrial.logs`, or from a polars or pandas frame.

        Parameters
        ----------
        source
            Path or frame.
        reader
            Name of the reader, or a function from a path to a polars table; by the file's ending when
            omitted.
        columns
            Map ``{canonical: "source"}`` or ``{canonical: {"from": ..., "unit": ..., "sign": ..., "frame":
            ...}}``. Columns of the file that have canonical names need no entry.
        name
            What to call the trial; the file's stem when omitted.
        rate_hz
            Rate of the common time base; when omitted that of the recording (median interval, or the short
            one where intervals differ much), or of its fastest sensor where sensors have time stamps of
            their own.
        align
            Whether to remove the latency of velocity and rate sensors against the pose.
        level
            Whether to turn a pose upright whose earth frame is tilted against gravity.
        sensor_positions
            Where the sensors "velocity", "position" and "depth" sit, (3,) in m forward, starboard and down of
            O; in O when omitted.
        corrections
            What was wrong with the sensors, as the table ``[corrections]`` of a campaign file: ``signs``,
            ``axes``, ``delay_s``, ``tilt_deg``, ``scale``, ``bias``, ``heading_deg``. It wins over what is
            found here; ``automatic`` false switches `align`, signs and `level` off.
        mixer
            Makes commands of sticks, radio or servo channels, and a constant supply voltage.
        rho, g
            Density in kg/m^3 and gravity in m/s^2 at this trial.
        surface
            Where the surface is, in m down from the zero of z: 0 where z is the depth. Without it the zero
            may be anywhere, as in a tank's frame, and all of the vehicle is taken to be under water.
        progress
            Called with a `Progress` before each step of the reading.

        Examples
        --------
        >>> import numpy as np
        >>> t = np.arange(0.0, 5.0, 0.1)
        >>> trial = Trial.read({"Time": t, "speed": 1.8 * t}, columns={
        ...     "t_s": "Time", "u_m_s": {"from": "speed", "unit": "km/h"}})
        >>> round(float(trial.channel("u")[10]), 3)
        0.5
        """
        reading = _Reading(name or "the recording", progress)
        recorded = recording(
            source,
            reader,
            columns=columns,
            sensor_positions=sensor_positions,
            corrections=corrections,
            mixer=mixer,
            begin=reading.begin,
        )
        file, signals, time, report = recorded.file, recorded.signals, recorded.time, recorded.report
        given, sources, positions = recorded.corrections, recorded.sources, recorded.positions
        del recorded  # its signals of a long log, beside those that follow
        if name is None:
            name = Path(file).stem
        for key, value in (("rate_hz", rate_hz), ("rho", rho), ("g", g)):
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise TrialError(f"{file}: {key}: expected a positive number, found {value!r}")
        if surface is not None and not np.isfinite(surface):
            raise TrialError(
                f"{file}: surface: expected its coordinate down in m, 0 where z is the depth, found"
                f" {surface!r}"
            )
        t = common(time, signals, rate_hz, report)
        if len(t) < table.SETTINGS.minimum_rows:
            raise TrialError(
                f"{file}: {len(t)} samples at {1.0 / (t[1] - t[0]) if len(t) > 1 else rate_hz:g} Hz;"
                f" expected at least {table.SETTINGS.minimum_rows}"
            )
        reading.begin("signs and latencies")
        remove = align and given.automatic
        sensors = ["velocity", "rates"]
        if positions:
            # The gyro first: by its signs and stamps the others come to O, where they follow the pose.
            signals = alignment.align(
                signals, t, report, sources, remove=remove, given=given, names=["rates"]
            )
            signals = to_origin(signals, positions, report)
            sensors = ["velocity"]
        signals = alignment.align(signals, t, report, sources, remove=remove, given=given, names=sensors)
        reading.begin("time base")
        if given.frame is None:
            signals = attitude.level(signals, report, remove=level and given.automatic)
        parts = assemble(signals, t, report)
        samples = own_samples(signals, t, parts["silent"])
        return cls(
            name=name,
            source=file,
            t=t,
            report=report,
            samples=samples,
            rho=rho,
            g=g,
            surface=surface,
            **parts,
        )

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return (
            f"Trial({self.name!r}, {len(self)} samples, {self.t[-1] - self.t[0]:.1f} s "
            f"at {1.0 / self.dt:.4g} Hz, channels {' '.join(self.channels)})"
        )

    @property
    def dt(self) -> float:
        """Interval of the time base, s."""
        return float(self.t[-1] - self.t[0]) / (len(self.t) - 1)

    @property
    def channels(self) -> list[str]:
        """Those of `CHANNELS` that are recorded or derived."""
        return list(self._present)

    @cached_property
    def _present(self) -> tuple[str, ...]:
        absent = np.logical_and.reduce(np.isnan(self.observed), axis=0)
        return tuple(channel for channel, gone in zip(CHANNELS, absent, strict=True) if not gone)

    def channel(self, name: str) -> Array:
        """Samples of one channel in SI, shape (n,); NaN where absent."""
        if name not in CHANNELS:
            raise TrialError(f'{self.name}: "{name}" is no channel{nearest(name, CHANNELS)}')
        return self.observed[:, CHANNELS.index(name)]

    def filled(self, name: str) -> Array | None:
        """Samples of one channel in SI, shape (n,), gaps filled linearly and angles without jumps.

        None where the channel is absent or less than half of it is valid, of what has a known command.
        """
        good = self.valid[:, CHANNELS.index(name)]
        whole = len(self) if self.silent is None else int((~self.silent).sum())
        if name not in self.channels or not good.any() or good.sum() < 0.5 * whole:
            return None
        y = self.channel(name)[good]
        return np.asarray(np.interp(self.t, self.t[good], np.unwrap(y) if name in ANGLES else y))

    @property
    def inputs(self) -> list[Input]:
        """What is recorded that can drive a vehicle."""
        recorded: dict[Input, bool] = {
            "commands": bool(self.commands),
            "measured": bool(self.measured),
            "tau": self.tau is not None,
        }
        return [name for name, here in recorded.items() if here]

    @cached_property
    def startable(self) -> Mask:
        """Samples from which a segment may start, shape (n,): all channels valid there and closely around."""
        from scipy.ndimage import minimum_filter1d

        used = [CHANNELS.index(channel) for channel in self.channels]
        # A position that is never known (fixes at the surface) keeps no segment from starting.
        used = [k for k in used if k not in (6, 7) or self.valid[:, k].any()]
        good = self.valid[:, used].all(axis=1).astype(np.uint8)
        width = 2 * max(1, round(_STEADY_S / self.dt)) + 1
        return np.asarray(minimum_filter1d(good, width, mode="nearest")).astype(bool)

    def state(self, i: int | slice | NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Smoothed position NED in m (3,), attitude quaternion (4,), nu in m/s, rad/s (6,) at sample `i`.

        Those of a filter where the trial has them (``states``). A row per sample where `i` means several.
        """
        if self.states is not None:
            known = self.states
            return known[0][i], known[1][i], known[2][i]
        t = self.t[i]
        position, attitude = self._splines[0](t), self._splines[1](t)
        return position, attitude / np.linalg.norm(attitude, axis=-1, keepdims=True), self.smooth_nu(t)[0]

    def smooth_nu(self, t: ArrayLike) -> tuple[Array, Array]:
        """Body velocities and their rates, m/s, rad/s and per s, shapes (..., 6), at any times in s.

        Both come from one smoothing spline, so the rates are the derivative of the velocities.
        """
        velocity, rates = self._splines[2:]
        time = np.asarray(t, float)
        nu = np.concatenate([velocity(time), rates(time)], axis=-1)
        return nu, np.concatenate([velocity(time, 1), rates(time, 1)], axis=-1)

    @cached_property
    def _splines(self) -> tuple[CubicSpline, CubicSpline, CubicSpline, CubicSpline]:
        """Smoothing splines of position, attitude, linear and angular velocity."""
        present = [CHANNELS.index(channel) for channel in self.channels]

        def valid(first: int) -> Mask:
            used = [k for k in present if first <= k < first + 3]
            return np.asarray(np.logical_and.reduce(self.valid[:, used], axis=1))

        return (
            self._path(valid(6)),
            spline(self.t, self.attitude, valid(9)),
            spline(self.t, self.nu[:, :3], valid(0)),
            spline(self.t, self.nu[:, 3:], valid(3)),
        )

    def _path(self, known: Mask) -> CubicSpline:
        """Smoothing spline of the position; where only the depth is known, north and east as they are."""
        if known.any() or not self.valid[:, 8].any():
            return spline(self.t, self.position, known)
        from scipy.interpolate import CubicSpline

        depth = smooth(self.position[:, 2:], self.valid[:, 8])
        return CubicSpline(self.t, np.column_stack([self.position[:, :2], depth]), axis=0)

    @cached_property
    def table(self) -> pl.DataFrame:
        """Polars table with canonical columns, masked samples as empty cells; `Trial.read` reads it back."""
        return _canonical_table(self)

    def save(self, path: str | Path) -> None:
        """Write `table` to a .csv or .parquet file.

        Parameters
        ----------
        path
            Its ending decides the format.
        """
        path = Path(path)
        if path.suffix not in (".csv", ".parquet"):
            raise TrialError(f'{path}: expected the ending .csv or .parquet, found "{path.suffix}"')
        write_table(self.table, path)

    def record(
        self,
        weight: Mapping[str, float] | ArrayLike | None = None,
        substeps: int = 1,
        input: Input = "commands",
        motion: bool = True,
    ) -> Record:
        """Samples, weights and input of the trial as the core reads them.

        Parameters
        ----------
        weight
            Weight per channel name (others count nothing), or an array that broadcasts to (n, 12); one when
            omitted. Masked samples get zero in any case.
        substeps
            Integration steps per sample: the measured velocities are given at their half steps.
        input
            What drives the vehicle: the commands, the measured actuator signals, or the recorded wrench
            alone.
        motion
            Whether to give the smoothed velocities, which only measured axes need.
        """
        from seatrial._core import Record

        if input not in _INPUT_COLUMNS:
            raise TrialError(f'{self.name}: unknown input "{input}"{nearest(input, _INPUT_COLUMNS)}')
        if input not in self.inputs:
            raise TrialError(f"{self.name}: input {input} is not recorded; map {_INPUT_COLUMNS[input]}")
        nu = nu_rate = None
        if motion:
            points = 2 * substeps * (len(self) - 1) + 1
            nu, nu_rate = self.smooth_nu(np.linspace(self.t[0], self.t[-1], points))
        return Record(
            self.t,
            self.commands if input == "commands" else {},
            voltage_v=self.voltage_v,
            tau=self.tau if input == "tau" else None,
            current=self.current,
            actuators=self.measured if input == "measured" else None,
            nu=nu,
            nu_rate=nu_rate,
            observed=self.observed,
            weight=self._weights(weight),
            rho=self.rho,
            g=self.g,
            surface=self.surface,
        )

    def _weights(self, weight: Mapping[str, float] | ArrayLike | None) -> Array:
        if isinstance(weight, Mapping):
            row = np.zeros(12)
            for channel, value in weight.items():
                self.channel(channel)
                row[CHANNELS.index(channel)] = value
        else:
            row = np.ones(12) if weight is None else np.asarray(weight, float)
        return np.where(self.valid, row, 0.0)


def _canonical_table(trial: Trial) -> pl.DataFrame:
    """Polars table of a trial; masked samples are empty cells, an attitude is a quaternion."""
    import polars as pl

    known = np.where(trial.valid, trial.observed, np.nan)
    columns: dict[str, Array] = {"t_s": trial.t}
    present = trial.channels
    extra = {
        "force": None if trial.tau is None else trial.tau[:, :3],
        "moment": None if trial.tau is None else trial.tau[:, 3:],
        "current": trial.current,
        "water velocity": trial.water,
        "voltage": None if trial.voltage_v is None else trial.voltage_v[:, None],
    }
    for group in GROUPS:
        if group.name == "quaternion":
            if {"roll", "pitch", "yaw"} <= set(present):
                attitude = np.where(trial.valid[:, 9:10], trial.attitude, np.nan)
                columns |= dict(zip(group.columns, attitude.T, strict=True))
        elif (values := extra.get(group.name)) is not None:
            columns |= dict(zip(group.columns, values.T, strict=True))
        elif group.name != "euler" or "q_w" not in columns:
            for column, channel in zip(group.columns, group.channels, strict=True):
                if channel in present:
                    columns[column] = known[:, CHANNELS.index(channel)] / group.factor
    columns |= {f"cmd.{actuator}": values for actuator, values in trial.commands.items()}
    columns |= {f"meas.{actuator}": values for actuator, values in trial.measured.items()}
    return pl.DataFrame(columns, nan_to_null=True)
