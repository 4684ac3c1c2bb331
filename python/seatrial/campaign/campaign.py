"""Campaign: vehicle, bench test, trials and stages of an identification, checked and ready to run.

Trials are read when first asked for, the bench test when the campaign is made; both only once. Held by
``tests/campaign/test_campaign.py`` and ``test_a_bench_record_that_changes_is_read_again``.
"""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.errors import CampaignError, VehicleError, nearest
from seatrial.base.file_names import no_file
from seatrial.base.run import sha256
from seatrial.base.toml_file import file_path, is_path, text_of
from seatrial.campaign.file import CampaignFile, Environment, Input, Stage, TrialSource, in_order, parse
from seatrial.campaign.parameters import Parameter, coefficient_names, parameters
from seatrial.campaign.search_budget import Budget
from seatrial.campaign.variants import (
    LockedAxes,
    with_locked_axes,
    with_start_values,
    with_strips,
    without_coefficients,
    without_trial,
)
from seatrial.trial.ceiling import Unpredictable, unpredictable
from seatrial.trial.corrections import merged
from seatrial.trial.sensor_position import refuse_far
from seatrial.trial.verdict import Verdict, judge_trial

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.progress import Progress
    from seatrial.bench_test.result import BenchTest
    from seatrial.trial.recording import Recording
    from seatrial.trial.trial import Trial


