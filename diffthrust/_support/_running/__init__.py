"""Programs run together: in rows, in processes, in workers of their own."""
