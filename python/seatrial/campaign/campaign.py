"""Campaign: a campaign file with its vehicle, bench test and trials, checked and ready to run.

What it asks of an identification is a `Problem`, the same object that is made by hand without a file. Trials
are read when first asked for, the bench test when the campaign is made; both only once. Held by
``tests/campaign/test_campaign.py`` and ``test_a_bench_record_that_changes_is_read_again``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from seatrial.base.errors import CampaignError, VehicleError
from seatrial.base.files import no_file
from seatrial.base.front import ByName
from seatrial.base.toml_file import file_path, is_path, text_of
from seatrial.base.work import HERE, Work, takes
from seatrial.campaign.file import CampaignFile, Environment, LockedAxes, TrialSource, parse, with_locked_axes
from seatrial.problem.problem import Problem
from seatrial.problem.settings import TrialUse
from seatrial.trial.corrections import merged, refuse_far

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.work import Progress
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification
    from seatrial.trial.recording import Recording
    from seatrial.trial.trial import Trial
    from seatrial.tuning.control_problem import ControlProblem
    from seatrial.tuning.result import Tuning
    from seatrial.verification.mission_log.verdict import LogVerdict
    from seatrial.verification.scenario import Scenario
    from seatrial.verification.verify import Strategy, Verification


_R = TypeVar("_R")


class Campaign:
    """A checked campaign: vehicle, trials (read when first asked for), stages in the order of their run.

    Made by `load` or `from_toml`. ``vehicle`` is the vehicle as the bench test left it, ``bench`` that test
    (`seatrial.bench_test.evaluate.BenchTest`, None without one).

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
    >>> campaign.problem().parameters["heave"][0].lower
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
        self.trials: Mapping[str, Trial] = ByName(self._sources, self.read)
        self._problem = self._asked()
        self._check_sensor_positions()

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
        >>> campaign.with_locked_axes("frozen").problem().stages[0].axes.frozen  # doctest: +SKIP
        'YZKMN'
        """
        text = with_locked_axes(self.text, mode, self.source)
        return self.with_file(parse(text, self.source), text=text)

    def with_file(self, file: CampaignFile, *, text: str | None = None) -> Campaign:
        """Campaign with another file, and its text, checked again; trials that were read stay.

        Raises CampaignError: the file contradicts itself or names what does not exist.
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
        other._problem = other._asked()
        return other

    def problem(self) -> Problem:
        """What the campaign asks of an identification: the same object at every call."""
        return self._problem

    @takes(work=Work)
    def identify(self, *, work: Work = HERE) -> Identification:
        """Identification of the vehicle.

        Parameters
        ----------
        work : Work, optional
            As of `seatrial.identify`, whose result and errors these are.
        """
        return self._problem.identify(work=work)

    def control_problem(
        self, fit: Identification | Fitted | Vehicle | str | Path | None = None
    ) -> ControlProblem:
        """What the campaign asks of a tuning.

        Parameters
        ----------
        fit : Identification, run directory, Vehicle, built-in name or file, optional
            What is known of the vehicle; the campaign's own vehicle, taken as exact, when missing.

        Raises
        ------
        CampaignError
            The fit is of another vehicle, or vehicle and autopilot cannot do what is asked.
        VehicleError, TrialError
            A file is not usable.
        """
        from seatrial.control_design.tuning_table import TuningTable
        from seatrial.tuning.control_problem import ControlProblem

        table = self.file.tuning or TuningTable()
        fitted = self.fitted(fit)
        if table.sensors not in ("typical", "perfect"):
            path = self.resolve(table.sensors, "tuning.sensors")
            table = table.model_copy(update={"sensors": str(path)})
        problem = ControlProblem.of_table(
            table,
            fitted,
            self.autopilot,
            name=self.name,
            seed=self.seed,
            origin=f"the campaign {self.name}",
            given_text=self.text,
            inputs=self.input_hashes(trials=False),
        )
        problem.refuse_what_cannot_fly(f"{self.source}: tuning")
        return problem

    @takes(work=Work)
    def tune(
        self, fit: Identification | Fitted | Vehicle | str | Path | None = None, *, work: Work = HERE
    ) -> Tuning:
        """Tuning of the campaign's autopilot.

        Parameters
        ----------
        fit
            As of `control_problem`.
        work
            As of `seatrial.tune`, whose result and errors these are.
        """
        from seatrial.tuning.tuning_run import tune

        return tune(self.control_problem(fit), work=work)

    def scenario(
        self,
        fit: Identification | Fitted | Vehicle | str | Path | None = None,
        gains: Tuning | Autopilot | str | Path | None = None,
        *,
        model: Vehicle | str | Path | None = None,
        runs: int | None = None,
        missions: Sequence[Mission | str | Path] | None = None,
        navigation: str | None = None,
    ) -> Scenario:
        """What the campaign asks of a verification.

        Parameters
        ----------
        fit : Identification, Fitted, Vehicle, str or Path, optional
            The vehicle and how well it is known; the campaign's vehicle, taken as exact, when missing.
        gains : Tuning, Autopilot, str or Path, optional
            The autopilot; the campaign's when missing.
        model : Vehicle, str or Path, optional
            The vehicle that the autopilot believes in; by default the best values of ``fit``. With it,
            ``fit`` may be a vehicle that the autopilot does not know.
        runs, missions, navigation : optional
            Instead of those of the table ``[verification]``.

        Raises
        ------
        CampaignError
            There is no table ``[verification]``, or a requirement cannot be read.
        SimulationError, TrialError, VehicleError
            A mission, sensor, failure or number is not usable.
        """
        from seatrial.campaign.verification import scenario_of

        return scenario_of(self, fit, gains, model=model, runs=runs, missions=missions, navigation=navigation)

    @overload
    def verify(
        self,
        fit: Identification | Fitted | Vehicle | str | Path | None = None,
        gains: Tuning | Autopilot | str | Path | None = None,
        *,
        strategy: None = None,
        compare: bool | Mapping[str, Any] = False,
        work: Work = HERE,
        **changes: Any,
    ) -> Verification: ...

    @overload
    def verify(
        self,
        fit: Identification | Fitted | Vehicle | str | Path | None = None,
        gains: Tuning | Autopilot | str | Path | None = None,
        *,
        strategy: Strategy[_R],
        work: Work = HERE,
        **changes: Any,
    ) -> _R: ...

    @takes(work=Work)
    def verify(
        self,
        fit: Identification | Fitted | Vehicle | str | Path | None = None,
        gains: Tuning | Autopilot | str | Path | None = None,
        *,
        strategy: Strategy[Any] | None = None,
        compare: bool | Mapping[str, Any] = False,
        work: Work = HERE,
        **changes: Any,
    ) -> Any:
        """Verification of an autopilot by the campaign's missions, as of `seatrial.verify`.

        Parameters
        ----------
        fit, gains
            As of `scenario`.
        strategy : Rare, Falsify or Boundary, optional
            As of `seatrial.verify`.
        compare : bool or mapping of str to autopilot
            Fly some of the missions with the campaign's autopilot ("start") as well, or with those by name.
        work : Work, optional
        **changes
            ``model``, ``runs``, ``missions`` and ``navigation`` of `scenario`.
        """
        from seatrial.campaign.verification import others_of
        from seatrial.verification.verify import verify

        scenario, others = self.scenario(fit, gains, **changes), others_of(self, gains, compare)
        if strategy is None:
            return verify(scenario, compare=others, work=work)
        return verify(scenario, strategy=strategy, work=work)

    def judge_log(
        self,
        fit: Fitted | Identification | Vehicle | str | Path,
        log: str | Path,
        *,
        references: Sequence[str | Path] = (),
        **judging: Any,
    ) -> LogVerdict:
        """Verdict on the log of a mission by the campaign's trials, requirements, corridors and sensors.

        Parameters
        ----------
        fit : Fitted, Identification, Vehicle, str or Path
            The model, with its covariance where there is one.
        log : str or Path
            A run directory of `seatrial fly`, a file, or the name of a trial, of which the part is judged
            that was held out.
        references : sequence of str or Path, optional
            Logs on which the model is known to hold, instead of the campaign's trials.
        **judging
            ``autopilot``, ``mission``, ``current`` and ``settings`` of `seatrial.verify_log`.

        Raises
        ------
        TrialError, CampaignError, SimulationError, VehicleError
            Something cannot be used.
        """
        from seatrial.base.work import one_blas_thread
        from seatrial.campaign.verification import verify_campaign_log

        with one_blas_thread():
            return verify_campaign_log(self, fit, log, references=references, **judging)[0]

    def fitted(self, fit: Any, *, in_order: bool = False) -> Fitted:
        """What is known of the campaign's vehicle, which counts as exact without a fit.

        Raises CampaignError: the fit is of a vehicle with other actuators, or ``in_order`` in another order.
        """
        from seatrial.identification.fitted import Fitted

        known = Fitted.of(self.vehicle if fit is None else fit)
        theirs, own = known.vehicle.actuators, self.vehicle.actuators
        if set(theirs) != set(own) or (in_order and list(theirs) != list(own)):
            raise CampaignError(
                f"{self.source}: expected a fit of {self.vehicle.name}, found one of {known.vehicle.name}"
                " with other actuators; give the run directory of this campaign"
            )
        return known

    def input_hashes(self, *, trials: bool = True) -> dict[str, Any]:
        """SHA-256 of what a run over the campaign reads, by name; of the recordings only with ``trials``."""
        return self._problem.input_hashes(trials=trials)

    def _asked(self) -> Problem:
        file, sources = self.file, self._sources
        return Problem.of(
            vehicle=self.vehicle,
            bench=self.bench,
            trials=self.trials,
            uses={
                name: TrialUse(source.input or file.input, source.hold_out, source.hold_out_s)
                for name, source in sources.items()
            },
            files=ByName(sources, self.path_of),
            recordings=ByName(sources, self.recording),
            stages=file.stages,
            joint=file.polish,
            anchor=file.anchor,
            common_budget=file.budget,
            name=file.name,
            seed=file.seed,
            source=self.source,
            given_text=self.text,
        )

    @property
    def autopilot(self) -> Autopilot:
        """The autopilot with the start gains: the file's, or the built-in one of the vehicle.

        Raises CampaignError: there is none of either; VehicleError: it cannot be loaded.
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
        """Path of a file that a key of the campaign names, which begins in the campaign's folder.

        ``${VARIABLE}`` is replaced by the environment's value; CampaignError where that is not set.
        """
        return file_path(path, self.folder, f"{self.source}: key {key}")

    @property
    def name(self) -> str:
        """Name of the campaign."""
        return self.file.name

    @property
    def seed(self) -> int:
        """Seed of every random number of a run."""
        return self.file.seed

    def source_of(self, trial: str) -> TrialSource:
        """What the campaign says about a trial."""
        return self._sources[trial]

    def environment_of(self, trial: str) -> Environment:
        """Water and gravity of a trial, None where the vehicle's own hold."""
        return self._sources[trial].environment.over(self.file.environment)

    def path_of(self, trial: str) -> Path | None:
        """Path of a trial's file, None for a frame; CampaignError where a variable in it is not set."""
        data = self._data.get(trial)
        if data is None:
            where = f"{self.source}: trial {trial!r}, key file"
            return file_path(self._sources[trial].file, self.folder, where)
        return Path(data) if isinstance(data, str | Path) else None

    def read(self, trial: str) -> Trial:
        """Trial of a name read from its file; `trials` reads each only once.

        Raises CampaignError: there is no such file; TrialError: recording or column map cannot be used.
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
        """Signals of a trial on their own stamps, with the errors of `read`; None where it was given."""
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

    def _load_vehicle(self) -> Vehicle:
        from seatrial._core import Vehicle

        if self._given_vehicle is not None:
            return self._given_vehicle
        name = self.file.vehicle
        try:
            return Vehicle.load(str(self.resolve(name, "vehicle")) if is_path(name) else name)
        except VehicleError as error:
            raise VehicleError(f"{self.source}: key vehicle: {error}") from None

    def _bench_test(self) -> BenchTest | None:
        """Bench test of the vehicle, where the file names one; the same records are evaluated once."""
        if self._given_bench is not None or self.file.bench is None:
            return self._given_bench
        from seatrial.bench_test.evaluate import fingerprint, vehicle_of

        path, where = self.resolve(self.file.bench, "bench"), f"{self.source}: key bench"
        vehicle = self._load_vehicle()
        if wrong := no_file(path):
            raise CampaignError(f"{where}: {wrong}; correct the path or remove the key")
        tested = vehicle_of(path)
        if tested.name != vehicle.name:
            raise CampaignError(
                f"{where}: {path} tests the vehicle {tested.name}, and the campaign"
                f" identifies {vehicle.name}; name the same vehicle in both"
            )
        return _benched(str(path.resolve()), fingerprint(path), vehicle.to_toml())

    def _trial_sources(self, given: dict[str, Any]) -> tuple[dict[str, TrialSource], dict[str, Any]]:
        sources = dict(self.file.trials)
        for name in given:
            if name not in sources:
                sources[name] = TrialSource(file="<given>", hold_out=True)
        return sources, given

    def _check_sensor_positions(self) -> None:
        length = self.vehicle.geometry().get("length")
        refuse_far(self.file.places.by_sensor(), length, f"{self.source}: places")
        for name, trial in self.file.trials.items():
            refuse_far(trial.places.by_sensor(), length, f"{self.source}: trials, {name}, places")


@functools.lru_cache(maxsize=4)
def _benched(path: str, _fingerprint: str, vehicle: str) -> BenchTest:
    from seatrial._core import Vehicle
    from seatrial.bench_test.evaluate import bench

    return bench(path, vehicle=Vehicle.from_toml(vehicle, path))
