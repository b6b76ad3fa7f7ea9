"""Force laws found from the data: a missing force as a free function inside the simulator."""
