"""Figures for paper and screen in one house style; every function returns a matplotlib figure.

Each module draws one figure: of a vehicle (`views`, `model_diagram`, `actuator_diagram`, `static_transfer`,
`rate_limiting`, `characteristic_curve`, `performance`), of a bench test (`motor_step`, `bollard`), of an
identification (`optimisation_diagram`, `stage_result`, `search_history`, `comparison`, `intervals`,
`model_criticism`), of the autopilot (`control_structure`, `guidance_geometry`), of a mission
(`mission_plan`) and of a flight (`flight_track`, `flight_errors`, `flight_loops`, `flight_actuators`).
`gallery` collects those of a run, `paper_figures` all of them with captions. `style` holds what they share
and saves them, `diagram` the parts of block diagrams. matplotlib is loaded when the first figure is drawn,
without a display.
"""
