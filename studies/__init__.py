"""Studies of the method: what they print stands in the validation. `make studies` runs them."""
