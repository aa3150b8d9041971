"""Draws from the posterior, their convergence, figures and pages."""
