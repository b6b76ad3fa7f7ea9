"""Linear structures with a one-sided rigid stop: modal flow in closed form, impacts located exactly."""
