"""Design of experiments: manoeuvres, the plan of the next trial, coverage of intervals."""