class Campaign:
    """A checked campaign: vehicle, trials (read when first asked for), stages in the order of their run.

    Made by `load` or `from_toml`. ``vehicle`` is the vehicle as the bench test left it, ``bench`` that test
    (`seatrial.bench_test.result.BenchTest`, None without one).

    Parameters
    ----------
    file : CampaignFile
        What the file says.
    text, source : str
        Its text, kept with the results, and what to call it in messages.
    folder : Path
        Where paths in the file begin.
    trials : mapping, optional
        Trial name to path, frame or `Trial`, instead of the file's own.
    vehicle, bench : Vehicle, BenchTest, optional
        Instead of those that the file names.
    progress : callable, optional
        Called with a `Progress` before each step of the reading of a trial.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.from_toml('''
    ... format = 1
    ... name = "dive"
    ... vehicle = "cwolf"
    ... [trials.dive]
    ... file = "dive.csv"
    ... [[stages]]
    ... name = "heave"
    ... trials = ["dive"]
    ... axes = { free = "Z" }
    ... [stages.coefficients]
    ... Z_ww = [-1000.0, -50.0]
    ... ''')
    >>> campaign.parameters["heave"][0].lower
    -1000.0
    """

    def __init__(
        self,
        file: CampaignFile,
        *,
        text: str,
        source: str,
        folder: Path,
        trials: Mapping[str, Any] | None = None,
        vehicle: Vehicle | None = None,
        bench: BenchTest | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> None:
        self.file = file
        self.progress = progress
        self.text = text
        self.source = source
        self.folder = folder
        self._given_vehicle, self._given_bench = vehicle, bench
        self.bench = self._bench_test()
        self.vehicle = self._load_vehicle() if self.bench is None else self.bench.vehicle
        self._sources, self._data = self._trial_sources(dict(trials or {}))
        self.trials: Mapping[str, Trial] = _Trials(self, self._sources)
        self._parts: dict[tuple[str, bool], Trial | None] = {}
        self._limits: dict[str, Unpredictable] = {}
        self._verdicts: dict[str, dict[str, Verdict]] = {}
        self.stages = in_order(file.stages, source)
        self.parameters: dict[str, tuple[Parameter, ...]] = {
            stage.name: parameters(stage, self.vehicle, self.where(stage)) for stage in self.stages
        }
        self._check_trial_names()
        self._check_sensor_positions()
        self._check_side_by_side()

    @classmethod
    def load(
        cls,
        path: str | Path,
        trials: Mapping[str, Any] | None = None,
        *,
        progress: Callable[[Progress], None] | None = None,
    ) -> Campaign:
        """Campaign from a TOML file.

        Parameters
        ----------
        path : str or Path
        trials : mapping, optional
            Trial name to path (or polars or pandas frame), instead of the file's own. A name that the file
            does not have becomes a hold-out trial, read with the campaign's common column map.
        progress : callable, optional
            Called with a `Progress` before each step of the reading of a trial.

        Raises
        ------
        CampaignError
            The file is missing, not TOML, has unknown keys or contradicts itself.
        VehicleError
            The vehicle cannot be loaded.
        """
        path = Path(path)
        text = text_of(path, "a campaign file")
        return cls(
            parse(text, str(path)),
            text=text,
            source=str(path),
            folder=path.parent,
            trials=trials,
            progress=progress,
        )

    @classmethod
    def from_toml(
        cls,
        text: str,
        *,
        folder: str | Path = ".",
        source: str = "<text>",
        trials: Mapping[str, Any] | None = None,
        vehicle: Vehicle | None = None,
        bench: BenchTest | None = None,
    ) -> Campaign:
        """Campaign from TOML text; paths in it are relative to the folder.

        Parameters
        ----------
        text : str
        folder : str or Path
        source : str
            What to call the text in messages.
        trials : mapping, optional
            As in `load`.
        vehicle : Vehicle, optional
            Instead of the one that the text names.
        bench : BenchTest, optional
            Whose vehicle is taken, instead of the bench test that the text names.

        Raises
        ------
        CampaignError, VehicleError
            As in `load`.
        """
        return cls(
            parse(text, source),
            text=text,
            source=source,
            folder=Path(folder),
            trials=trials,
            vehicle=vehicle,
            bench=bench,
        )

    def with_locked_axes(self, mode: LockedAxes) -> Campaign:
        """Campaign with every axis that a stage does not free frozen or replayed; the joint estimate stays.

        Parameters
        ----------
        mode : "frozen" or "measured"
            Frozen axes keep the velocity that they have at the start of a segment, as in the paper; measured
            ones are replayed from the recording and enter the forces.

        Raises
        ------
        CampaignError
            There is no such mode.

        Examples
        --------
        >>> import seatrial as st
        >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
        >>> campaign.with_locked_axes("frozen").stages[0].axes.frozen  # doctest: +SKIP
        'YZKMN'
        """
        text = with_locked_axes(self.text, mode, self.source)
        return self.with_file(parse(text, self.source), text=text)

    def with_start_values(self, starts: Mapping[str, Mapping[str, float]], *, seed: int) -> Campaign:
        """Campaign with other start values, by stage and parameter, and another seed; its text stays.

        Parameters
        ----------
        starts : mapping
            Stage to parameter to value, SI; what it leaves out starts where it did.
        seed : int
        """
        file = with_start_values(self.file, self.parameters, starts, self.vehicle)
        return self.with_file(file.model_copy(update={"seed": seed}))

    def without_trial(self, name: str) -> tuple[Campaign, tuple[str, ...]]:
        """Campaign that does not know a trial, and the stages that no other trial is left for.

        Parameters
        ----------
        name
            Of the trial.

        Raises
        ------
        CampaignError
            There is no such trial, or the rest is no campaign.
        """
        if name not in self.trials:
            raise CampaignError(f"{self.source}: there is no trial {name!r}{nearest(name, self.trials)}")
        file, lost = without_trial(self.file, name)
        given = {trial: data for trial, data in self._data.items() if trial != name}
        other = Campaign(
            file,
            text=self.text,
            source=self.source,
            folder=self.folder,
            trials=given,
            vehicle=self._given_vehicle,
            bench=self._given_bench,
            progress=self.progress,
        )
        other.trials = {trial: self.trials[trial] for trial in self.trials if trial != name}
        other._verdicts = self._verdicts
        return other, lost

    def without_coefficients(self, names: Collection[str]) -> Campaign:
        """Campaign that frees none of these coefficients, by the names that its stages give them.

        Its text stays. A stage that frees nothing else is gone; there may be none left.
        """
        return self.with_file(without_coefficients(self.file, names)) if names else self

    def with_strips(self, name: str, bounds: tuple[float, float], start: float) -> Campaign:
        """Campaign that frees ``C_Dy`` or ``C_Dz`` in place of the quadratic damping that its strips make.

        Its text stays.

        Parameters
        ----------
        name
            ``C_Dy`` or ``C_Dz``.
        bounds, start
            Of the drag coefficient.
        """
        return self.with_file(with_strips(self.file, name, bounds, start))

    def with_file(self, file: CampaignFile, *, text: str | None = None) -> Campaign:
        """Campaign with another file, checked again; trials that were read are not read again.

        Parameters
        ----------
        file : CampaignFile
        text : str, optional
            Its text; that of this campaign when omitted.

        Raises
        ------
        CampaignError
            The file contradicts itself or names what does not exist.
        """
        text = self.text if text is None else text
        other = Campaign(
            file,
            text=text,
            source=self.source,
            folder=self.folder,
            trials=self._data,
            vehicle=self._given_vehicle,
            bench=self._given_bench,
            progress=self.progress,
        )
        other.trials = self.trials
        other._verdicts, other._limits = self._verdicts, self._limits
        return other

    @property
    def autopilot(self) -> Autopilot:
        """The autopilot with the start gains: the file's, or the built-in one of the vehicle.

        Raises
        ------
        CampaignError
            The file names none, and there is none built in for the vehicle.
        VehicleError
            It cannot be loaded.
        """
        from seatrial._core import Autopilot

        named = self.file.autopilot
        if named is None:
            if self.file.vehicle in Autopilot.names():
                return Autopilot.load(self.file.vehicle)
            raise CampaignError(
                f"{self.source}: key autopilot: expected the autopilot that is tuned or verified, found none;"
                " make one with `seatrial autopilot VEHICLE --out autopilot.toml` and name it here"
            )
        return Autopilot.load(self.resolve(named, "autopilot") if is_path(named) else named)

    def resolve(self, path: str, key: str) -> Path:
        """Path of a file that the campaign names, which begins in the campaign's folder.

        Parameters
        ----------
        path : str
        key : str
            Of the campaign file, for messages.

        Raises
        ------
        CampaignError
            An environment variable in the path is not set.
        """
        return self._path(path, f"key {key}")

    @property
    def name(self) -> str:
        """Name of the campaign."""
        return self.file.name

    @property
    def seed(self) -> int:
        """Seed of every random number of a run."""
        return self.file.seed

    def where(self, stage: Stage) -> str:
        """File and stage, as messages begin."""
        return f"{self.source}: stage {stage.name!r}"

    def stages_before(self, stage: Stage) -> list[str]:
        """Names of the stages that a stage runs after, directly or not, in the order of their run."""
        names = set(stage.after)
        for earlier in reversed(self.stages):
            if earlier.name in names:
                names |= set(earlier.after)
        return [earlier.name for earlier in self.stages if earlier.name in names]

    def budget(self, stage: Stage) -> Budget:
        """Budget of a stage: its own, then the campaign's."""
        return stage.budget.over(self.file.budget)

    def source_of(self, trial: str) -> TrialSource:
        """What the campaign says about a trial."""
        return self._sources[trial]

    def input_of(self, trial: str) -> Input:
        """What drives the model in a trial: "commands", "tau" or "measured"."""
        return self._sources[trial].input or self.file.input

    def environment_of(self, trial: str) -> Environment:
        """Water and gravity of a trial, None where the vehicle's own hold."""
        return self._sources[trial].environment.over(self.file.environment)

    def held_out(self, trial: str) -> NDArray[np.bool_]:
        """Mask (n,): True where a sample of the trial is held out of the fit."""
        source, t = self._sources[trial], self.trials[trial].t
        mask = np.full(len(t), source.hold_out)
        rounding = 1e-6 * self.trials[trial].dt  # a sample that lies on an end up to the clock's rounding
        for start, stop in source.hold_out_s:
            mask |= (t >= start - rounding) & (t < stop - rounding)
            if stop <= t[0] or start > t[-1]:
                raise CampaignError(
                    f"{self.source}: trial {trial!r}, key hold_out_s: [{start:g}, {stop:g}] lies outside the"
                    f" recording, which runs from {t[0]:g} to {t[-1]:g} s; use the trial's own time"
                )
        return mask

    def part(self, trial: str, *, held_out: bool) -> Trial | None:
        """The trial with only what is fitted, or what is held out, valid; None where nothing is.

        The same object at every call, so that its splines are made once.

        Parameters
        ----------
        trial
            Its name.
        held_out
            Whether what is held out is wanted, rather than what is fitted.
        """
        key = trial, held_out
        if key not in self._parts:
            whole, mask = self.trials[trial], self.held_out(trial) == held_out
            part = dataclasses.replace(whole, valid=whole.valid & mask[:, None]) if mask.any() else None
            self._parts[key] = whole if mask.all() else part
        return self._parts[key]

    def verdicts(self, trial: str) -> dict[str, Verdict]:
        """By axis whether a trial tells how it answers its commands, judged once."""
        if trial not in self._verdicts:
            self._verdicts[trial] = judge_trial(self.trials[trial], self.vehicle)
        return self._verdicts[trial]

    def limits(self) -> dict[str, Unpredictable]:
        """By trial what no model of the vehicle can predict of it, estimated once."""
        for name in self.trials:
            if name not in self._limits:
                self._limits[name] = unpredictable(self.trials[name], self.verdicts(name))
        return dict(self._limits)

    def path_of(self, trial: str) -> Path | None:
        """Path of a trial's file, None for a frame.

        Raises
        ------
        CampaignError
            An environment variable in the path is not set.
        """
        data = self._data.get(trial)
        if data is None:
            return self._path(self._sources[trial].file, f"trial {trial!r}, key file")
        return Path(data) if isinstance(data, str | Path) else None

    def read(self, trial: str) -> Trial:
        """Trial read from its file; `trials` reads each only once.

        Parameters
        ----------
        trial : str
            Its name in the campaign.

        Raises
        ------
        CampaignError
            There is no such file.
        TrialError
            The recording or its column map cannot be used.
        """
        from seatrial.trial.trial import Trial

        if isinstance(given := self._data.get(trial), Trial):
            return given
        source, environment = self._sources[trial], self.environment_of(trial)
        return Trial.read(
            self._recorded(trial),
            name=trial,
            rate_hz=source.rate_hz or self.file.rate_hz,
            rho=environment.rho_kg_m3,
            g=environment.g_m_s2,
            surface=environment.surface_m,
            progress=self.progress,
            **self._options(trial),
        )

    def recording(self, trial: str) -> Recording | None:
        """Signals of a trial on their own stamps; None where the trial was given as one.

        Raises
        ------
        CampaignError
            There is no such file.
        TrialError
            The recording or its column map cannot be used.
        """
        from seatrial.trial.recording import recording
        from seatrial.trial.trial import Trial

        if isinstance(self._data.get(trial), Trial):
            return None
        return recording(self._recorded(trial), **self._options(trial))

    def _recorded(self, trial: str) -> Any:
        """Path or frame of a trial's recording."""
        path = self.path_of(trial)
        if path is not None and (wrong := no_file(path)):
            raise CampaignError(
                f"{self.source}: trial {trial!r}, key file: {wrong}; correct the path or give"
                f" another one with trials={{{trial!r}: path}}"
            )
        return self._data[trial] if path is None else path

    def _options(self, trial: str) -> dict[str, Any]:
        """How a trial's recording becomes signals: reader, column map, places and corrections."""
        source = self._sources[trial]
        return {
            "reader": source.reader or self.file.reader,
            "columns": self.file.columns | source.columns or None,
            "sensor_positions": source.places.over(self.file.places).by_sensor(),
            "mixer": None if (table := source.mixer or self.file.mixer) is None else table.mixer(),
            "corrections": merged(self.file.corrections, source.corrections),
        }

    def file_hash(self, trial: str) -> str | None:
        """SHA-256 of a trial's file, None for a frame."""
        path = self.path_of(trial)
        if path is None:
            return None
        return sha256(path.read_bytes())

    def _load_vehicle(self) -> Vehicle:
        from seatrial._core import Vehicle

        if self._given_vehicle is not None:
            return self._given_vehicle
        name = self.file.vehicle
        try:
            return Vehicle.load(str(self._path(name, "key vehicle")) if is_path(name) else name)
        except VehicleError as error:
            raise VehicleError(f"{self.source}: key vehicle: {error}") from None

    def _bench_test(self) -> BenchTest | None:
        """Bench test of the vehicle, where the file names one."""
        if self._given_bench is not None or self.file.bench is None:
            return self._given_bench
        path = self._path(self.file.bench, "key bench")
        return _bench_test(path, self._load_vehicle(), f"{self.source}: key bench")

    def _path(self, text: str, where: str) -> Path:
        """Path relative to the campaign file, ``${VARIABLE}`` replaced by the environment's value."""
        return file_path(text, self.folder, f"{self.source}: {where}")

    def _trial_sources(self, given: dict[str, Any]) -> tuple[dict[str, TrialSource], dict[str, Any]]:
        sources = dict(self.file.trials)
        for name in given:
            if name not in sources:
                sources[name] = TrialSource(file="<given>", hold_out=True)
        return sources, given

    def _check_trial_names(self) -> None:
        for stage in self.stages:
            for name in stage.trials:
                if name not in self._sources:
                    raise CampaignError(
                        f"{self.where(stage)}, key trials: unknown trial {name!r}"
                        + nearest(name, self._sources)
                    )
                if self._sources[name].hold_out:
                    raise CampaignError(
                        f"{self.where(stage)}, key trials: trial {name!r} is held out as a whole;"
                        " remove it from the stage or its hold_out"
                    )

    def _check_sensor_positions(self) -> None:
        length = self.vehicle.geometry().get("length")
        refuse_far(self.file.places.by_sensor(), length, f"{self.source}: places")
        for name, trial in self.file.trials.items():
            refuse_far(trial.places.by_sensor(), length, f"{self.source}: trials, {name}, places")

    def _check_side_by_side(self) -> None:
        """Refuse two stages that set one coefficient with no order between them."""
        for i, stage in enumerate(self.stages):
            for other in self.stages[:i]:
                own, others = (set(coefficient_names(self.parameters[s.name])) for s in (stage, other))
                shared = own & others
                if shared and other.name not in self.stages_before(stage):
                    raise CampaignError(
                        f"{self.where(stage)}: coefficient {min(shared)!r} is also freed by stage"
                        f" {other.name!r}, and neither runs after the other; set after = [{other.name!r}]"
                    )


class _Trials(Mapping[str, "Trial"]):
    """Trials by name, read when first asked for."""

    def __init__(self, campaign: Campaign, sources: Mapping[str, TrialSource]) -> None:
        self._campaign, self._sources = campaign, sources
        self._read: dict[str, Trial] = {}
        self._lock = threading.Lock()

    def __getitem__(self, name: str) -> Trial:
        if name not in self._sources:
            raise KeyError(name)
        with self._lock:
            if name not in self._read:
                self._read[name] = self._campaign.read(name)
            return self._read[name]

    def __contains__(self, name: object) -> bool:
        return name in self._sources  # without reading the trial

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _lock=threading.Lock())


