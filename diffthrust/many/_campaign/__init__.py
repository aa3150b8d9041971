"""One task for every spec of a folder, stopped and continued at will."""
