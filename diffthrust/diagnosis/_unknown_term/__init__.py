"""What no known effect explains, learned as a curve: laws that are possible, their evidence."""
