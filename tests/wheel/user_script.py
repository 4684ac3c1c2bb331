"""A user's script from logs to verdict; `make test-wheel` checks its types and runs it on an installed wheel.

Every value that it prints is annotated: a result whose attributes are `Any` would pass any type check.

python tests/wheel/user_script.py FOLDER
"""

from __future__ import annotations

import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import seatrial as st

SHORT = """
[budget]
generations = 4
simplex_rounds = 2
"""

AFTER = """
[tuning]
samples = 1
settle_s = 6.0
margins = { phase_deg = 0.0, gain_db = 0.0, delay_s = 0.0 }
budget = { population = 6, generations = 2, simplex_rounds = 1 }
[tuning.loops.heading]
steps = [20.0]
speeds_m_s = [0.4]

[verification]
runs = 8
missions = ["mission.toml"]
current = { speed_m_s = [0.0, 0.05] }
[[verification.requirements]]
name = "is complete"
holds = 'ending == "complete"'
probability = 0.5
"""


def simulate(vehicle: st.Vehicle) -> NDArray[np.float64]:
    """Speed ahead after a minute at a constant command, m/s."""
    t = np.arange(0.0, 60.0, 0.1)
    group = next(iter(vehicle.actuator_info()))
    run: st.Run = vehicle.simulate(t, {group: np.full(len(t), 600.0)}, st.State(position=[0.0, 0.0, 2.0]))
    speed: NDArray[np.float64] = run.nu[:, 0]
    return speed


def identify(campaign: st.Campaign, folder: Path) -> st.Identification:
    """The vehicle of a campaign, and what the trials say of its coefficients."""
    fit = campaign.identify(work=st.Work(run_dir=folder / "identified"))
    for coefficient in fit.coefficients:
        name: str = coefficient.name
        estimate: float = coefficient.estimate
        sigma: float = fit.sigma.get(name, float("inf"))
        print(f"{name} {estimate:.3g} +- {sigma:.2g} {coefficient.unit}")
    summary: str = fit.summary()
    assert summary
    return fit


def judge(fit: st.Identification, trial: st.Trial) -> dict[str, float]:
    """Share of the motion that the vehicle predicts ten seconds ahead, per channel."""
    score: st.Score = st.score(fit.vehicle, trial, ahead_s=10.0)
    return dict(score.r2)


def tune(campaign: st.Campaign, fit: st.Identification, folder: Path) -> st.Autopilot:
    """The autopilot with gains that keep to the corridors."""
    tuning: st.Tuning = campaign.tune(fit, work=st.Work(run_dir=folder / "tuned"))
    tuned = tuning.of("tuned")
    assert tuned is not None
    for response in tuned.trials:
        outside_s: float = response.nominal_s
        print(f"{response.loop} at {response.speed_m_s} m/s: {outside_s:.2f} s outside its corridor")
    feasible: bool = tuning.feasible
    print("feasible" if feasible else "not feasible")
    gains: dict[str, float] = tuning.autopilot.gains()
    assert gains
    return tuning.autopilot


def verify(campaign: st.Campaign, fit: st.Identification, autopilot: st.Autopilot) -> bool:
    """Whether the requirements are held in drawn missions."""
    verification: st.Verification = campaign.verify(fit, autopilot)
    for row in verification.requirements:
        words: str = row.requirement.name
        failures: int = row.found.failures
        print(f"{words}: {failures} of {verification.asked} failed, {row.verdict}")
    return verification.held


def fly(vehicle: st.Vehicle, autopilot: st.Autopilot, mission: st.Mission) -> float:
    """Greatest speed over ground of a flight, m/s."""
    flight: st.Flight = st.fly(
        vehicle,
        autopilot,
        mission,
        conditions=st.Conditions(faults=[st.Fault(next(iter(vehicle.actuator_info())), at_s=600.0)]),
        water=st.Water(current=[0.05, 0.0, 0.0]),
    )
    outcome: str = flight.outcome
    nu: NDArray[np.float64] = flight.nu
    print(f"{mission.name}: {outcome}, {mission.length:.0f} m, {flight.energy_wh[-1]:.1f} Wh")
    return float(np.abs(nu[:, 0]).max())


def carries_its_notices() -> bool:
    """Whether the licence and the third-party notices came with the package."""
    names = [file.name for file in metadata.files("seatrial") or ()]
    return {"LICENSE", "THIRD_PARTY_NOTICES.txt", "third_party.json"} <= set(names)


def main(folder: Path) -> None:
    assert carries_its_notices()
    project = folder / "project"
    subprocess.run([sys.executable, "-m", "seatrial", "new", project], check=True, stdout=subprocess.DEVNULL)
    vehicle = st.Vehicle.load(project / "vehicle.toml")
    print(f"{vehicle.name}: {simulate(vehicle)[-1]:.2f} m/s after a minute")
    (project / "autopilot.toml").write_text(st.start_autopilot(vehicle))
    text = (project / "campaign.toml").read_text().replace("[trials]", f"{SHORT}[trials]", 1)
    text = text.replace("format = 1\n", 'format = 1\nautopilot = "autopilot.toml"\n', 1) + AFTER
    (project / "campaign.toml").write_text(text)

    campaign = st.Campaign.load(project / "campaign.toml")
    fit = identify(campaign, folder)
    trial: st.Trial = st.Trial.read(project / "logs" / "mixed.csv")
    print(f"{trial.name}, {len(trial)} samples: R2 of u {judge(fit, trial)['u']:.3f}")
    autopilot = tune(campaign, fit, folder)
    print("held" if campaign.verify(fit, autopilot) else "not held")
    mission = st.Mission.load(project / "mission.toml")
    print(f"{fly(fit.vehicle, autopilot, mission):.2f} m/s at most")
    try:
        st.Campaign.load(folder / "missing.toml")
    except st.CampaignError as error:
        print(error)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
