"""seatrial: from sea-trial logs to an identified model of an underwater vehicle.

The names below are the public interface; everything a command of the command line does is one of
these functions first. SI and radians throughout; frames: n = north-east-down, b = forward-starboard-
down with origin O. Everything is loaded when it is first used: `seatrial.__main__` stands ready for
Ctrl-C before any library is.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # without `typing`, which takes longer than all else here
if TYPE_CHECKING:
    from seatrial._core import Autopilot as Autopilot
    from seatrial._core import Flights as Flights
    from seatrial._core import Run as Run
    from seatrial._core import State as State
    from seatrial._core import Vehicle as Vehicle
    from seatrial._core import simulate_batch as simulate_batch
    from seatrial.base.errors import CampaignError as CampaignError
    from seatrial.base.errors import SeatrialError as SeatrialError
    from seatrial.base.errors import SimulationError as SimulationError
    from seatrial.base.errors import TrialError as TrialError
    from seatrial.base.errors import VehicleError as VehicleError
    from seatrial.base.work import ProgressBar as ProgressBar
    from seatrial.base.work import Work as Work
    from seatrial.bench_test.evaluate import BenchTest as BenchTest
    from seatrial.bench_test.evaluate import bench as bench
    from seatrial.campaign.campaign import Campaign as Campaign
    from seatrial.control_design.start_autopilot import start_autopilot as start_autopilot
    from seatrial.experiment.plan import Plan as Plan
    from seatrial.experiment.plan import plan as plan
    from seatrial.export.c_code import CExport as CExport
    from seatrial.export.c_code import export_c as export_c
    from seatrial.export.fmu import FmuExport as FmuExport
    from seatrial.export.fmu import export_fmu as export_fmu
    from seatrial.flight.conditions import Conditions as Conditions
    from seatrial.flight.conditions import Water as Water
    from seatrial.flight.disturbances import Fault as Fault
    from seatrial.flight.disturbances import Outage as Outage
    from seatrial.flight.disturbances import SeaState as SeaState
    from seatrial.flight.flight import Flight as Flight
    from seatrial.flight.flight import fly as fly
    from seatrial.flight.flight import fly_batch as fly_batch
    from seatrial.flight.mission import Mission as Mission
    from seatrial.flight.navigation import NavigationFilter as NavigationFilter
    from seatrial.flight.navigation import ProcessNoise as ProcessNoise
    from seatrial.flight.navigation import SampleGate as SampleGate
    from seatrial.identification.fitted import Fitted as Fitted
    from seatrial.identification.identification import Identification as Identification
    from seatrial.identification.identify import identify as identify
    from seatrial.identification.leave_one_out import LeaveOneOut as LeaveOneOut
    from seatrial.identification.leave_one_out import leave_one_out as leave_one_out
    from seatrial.intake.imported import Imported as Imported
    from seatrial.intake.imported import import_logs as import_logs
    from seatrial.problem.problem import Problem as Problem
    from seatrial.problem.settings import Anchor as Anchor
    from seatrial.problem.settings import JointSettings as JointSettings
    from seatrial.problem.settings import Stage as Stage
    from seatrial.problem.settings import TrialUse as TrialUse
    from seatrial.realtime.ardupilot_link import SitlSession as SitlSession
    from seatrial.realtime.ardupilot_link import sitl as sitl
    from seatrial.scoring.comparison import Comparison as Comparison
    from seatrial.scoring.comparison import compare as compare
    from seatrial.scoring.score import Score as Score
    from seatrial.scoring.score import score as score
    from seatrial.trial.trial import Trial as Trial
    from seatrial.tuning.control_problem import ControlProblem as ControlProblem
    from seatrial.tuning.result import Tuning as Tuning
    from seatrial.tuning.tuning_run import tune as tune
    from seatrial.verification.boundary import Boundary as Boundary
    from seatrial.verification.boundary import FailureBoundary as FailureBoundary
    from seatrial.verification.falsify import Falsification as Falsification
    from seatrial.verification.falsify import Falsify as Falsify
    from seatrial.verification.mission_log.judge_log import LogSettings as LogSettings
    from seatrial.verification.mission_log.judge_log import verify_log as verify_log
    from seatrial.verification.mission_log.log import MissionLog as MissionLog
    from seatrial.verification.mission_log.verdict import LogVerdict as LogVerdict
    from seatrial.verification.rare import Rare as Rare
    from seatrial.verification.rare import RareFailures as RareFailures
    from seatrial.verification.requirement import Requirement as Requirement
    from seatrial.verification.scenario import Scenario as Scenario
    from seatrial.verification.verify import Verification as Verification
    from seatrial.verification.verify import verify as verify

_HOME = {
    "Anchor": "seatrial.problem.settings",
    "Autopilot": "seatrial._core",
    "BenchTest": "seatrial.bench_test.evaluate",
    "Boundary": "seatrial.verification.boundary",
    "CExport": "seatrial.export.c_code",
    "Campaign": "seatrial.campaign.campaign",
    "CampaignError": "seatrial.base.errors",
    "Comparison": "seatrial.scoring.comparison",
    "Conditions": "seatrial.flight.conditions",
    "ControlProblem": "seatrial.tuning.control_problem",
    "FailureBoundary": "seatrial.verification.boundary",
    "Falsification": "seatrial.verification.falsify",
    "Falsify": "seatrial.verification.falsify",
    "Fault": "seatrial.flight.disturbances",
    "Fitted": "seatrial.identification.fitted",
    "Flight": "seatrial.flight.flight",
    "Flights": "seatrial._core",
    "FmuExport": "seatrial.export.fmu",
    "Identification": "seatrial.identification.identification",
    "Imported": "seatrial.intake.imported",
    "JointSettings": "seatrial.problem.settings",
    "LeaveOneOut": "seatrial.identification.leave_one_out",
    "LogSettings": "seatrial.verification.mission_log.judge_log",
    "LogVerdict": "seatrial.verification.mission_log.verdict",
    "Mission": "seatrial.flight.mission",
    "MissionLog": "seatrial.verification.mission_log.log",
    "NavigationFilter": "seatrial.flight.navigation",
    "ProcessNoise": "seatrial.flight.navigation",
    "SampleGate": "seatrial.flight.navigation",
    "Outage": "seatrial.flight.disturbances",
    "Plan": "seatrial.experiment.plan",
    "Problem": "seatrial.problem.problem",
    "ProgressBar": "seatrial.base.work",
    "Rare": "seatrial.verification.rare",
    "RareFailures": "seatrial.verification.rare",
    "Requirement": "seatrial.verification.requirement",
    "Run": "seatrial._core",
    "Scenario": "seatrial.verification.scenario",
    "Score": "seatrial.scoring.score",
    "SeaState": "seatrial.flight.disturbances",
    "SeatrialError": "seatrial.base.errors",
    "SimulationError": "seatrial.base.errors",
    "SitlSession": "seatrial.realtime.ardupilot_link",
    "Stage": "seatrial.problem.settings",
    "State": "seatrial._core",
    "Trial": "seatrial.trial.trial",
    "TrialUse": "seatrial.problem.settings",
    "TrialError": "seatrial.base.errors",
    "Tuning": "seatrial.tuning.result",
    "Vehicle": "seatrial._core",
    "VehicleError": "seatrial.base.errors",
    "Verification": "seatrial.verification.verify",
    "Water": "seatrial.flight.conditions",
    "Work": "seatrial.base.work",
    "bench": "seatrial.bench_test.evaluate",
    "compare": "seatrial.scoring.comparison",
    "export_c": "seatrial.export.c_code",
    "export_fmu": "seatrial.export.fmu",
    "fly": "seatrial.flight.flight",
    "fly_batch": "seatrial.flight.flight",
    "identify": "seatrial.identification.identify",
    "import_logs": "seatrial.intake.imported",
    "leave_one_out": "seatrial.identification.leave_one_out",
    "plan": "seatrial.experiment.plan",
    "score": "seatrial.scoring.score",
    "simulate_batch": "seatrial._core",
    "sitl": "seatrial.realtime.ardupilot_link",
    "start_autopilot": "seatrial.control_design.start_autopilot",
    "tune": "seatrial.tuning.tuning_run",
    "verify": "seatrial.verification.verify",
    "verify_log": "seatrial.verification.mission_log.judge_log",
}

__all__ = sorted(_HOME)

_INSTEAD = {
    **dict.fromkeys(("Coverage", "coverage"), "in a clone, run python -m studies.coverage"),
    **dict.fromkeys(("Restarts", "restarts"), "in a clone, run python -m studies.random_starts"),
    "rare_failures": "use st.verify(..., strategy=st.Rare())",
    "falsify": "use st.verify(..., strategy=st.Falsify())",
    "failure_boundary": "use st.verify(..., strategy=st.Boundary({NAME: (FROM, TO)}))",
}
"""What to use in place of names that went."""

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`

    def __getattr__(name: str) -> object:
        if name not in _HOME:
            instead = f"; {_INSTEAD[name]}" if name in _INSTEAD else ""
            raise AttributeError(f"module 'seatrial' has no attribute {name!r}{instead}")
        return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return list(__all__)
