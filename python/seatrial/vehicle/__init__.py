"""Facts about a vehicle: actuators, authority, steady states, turning, stability, passivity."""
