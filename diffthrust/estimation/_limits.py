"""The most that may be asked of a fit: beyond it nothing is gained, and no machine gets there."""

MOST_STARTS = 1_000
MOST_SUBSTEPS = 10_000
LARGEST_SEED = 2**64 - 1
"""As long as the integers of a spec file."""
