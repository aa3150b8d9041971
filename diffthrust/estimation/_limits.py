"""The most that may be asked of a fit: beyond it nothing is gained, and no machine gets there."""

STARTS_LIMIT = 1_000
SUBSTEPS_LIMIT = 10_000
SEED_LIMIT = 2**64 - 1
"""As long as the integers of a spec file."""
