"""Running work together: compiled programs in rows, and tasks in processes."""
