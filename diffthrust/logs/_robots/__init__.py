"""Logs of robots and autopilots: series of their own clocks, put on one time base."""
