"""Recordings as they arrive: sessions, phase by phase, and stops before the end."""
