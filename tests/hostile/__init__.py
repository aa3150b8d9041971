"""Hostile specs and logs, and faults at random times, and what may come of them."""
