"""Surge (bollard) test and step test: from load-cell and revolution records to the vehicle file.

Load of the held vehicle -> steady plateaus -> thrust of a single actuator by geometry -> regression per
direction and group -> characteristic in the vehicle file (Taubert et al. 2014, equations 36-38).

bench_file
    the file that says what was pulled
driven, bench_columns, pull_signals, steady_signal, plateaus, separation, pull_points, points
    from records to points of a single actuator
least_squares, outliers, model_choice, thrust_table, unit_fit, plausibility
    from points to a characteristic and how sure it is
step_records
    records for `seatrial.motor_dynamics`
vehicle_entry, vehicle_text
    from results to the vehicle file
evaluate, bench_result, bench_text
    all of it at once
"""

from seatrial.bench_test.bench_result import BenchTest
from seatrial.bench_test.evaluate import bench

__all__ = ["BenchTest", "bench"]
