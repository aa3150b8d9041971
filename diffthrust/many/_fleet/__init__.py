"""All fits of a fleet at once: what differs, what drifts, what vehicles share."""
