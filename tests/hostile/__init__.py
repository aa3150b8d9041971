"""Hostile specs and logs, and faults at random times: what they may do to a command, and what not."""
