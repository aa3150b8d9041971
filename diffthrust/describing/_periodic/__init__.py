"""Periodic responses: integrated, shot for, or balanced by harmonics."""