def _bench_test(path: Path, vehicle: Vehicle, where: str) -> BenchTest:
    """Bench test of a campaign's vehicle from its file; the same records are evaluated once.

    Parameters
    ----------
    path : Path
        Bench file.
    vehicle : Vehicle
        The campaign's, before the test.
    where : str
        Beginning of messages.

    Raises
    ------
    CampaignError
        There is no such file, or it tests another vehicle.
    """
    from seatrial.bench_test.evaluate import fingerprint, vehicle_of

    if wrong := no_file(path):
        raise CampaignError(f"{where}: {wrong}; correct the path or remove the key")
    tested = vehicle_of(path)
    if tested.name != vehicle.name:
        raise CampaignError(
            f"{where}: {path} tests the vehicle {tested.name}, and the campaign"
            f" identifies {vehicle.name}; name the same vehicle in both"
        )
    return _benched(str(path.resolve()), fingerprint(path), vehicle.to_toml())


@functools.lru_cache(maxsize=4)
def _benched(path: str, _fingerprint: str, vehicle: str) -> BenchTest:
    from seatrial._core import Vehicle
    from seatrial.bench_test.evaluate import bench

    return bench(path, vehicle=Vehicle.from_toml(vehicle, path))


def input_hashes(campaign: Campaign, *, trials: bool = True) -> dict[str, str]:
    """SHA-256 of what a run over a campaign reads, by name.

    Parameters
    ----------
    campaign : Campaign
    trials : bool, optional
        Whether the recordings are among the inputs.
    """
    return {
        "campaign": sha256(campaign.text),
        "vehicle": sha256(campaign.vehicle.to_toml()),
        **({} if campaign.bench is None else campaign.bench.facts["sha256"]),
        **{f"trial {name}": campaign.file_hash(name) for name in (campaign.trials if trials else ())},
    }
