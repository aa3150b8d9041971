"""Files of columns, read into one table."""
