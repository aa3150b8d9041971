"""Logs of robots and autopilots: series with separate clocks, put on one time base."""
